"""How sure a verdict is: how often verdicts of its kind were right on recordings with known effects."""

from __future__ import annotations

from physid.diagnosis.document.document import Verdict
from physid.diagnosis.selection.attribution import Attribution


def confidence(verdict: Verdict, found: Attribution) -> float:
    """Return the probability that a verdict is right, (right + 1) / (all + 2) on calibration sets (Laplace 1774)."""
    experiment, settings = found.nominal.experiment, found.nominal.settings.confidence
    segments = experiment.predictor.segments
    contact = segments.contact
    if experiment.predictor.model.scene.integration is not None:
        beyond = contact & ~experiment.follow
    else:
        scale = experiment.scale[..., 3].amax(-1)
        usual = segments.sum_frames(scale[None])[0] / segments.size
        beyond = contact & (usual < settings.faint * scale.amax())
    lost = float(beyond.sum()) > settings.most_lost * float(contact.sum())
    kind = "none_after_impacts" if verdict == "none" and lost else verdict
    right, count = settings.counts(kind)
    return (right + 1) / (count + 2)
