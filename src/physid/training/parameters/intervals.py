"""Confidence intervals of parameters, from how much each trajectory pulls at them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import final

import torch
from torch import Tensor

from physid.training.parameters.pose_loss import PoseLoss

CONFIDENCE = 0.9
COARSE = 0.1
"""Step of ln(parameter) where the slope of the loss says nothing."""
ROUNDING = 1e-10
"""Root of the mean square of derivatives [m] that are nothing but rounding."""
WIDEST = 10.0
"""Standard deviation of a logarithm beyond which nothing is known."""


@final
@dataclass(frozen=True)
class Pull:
    """How much trajectories pull at the logarithms of P parameters where their mean loss is least.

    Attributes:
        gradient: Derivative of each loss, shape (B, P).
        curvature: Second derivative of each, in Gauss and Newton's approximation, shape (B, P, P).
        shift: What the steps of the engine may still change of the parameters, shape (P,); None for nothing.
    """

    gradient: Tensor
    curvature: Tensor
    shift: Tensor | None = None

    @classmethod
    def of(cls, loss: PoseLoss, residual: Tensor, slopes: Tensor, real: Tensor) -> Pull:
        """Compute it from residuals (B, T, N, 6) and their derivatives J (P, B, T, N, 6) by the logarithms."""
        weight = loss.weights(residual, real)
        gradient = torch.einsum("pbtni,btni,btni->bp", slopes, weight, residual)
        return cls(2 * gradient, 2 * torch.einsum("pbtni,qbtni,btni->bpq", slopes, slopes, weight))

    def of_trajectories(self, index: Tensor) -> Pull:
        """Sum over the segments of each trajectory, of which `index` (B,) names one for each."""
        which = index.unique(return_inverse=True)[1]
        count = int(which.max()) + 1

        def summed(value: Tensor) -> Tensor:
            return value.new_zeros(count, *value.shape[1:]).index_add(0, which, value)

        return Pull(summed(self.gradient), summed(self.curvature), self.shift)

    def covariance(self) -> Tensor:
        """Compute the covariance of the parameters, shape (P, P).

        H^-1 (sum_b u_b u_b^T) H^-1, with H the sum of the curvatures and u_b = (1 - H_b H^-1)^-1 g_b: the residuals of
        whole trajectories stand for all that disturbs them, noise, however coloured, and misfit, as long as it is
        independent between trajectories (Huber 1967, White 1982, Liang & Zeger 1986); the factor makes up for their
        having been fitted (CR3: Bell & McCaffrey 2002). What all trajectories share, say a wrong length, does not show,
        but for the steps of the engine: the square of what these may change is added.
        """
        total = self.curvature.sum(0)
        diagonal = total.diagonal()
        # A parameter without influence gets a huge deviation, not an error.
        floor = 1e-12 * diagonal.max() + torch.finfo(total.dtype).tiny
        inverse = torch.linalg.inv(total + torch.diag(floor.expand(len(total))))
        left = torch.eye(len(total)).to(total) - self.curvature @ inverse
        pulled = torch.linalg.lstsq(left, self.gradient[..., None]).solution[..., 0]
        spread: Tensor = inverse @ (pulled.T @ pulled) @ inverse
        if self.shift is not None:
            spread = spread + torch.outer(self.shift, self.shift)
        return known(spread, total, len(self.gradient))


def known(covariance: Tensor, curvature: Tensor, trajectories: int) -> Tensor:
    """Return a covariance (P, P) that is infinite for parameters whose curvature, summed, is nothing but rounding.

    The quotient of two rounding errors may be anything, zero included.
    """
    unseen = curvature.diagonal() <= 2 * ROUNDING**2 * trajectories
    return torch.where(torch.diag(unseen), math.inf, covariance)


def coarse_pull(losses: Callable[[Tensor], Tensor], here: Tensor, step: float = COARSE) -> Pull:
    """Compute the pull by differences of the losses over a coarse step, where their slopes say nothing.

    Args:
        losses: The losses (K, B) of B trajectories at K points (K, P).
        here: The point where their mean is least, shape (P,).
        step: Of the differences; the curvature is that of the mean.
    """
    count = len(here)
    moves = step * torch.eye(count).to(here)
    pairs = torch.stack([moves[:, None] + moves, moves[:, None] - moves]).flatten(0, 2)
    value = losses(here + torch.cat([moves, -moves, pairs, -pairs]))
    plus, minus, both = value[:count], value[count : 2 * count], value[2 * count :]
    along, across = both.unflatten(0, (2, 2, count, count)).sum(0)
    curvature = (along - across).mean(-1) / (4 * step**2)
    size = value.shape[1]
    return Pull(((plus - minus) / (2 * step)).T, curvature.expand(size, count, count))


def intervals(
    estimates: Mapping[str, float], covariance: Tensor, trajectories: int, confidence: float = CONFIDENCE
) -> dict[str, tuple[float, float]]:
    """Return an interval of each parameter, by Student's distribution of its logarithm.

    Args:
        estimates: Parameters by name.
        covariance: Of their logarithms, shape (P, P).
        trajectories: From how many independent trajectories it was estimated.
        confidence: Share of the intervals that hold the truth.

    Returns:
        Lower and upper end by name; (0, inf) where nothing is known.
    """
    from scipy.stats import t as student

    quantile = float(student.ppf((1 + confidence) / 2, max(trajectories - 1, 1)))
    found: dict[str, tuple[float, float]] = {}
    for (name, value), variance in zip(estimates.items(), covariance.diagonal().tolist(), strict=True):
        finite = math.isfinite(variance) and 0 <= variance < WIDEST**2
        factor = math.exp(quantile * math.sqrt(variance)) if finite else math.inf
        found[name] = (value / factor, value * factor)
    return found
