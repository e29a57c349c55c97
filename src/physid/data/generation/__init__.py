"""Recordings made by a simulator: what they shall be, and how they come about."""
