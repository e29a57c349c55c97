"""How sure a verdict is: how often verdicts of its kind were right on calibration sets."""

from __future__ import annotations

from physid.diagnosis.attribute import Attribution
from physid.diagnosis.verdict import Name

RIGHT: dict[Name, tuple[int, int]] = {
    "none": (19, 20),
    "named": (19, 20),
    "group": (19, 20),
    "partial": (3, 4),
    "unknown": (3, 4),
}
"""Of each verdict: how many were right, of how many, on calibration sets."""


def confidence(verdict: Name, found: Attribution) -> float:
    """Return the probability that a verdict is right, (right + 1) / (all + 2) on calibration sets (Laplace 1774)."""
    right, count = RIGHT[verdict]
    return (right + 1) / (count + 2)
