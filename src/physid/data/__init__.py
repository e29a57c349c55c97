"""Recordings: on disk, made by PyBullet or imported, and in batches."""
