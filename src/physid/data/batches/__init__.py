"""Recordings in batches, for Lightning's Trainer."""
