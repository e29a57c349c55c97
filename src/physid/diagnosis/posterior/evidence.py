"""Collect the evidence of a diagnosis, from its document and from the recordings."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import torch
from torch import Tensor

from physid.data import RecordingSet
from physid.diagnosis.document.document import FILE, Diagnosis, read_diagnosis
from physid.diagnosis.document.evidence import Evidence, hypothesis
from physid.diagnosis.inputs import Observations, load_observations
from physid.diagnosis.posterior.posterior import confidence, shipped
from physid.diagnosis.settings.settings import Settings
from physid.estimation.segmented_fit import without_outliers


def with_probabilities(document: Diagnosis, observations: Observations, settings: Settings) -> Diagnosis:
    """Add to a diagnosis how probable each cause is, hence how sure the verdict, and what that follows from."""
    evidence = evidence_of(document, observations, settings)
    causes = shipped().probabilities(evidence)
    return replace(document, confidence=confidence(evidence, causes), causes=causes, evidence=evidence)


def read_evidence(folder: Path, recordings: Path) -> tuple[Diagnosis, Evidence]:
    """Read the diagnosis in a folder, and collect its evidence with the recordings that it saw."""
    document = read_diagnosis(folder / FILE)
    return document, evidence_of(document, load_observations(RecordingSet(recordings)), Settings())


def evidence_of(document: Diagnosis, observations: Observations, settings: Settings) -> Evidence:
    """Collect what the probabilities of causes follow from.

    Args:
        document: The diagnosis; its probabilities are not used.
        observations: What was diagnosed.
        settings: How many hypotheses are listed, and what a tie is.
    """
    gap = document.gap
    present = without_outliers(observations, settings.noise).present
    group = _group(document)
    return Evidence(
        said=tuple(group) if document.blamed else (document.verdict,),
        behind=_behind(document, group if document.blamed else [], settings),
        gap=gap.most_beyond_noise / gap.tolerance.position,
        bend=bend(observations.pose[..., :3], present > 0, observations.timeline.time, gap.floor),
        poses=int(observations.present.sum()),
    )


def _group(document: Diagnosis) -> list[str]:
    """Return the hypotheses that the verdict allows: what is blamed, and what the search fitted of the group's effects.

    An effect that no such hypothesis holds has the signature of one that is blamed, and may stand for any of them.
    """
    blamed = document.blamed
    ranked = [one.effects for one in document.ranking if len(one.effects) == len(blamed)]
    allowed = [blamed, *(names for names in ranked if {*names} <= {*document.group})]
    known = {name for names in allowed for name in names}
    for rival in (name for name in document.group if name not in known):
        allowed += [(*(name for name in blamed if name != one), rival) for one in blamed]
    return list(dict.fromkeys(map(hypothesis, allowed)))


def _behind(document: Diagnosis, group: list[str], settings: Settings) -> dict[str, float]:
    """Return how far hypotheses fall behind the best one: those of the group, and the first ones of the ranking.

    A member of the group without a score of its own has the signature of the one that is blamed.
    """
    scores = {hypothesis(one.effects): max(one.score, 0.0) for one in document.ranking}
    best = max(scores.values(), default=0.0)
    tie = max(settings.evidence.least, settings.evidence.same * best)
    listed = dict.fromkeys([*group, *list(scores)[: settings.posterior.listed]])
    return {name: math.log1p((best - scores.get(name, best)) / tie) for name in listed}


def bend(position: Tensor, present: Tensor, time: Tensor, floor: float) -> float:
    """Compute how far positions leave the line between their neighbours, beyond the noise.

    For frames at distances h the second difference d = x[k+1] - 2 x[k] + x[k-1] has a variance of 6 sigma^2 per
    coordinate by noise alone. Frames that wander in time are put on their mean distance.

    Args:
        position: Shape (R, T, N, 3) [m].
        present: Which of them count, shape (R, T, N).
        time: Shape (R, T) [s].
        floor: Root mean square error that a perfect model leaves, sqrt(3) sigma [m].

    Returns:
        sqrt(max(mean |d|^2 - 6 floor^2, 0)) / floor; 0 without three frames in a row.
    """
    step = time.diff(dim=1).clamp_min(torch.finfo(time.dtype).tiny)[..., None, None]
    middle = (step[:, 1:] + step[:, :-1]) / 2
    second = (position.diff(dim=1) / step).diff(dim=1) * middle
    square = second.square().sum(-1)[present[:, 2:] & present[:, 1:-1] & present[:, :-2]]
    if not len(square):
        return 0.0
    return math.sqrt(max(float(square.mean()) - 6 * floor**2, 0.0)) / floor
