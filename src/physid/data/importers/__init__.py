"""Recordings from elsewhere, converted to recording sets; nothing is estimated on the way."""
