"""Which residual laws explain what a model leaves, in trajectories that they were not fitted to."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from physid.diagnosis.document.residual_law import ResidualLaw
from physid.diagnosis.reference.nominal_fit import NominalFit
from physid.diagnosis.residual_law.laws import Law, knots_of, list_laws
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
    settings, laws = nominal_fit.settings, list_laws(nominal_fit, hypothesis, lack)
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
        further = explains - (steps[-1][1] if steps else 0.0)
        if law is None or solution.score - best.score < least or further < settings.residual_law.explains:
            break
        steps.append((solution.score - best.score, explains))
        chosen.append(law)
        solution = best
    described = _described(regression, solution, chosen, steps, nominal_fit.noise.position)
    return ResidualLaws(tuple(described), gains if chosen else {})


def _described(
    regression: Regression,
    solution: Solution,
    laws: Sequence[Law],
    steps: Sequence[tuple[float, float]],
    noise: float,
) -> list[ResidualLaw]:
    """Give laws their sizes with intervals, in the order in which they were found."""
    own = regression.settings
    covariance = covariance_of(
        solution.normal.of(regression.fitted), solution.ridge, settings=own.least_squares.intervals
    )
    first = len(solution.ridge) - len(solution.sizes)
    covariance, energy = covariance[first:, first:], solution.normal.matrix.sum(0)[first:, first:]
    found = []
    for (law, places), (gain, explains) in zip(knots_of(laws), steps, strict=True):
        size, known = solution.sizes[places], covariance[places, places]
        moved = float(size @ energy[places, places] @ size) / regression.frames
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
                moves=noise * max(moved, 0.0) ** 0.5,
                explains=explains,
                gain=gain,
            )
        )
    return found
