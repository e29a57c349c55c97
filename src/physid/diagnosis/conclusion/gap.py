"""How far the gap closes: prediction errors before and after, on trajectories that were held out."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from scipy.stats import chi2
from torch import Tensor

from physid.diagnosis.document.document import Split
from physid.diagnosis.inputs import Observations
from physid.diagnosis.selection.materiality import Tolerance
from physid.diagnosis.settings.conclusion import GapSettings
from physid.diagnosis.testing import Hypothesis, LackOfFit, freed
from physid.estimation.least_squares import Experiment
from physid.estimation.measurement import Noise

ROTATION, POSITION = 0, 3
"""Where rotation vectors [rad] and positions [m] begin in a difference of poses."""


@dataclass(frozen=True)
class Interval:
    """A value with its 90 % interval; no interval (None) where too few trajectories would have to tell it."""

    value: float
    low: float | None
    high: float | None

    @property
    def most(self) -> float:
        """The upper end of the interval, the value where there is none."""
        return self.value if self.high is None else self.high


@dataclass(frozen=True)
class Closing:
    """Errors of the predicted positions [m], or rotations [rad], on one part of the recordings.

    Attributes:
        before: Root mean square error of the nominal model, refitted [m or rad].
        after: With the effects [m or rad]; None where none were added.
        shrink: S = (before - after) / (before - floor), None where there is no gap to close.
        floor: What the true model would leave on these trajectories [m or rad].
        values: Coordinates that were compared.
    """

    before: float
    after: float | None
    shrink: Interval | None
    floor: float
    values: int

    @property
    def excess(self) -> float:
        """By how much the nominal model leaves the recordings beyond the floor, sqrt(before^2 - floor^2)."""
        return math.sqrt(max(self.before**2 - self.floor**2, 0.0))

    def ceiling(self, probability: float) -> float:
        """Return the error that the true model exceeds with some probability, by the noise of so many values.

        The sum of n squared errors in units of the noise is a chi-square variable of n degrees of freedom.
        """
        if self.values == 0:
            return self.floor
        return self.floor * math.sqrt(float(chi2.isf(probability, self.values)) / self.values)


def floor_of(noise: Noise, kind: int = POSITION) -> float:
    """Return the root mean square error of positions [m], or rotations [rad], of a perfect model."""
    return noise.floor if kind == POSITION else noise.rotation_floor


def floors_of(experiment: Experiment, noise: Noise, kind: int = POSITION) -> Tensor:
    """Compute the mean square error that each trajectory would have under the true model [m^2 or rad^2], shape (R,).

    Noise gives 3 sigma^2, a reader of films its own error; frames whose numerics disturb more have a larger variance
    and, in `errors_of`, a weight that is smaller by the same factor.
    """
    weight = _weights(experiment, kind)
    count = values_of(experiment, kind) / 3
    return floor_of(noise, kind) ** 2 * count / weight.sum((1, 2)).clamp_min(1e-9)


def values_of(experiment: Experiment, kind: int = POSITION) -> Tensor:
    """Count the coordinates that count in each trajectory, shape (R,)."""
    counted: Tensor = 3 * (_weights(experiment, kind) > 0).sum((1, 2))
    return counted


def _weights(experiment: Experiment, kind: int = POSITION) -> Tensor:
    """Return the weights of the positions, or rotations, in each frame, 1 at most, shape (R, T, N)."""
    scale = experiment.scale[..., kind]
    return (scale / scale.amax().clamp_min(1e-30)) ** 2


def errors_of(hypothesis: Hypothesis, kind: int = POSITION) -> Tensor:
    """Compute the mean square error of positions [m^2], or rotations [rad^2], of each trajectory, shape (R,).

    Initial states are fitted to each segment; frames count by their robust weights.
    """
    weight = _weights(hypothesis.experiment, kind)
    square = hypothesis.fit.residual[..., kind : kind + 3].square().sum(-1) * weight
    total: Tensor = square.sum((1, 2)) / weight.sum((1, 2)).clamp_min(1e-9)
    return total


def residual_wrench_errors(lack: LackOfFit, hypothesis: Hypothesis, noise: Noise) -> Tensor:
    """Compute the mean square position errors that a free residual wrench leaves [m^2], shape (R,)."""
    first = lack.fit.linear.parts[0].shared.shape[-1] - len(lack.cells)
    free = torch.tensor([first + k for k, cell in enumerate(lack.cells) if cell.piece is not None])
    spread = hypothesis.settings.residual_wrench.spread
    square = freed(lack.fit, free, spread)[..., 3:].square().sum((1, 2, 3)) * noise.position**2
    total: Tensor = square / _weights(hypothesis.experiment).sum((1, 2)).clamp_min(1e-9)
    return total


def closing(
    before: Tensor,
    after: Tensor,
    floors: Tensor,
    values: Tensor,
    chosen: Tensor,
    settings: GapSettings,
    generator: torch.Generator,
) -> Closing | None:
    """Compare mean square errors (R,) [m^2 or rad^2] of the chosen trajectories; the interval is a bootstrap over them.

    A bootstrap of one trajectory has no width, and that of two hardly any: fewer than `settings.fewest` give no
    interval.

    Args:
        before: Of the nominal model.
        after: With the effects.
        floors: Of the true model.
        values: Coordinates of each trajectory that count, shape (R,).
        chosen: Which trajectories, shape (R,).
        settings: What is no gap, and how intervals are made.
        generator: Of the bootstrap.
    """
    rows = chosen.nonzero()[:, 0]
    if not len(rows):
        return None

    def errors(index: Tensor) -> tuple[Tensor, Tensor]:
        return before[index].mean(-1).sqrt(), after[index].mean(-1).sqrt()

    old, new = (float(value) for value in errors(rows))
    floor, count = float(floors[rows].mean().sqrt()), int(values[rows].sum())
    if old <= settings.no_gap * floor:  # both are zero where no frame of these trajectories counts
        return Closing(old, new, None, floor, count)
    share = (old - new) / (old - floor)
    if len(rows) < settings.fewest:
        return Closing(old, new, Interval(share, None, None), floor, count)
    draws = rows[torch.randint(len(rows), (settings.bootstraps, len(rows)), generator=generator)]
    olds, news = errors(draws)
    shrinks = (olds - news) / (olds - floor).clamp_min(settings.least * floor)
    low, high = (float(shrinks.quantile(q)) for q in settings.interval)
    return Closing(old, new, Interval(share, low, high), floor, count)


def clearer(position: Closing | None, rotation: Closing | None, allowed: Tolerance) -> int:
    """Return what shows a gap more clearly: rotations where they exceed more of their tolerances, else positions.

    An effect that turns bodies leaves their places nearly alone, and closes hardly anything there.
    """
    if position is None or rotation is None:
        return POSITION
    turned, moved = rotation.excess / allowed.rotation, position.excess / allowed.position
    return ROTATION if turned > max(moved, 1.0) else POSITION


def held_out_parts(observations: Observations) -> dict[Split, Tensor]:
    """Return which trajectories report on each split."""
    same, transfer = observations.reported
    return {"same": same, "transfer": transfer}
