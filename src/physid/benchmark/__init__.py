"""Withheld checks: how well a diagnosis does on recordings whose truth it cannot see."""
