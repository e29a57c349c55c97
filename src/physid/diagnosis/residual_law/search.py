"""Which residual laws explain what a model leaves, in trajectories that they were not fitted to."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import torch
from torch import Tensor

from physid.diagnosis.document.residual_law import ResidualLaw
from physid.diagnosis.inputs import PHASES
from physid.diagnosis.reference.nominal_fit import NominalFit
from physid.diagnosis.residual_law.laws import Law, knots_of, laws_of
from physid.diagnosis.residual_law.motion import directions_of, variables_of
from physid.diagnosis.residual_law.regression import Regression, Solution
from physid.diagnosis.testing import Hypothesis, LackOfFit
from physid.estimation.least_squares import covariance_of, reach_of
from physid.physics import Site

UNITS = {"force": "N", "torque": "N m", "shift": "m"}


@dataclass(frozen=True)
class ResidualLaws:
    """What explains what a model leaves.

    Attributes:
        described: The laws, in the order in which they were found.
        gains: By how much the best law of each site predicts better [squared residuals]; empty where none is described.
    """

    described: tuple[ResidualLaw, ...] = ()
    gains: Mapping[Site, float] = field(default_factory=dict)


def find_residual_laws(nominal_fit: NominalFit, hypothesis: Hypothesis, lack: LackOfFit) -> ResidualLaws:
    """Find what would have to be added to a model, one law after the other, as long as predictions become better.

    A law is a force, a torque or a shift of the picture along some direction, whose size is any function of one
    variable; it is fitted to what the model leaves, and judged by how well each trajectory is predicted from the
    others.

    Args:
        nominal_fit: The recordings.
        hypothesis: The model.
        lack: What it leaves.

    Returns:
        At most `settings.residual_law.most`; none where no law predicts better than chance lets the best of all.
    """
    settings, laws = nominal_fit.settings, _laws(nominal_fit, hypothesis, lack)
    regression = Regression(hypothesis, lack, laws)
    chosen: list[Law] = []
    before = solution = regression.solve([])
    steps: list[tuple[float, float]] = []
    gains: dict[Site, float] = {}
    left = max(before.loss - regression.expected, 1e-9)
    least = settings.evidence.least + 2 * math.log(max(len(laws), 1))
    while len(chosen) < settings.residual_law.most:
        tried = [(regression.solve([*chosen, law]), law) for law in laws if all(law is not one for one in chosen)]
        best, law = min(tried, key=lambda one: one[0].score, default=(solution, None))
        for each, one in tried if not chosen else ():
            gains[one.site] = max(gains.get(one.site, 0.0), before.score - each.score)
        explains = min(max((before.loss - best.loss) / left, 0.0), 1.0)
        if law is None or solution.score - best.score < least or explains < settings.residual_law.explains:
            break
        steps.append((solution.score - best.score, explains))
        chosen.append(law)
        solution = best
    return ResidualLaws(tuple(_described(regression, solution, chosen, steps)), gains if chosen else {})


def _laws(nominal_fit: NominalFit, hypothesis: Hypothesis, lack: LackOfFit) -> list[Law]:
    """List the laws that the motion lets one ask for."""
    settings, experiment = nominal_fit.settings, hypothesis.experiment
    prediction, timeline = lack.fit.jacobian.base, experiment.predictor.timeline
    segments, frame = experiment.predictor.segments, experiment.directions.frame
    planar = not bool(experiment.directions.free[..., 0].any())
    pieces = max(settings.residual_law.time, settings.residual_wrench.piece_time)
    seen = segments.spread(lack.sound)[..., None] & (experiment.scale[..., 0] > 0)
    return laws_of(
        directions_of(prediction, timeline, frame, planar, settings.phases.still_speed),
        variables_of(prediction, timeline, frame, planar, settings.phases.still_speed),
        nominal_fit.phases == PHASES.index("free_fall"),
        seen,
        settings.residual_law.knots,
        {"force": pieces, "torque": pieces, "shift": settings.residual_law.time},
        settings.residual_wrench.seldom,
    )


def _described(
    regression: Regression, solution: Solution, laws: Sequence[Law], steps: Sequence[tuple[float, float]]
) -> list[ResidualLaw]:
    """Give laws their sizes with intervals, in the order in which they were found."""
    own = regression.settings
    covariance = covariance_of(
        solution.normal.of(regression.fitted), solution.ridge, settings=own.least_squares.intervals
    )
    first = len(solution.ridge) - len(solution.sizes)
    covariance = covariance[first:, first:]
    found = []
    for (law, places), (gain, explains) in zip(knots_of(laws), steps, strict=True):
        size, known = solution.sizes[places], covariance[places, places]
        size, known = _shown(size, known, own.hypothesis.confidence)
        away = reach_of(known, own.hypothesis.confidence)
        found.append(
            ResidualLaw(
                kind=law.direction.kind,
                direction=law.direction.name,
                variable=law.variable.name if law.variable else None,
                variable_unit=law.variable.unit if law.variable else None,
                region=law.region,
                at=tuple(law.knots.tolist()),
                size=tuple(size.tolist()),
                low=tuple((size - away).tolist()),
                high=tuple((size + away).tolist()),
                unit=UNITS[law.direction.kind],
                explains=explains,
                gain=gain,
            )
        )
    return found


def _shown(size: Tensor, covariance: Tensor, confidence: float) -> tuple[Tensor, Tensor]:
    """Leave out what the data do not show: principal directions of the covariance in which sizes may be zero.

    A camera that drifts at a steady speed is one in whose picture bodies are faster: no shift is known but for that.
    """
    variance, axes = torch.linalg.eigh(covariance)
    along = size @ axes
    kept = (along.abs() > reach_of(torch.diag(variance.clamp_min(0)), confidence)).to(size)
    return axes @ (kept * along), (axes * (kept * variance)) @ axes.T
