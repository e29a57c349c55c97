"""Confidence intervals of parameters, from how much each trajectory pulls at them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import final

import torch
from torch import Tensor

from physid.estimation.least_squares import Experiment, Fit, Normal, covariance_of, reach_of
from physid.estimation.measurement import Noise
from physid.estimation.prediction.coordinates import Coordinates
from physid.training.parameters.pose_loss import PoseLoss

COARSE = 0.1
"""Step of a coordinate where the slope of the loss says nothing."""
ROUNDING = 1e-10
"""Root of the mean square of derivatives [m] that are nothing but rounding."""
WIDEST = 10.0
"""Standard deviation of a coordinate beyond which nothing is known."""
FAINT = 1e-6
"""The same in units of the noise."""
RIDGE = 1e-12
"""Least curvature, relative to the largest: a parameter without influence gets a huge variance, not an error."""


@final
@dataclass(frozen=True)
class Response:
    """How the estimates of P coordinates respond to the poses of B segments, and how well they are known.

    Attributes:
        normal: Normal equations by trajectory.
        least: Variances that the white noise of the poses alone would cause, shape (P,).
        gain: H^-1 J^T W, by which estimates follow predicted poses, d = -gain r, shape (P, B, T, N, 6); None where
            derivatives mean nothing.
        shared: What a standard deviation of each error that all poses share changes of the estimates, be it one of the
            steps of the engine or of the scale of films, shape (K, P); None for no such error.
        faint: J^T W J, summed, of a parameter of which nothing is known.
    """

    normal: Normal
    least: Tensor
    gain: Tensor | None = None
    shared: Tensor | None = None
    faint: float = 0.0

    @classmethod
    def of(cls, experiment: Experiment, fit: Fit, index: Tensor, noise: Noise) -> Response:
        """Compute it from a fit of B segments, each of the trajectory that `index` (B,) names.

        What a change of the initial states explains as well is taken out, if these are free.
        """
        count, scale = fit.point.nominal.shape[1], experiment.scale
        normal = fit.normal().select(torch.arange(count))
        total = normal.matrix.sum(0)
        weighed = fit.linear.profile(fit.jacobian.shared[:count] * scale) * scale
        gain = torch.einsum("pq,qbtni->pbtni", torch.linalg.inv(total + torch.diag(ridge_of(total))), weighed)
        least = (gain * noise.spread()).square().sum((1, 2, 3, 4))
        return cls(normal.grouped(index.cpu()), least, gain, faint=FAINT**2 * float((scale > 0).sum()))

    @classmethod
    def unknown(cls, count: int) -> Response:
        """Say nothing of P estimates."""
        zero = torch.zeros(1, count, dtype=torch.float64)
        return cls(Normal(zero[..., None].expand(-1, -1, count), zero, zero[:, 0]), zero[0])

    @classmethod
    def coarse(cls, losses: Callable[[Tensor], Tensor], here: Tensor, index: Tensor, step: float = COARSE) -> Response:
        """Compute it by differences of the losses over a coarse step, where their slopes say nothing.

        Args:
            losses: The losses (K, B) of B segments at K points (K, P).
            here: The point where their mean is least, shape (P,).
            index: The trajectory of each segment, shape (B,).
            step: Of the differences; the curvature is that of the mean.
        """
        count = len(here)
        moves = step * torch.eye(count).to(here)
        pairs = torch.stack([moves[:, None] + moves, moves[:, None] - moves]).flatten(0, 2)
        value = losses(here + torch.cat([moves, -moves, pairs, -pairs]))
        plus, minus, both = value[:count], value[count : 2 * count], value[2 * count :]
        along, across = both.unflatten(0, (2, 2, count, count)).sum(0)
        matrix = (along - across).mean(-1) / (8 * step**2)
        size = value.shape[1]
        normal = Normal(matrix.expand(size, count, count), ((minus - plus) / (4 * step)).T, value[0])
        return cls(normal.grouped(index.cpu()), torch.zeros_like(here), faint=ROUNDING**2 * len(index))

    def covariance(self) -> Tensor:
        """Estimate the covariance of the estimates (see `covariance_of`), and add that of errors that all share."""
        total = self.normal.matrix.sum(0)
        ridge = ridge_of(total)
        spread = covariance_of(self.normal.solved(ridge), ridge, self.least)
        if self.shared is not None:
            spread = spread + self.shared.T @ self.shared
        return known(spread, total, self.faint)

    def deviation(self) -> Tensor:
        """Return standard errors of the coordinates, huge where nothing is known, shape (P,)."""
        return self.covariance().diagonal().clamp_min(0).sqrt().nan_to_num(torch.inf)

    def __call__(self, apart: Tensor) -> Tensor:
        """Return the change of the coordinates (P,) by a change of predicted poses (B, T, N, 6)."""
        if self.gain is None:
            return torch.zeros_like(self.least)
        return -torch.einsum("pbtni,btni->p", self.gain, apart.to(self.gain))


def normal_of(loss: PoseLoss, residual: Tensor, slopes: Tensor, real: Tensor) -> Normal:
    """Return the normal equations of each segment, from residuals (B, T, N, 6) and derivatives J (P, B, T, N, 6)."""
    weight = loss.weights(residual, real)
    matrix = torch.einsum("pbtni,qbtni,btni->bpq", slopes, slopes, weight)
    vector = -torch.einsum("pbtni,btni,btni->bp", slopes, weight, residual)
    return Normal(matrix, vector, (weight * residual.square()).sum((1, 2, 3)))


def ridge_of(matrix: Tensor) -> Tensor:
    """Return what keeps a matrix (P, P) regular, shape (P,)."""
    return (RIDGE * matrix.diagonal().max() + torch.finfo(matrix.dtype).tiny).expand(len(matrix))


def known(covariance: Tensor, matrix: Tensor, faint: float) -> Tensor:
    """Return a covariance (P, P) that is infinite for parameters whose J^T W J, summed, is nothing but rounding.

    The quotient of two rounding errors may be anything, zero included.
    """
    unseen = matrix.diagonal() <= faint
    return torch.where(torch.diag(unseen), math.inf, covariance)


def intervals(estimates: Mapping[str, float], covariance: Tensor) -> dict[str, tuple[float, float]]:
    """Return a 90 % interval of each parameter, by the normal distribution of its coordinate (see `Coordinates`).

    Args:
        estimates: Parameters by name.
        covariance: Of their coordinates, shape (P, P).

    Returns:
        Lower and upper end by name, of those of which something is known; within the physical range.
    """
    space, variance = Coordinates.of(estimates), covariance.diagonal()
    here, reach = (
        space.to_coordinates(torch.tensor([*estimates.values()], dtype=torch.float64)),
        reach_of(covariance),
    )
    ends = torch.stack([space.to_values(space.within(here + side * reach)) for side in (-1, 1)], -1)
    something = ((variance >= 0) & (variance < WIDEST**2)).tolist()
    return {
        name: (low, high) for name, (low, high), told in zip(estimates, ends.tolist(), something, strict=True) if told
    }


def logged(ends: Mapping[str, tuple[float, float]]) -> dict[str, Tensor]:
    """Return intervals as figures of a run: params/NAME/low and params/NAME/high."""
    return {
        f"params/{name}/{word}": torch.tensor(value, dtype=torch.float64)
        for name, pair in ends.items()
        for word, value in zip(("low", "high"), pair, strict=True)
    }
