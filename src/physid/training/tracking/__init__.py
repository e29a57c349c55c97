"""Poses tracked in films without training: `physid track`."""
