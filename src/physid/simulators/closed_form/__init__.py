"""Motions by closed forms, without an engine: exact up to rounding, for the few that have them."""
