"""How sure a verdict is: how often verdicts of its kind were right on recordings with known effects."""

from __future__ import annotations

from physid.diagnosis.conclusion.verdict import Name
from physid.diagnosis.selection.attribution import Attribution

RIGHT: dict[Name, tuple[int, int]] = {
    "none": (9, 10),
    "named": (19, 23),
    "group": (19, 23),
    "partial": (2, 6),
    "unknown": (5, 6),
}
"""Of each verdict: how many were right, of how many: on the 51 sets of a calibration bank (60 sets, seed 1616) that are
free, or of medium severity and up. Sets in which a camera is wrong were diagnosed once more after initial states were
made to follow it along a curve.

`physid benchmark diagnosis calibrate` prints such counts. Named and group are counted together.
"""
NONE_AFTER_IMPACTS = (3, 6)
"""The same for `none` where many impacts are beyond any fit, so that effects which act at impacts do not show."""
FAINT = 0.5  # weight of a segment, in the root, below which it is beyond any fit where no simulator is followed
MOST_LOST = 0.1  # share of the contact segments, from which on they are many


def confidence(verdict: Name, found: Attribution) -> float:
    """Return the probability that a verdict is right, (right + 1) / (all + 2) on calibration sets (Laplace 1774)."""
    experiment = found.nominal.experiment
    segments = experiment.predictor.segments
    contact = segments.contact
    if experiment.predictor.model.scene.integration is not None:
        beyond = contact & ~experiment.follow
    else:
        scale = experiment.scale[..., 3].amax(-1)
        usual = segments.sum_frames(scale[None])[0] / segments.size
        beyond = contact & (usual < FAINT * scale.amax())
    lost = float(beyond.sum()) > MOST_LOST * float(contact.sum())
    right, count = NONE_AFTER_IMPACTS if verdict == "none" and lost else RIGHT[verdict]
    return (right + 1) / (count + 2)
