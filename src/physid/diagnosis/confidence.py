"""How sure a verdict is: how often verdicts of its kind were right on recordings with known effects."""

from __future__ import annotations

from physid.diagnosis.attribute import Attribution
from physid.diagnosis.verdict import Name

RIGHT: dict[Name, tuple[int, int]] = {
    "none": (5, 5),
    "named": (12, 13),
    "group": (6, 6),
    "partial": (0, 0),
    "unknown": (2, 3),
}
"""Of each verdict: how many were right, of how many: on 30 calibration sets and some pushes, diagnosed by earlier code.

`physid benchmark diagnosis calibrate` prints these counts for a calibration bank; none has been run on this code, and
sealed sets found confidences too high (docs/results.md)."""
NONE_AFTER_HITS = (2, 8)
"""The same for `none` where many hits are beyond any fit, so that effects which act at hits do not show."""
MOST_LOST = 0.1  # share of the busy windows, from which on they are many


def confidence(verdict: Name, found: Attribution) -> float:
    """Return the probability that a verdict is right, (right + 1) / (all + 2) on calibration sets (Laplace 1774)."""
    experiment = found.nominal.experiment
    busy = experiment.predictor.windows.busy
    lost = float((busy & ~experiment.follow).sum()) > MOST_LOST * float(busy.sum())
    right, count = NONE_AFTER_HITS if verdict == "none" and lost else RIGHT[verdict]
    return (right + 1) / (count + 2)
