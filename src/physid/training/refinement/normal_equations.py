"""Gauss-Newton over many batches: what one step over all trajectories needs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, final

import torch
from torch import Tensor

from physid.estimation.least_squares import Normal, covariance_of, solve_shared
from physid.physics import PhysicsLayer
from physid.training.initial_states import slopes
from physid.training.parameters import (
    RIDGE,
    ROUNDING,
    PhysicalParameters,
    PoseLoss,
    Trajectories,
    known,
    normal_of,
    ridge_of,
)

MISFIT = 3.0
"""Root of a trajectory's loss, relative to the median's, from which on it counts half."""
LEAST = 1e-5
"""Standard deviation of a logarithm: even on poses without noise, engines differ by so much on pushes."""
FIELDS = ("matrix", "vector", "square")


class OwnUnknowns(Protocol):
    """Unknowns of each trajectory beside the parameters of all of them, say its initial pose, fitted beforehand."""

    def reduce(self, answer: Tensor, loss: PoseLoss, real: Tensor) -> Tensor:
        """Take out of the derivatives J (P, B, T, N, 6) by the parameters what these unknowns would do as well."""
        ...


@final
class NormalEquations:
    """Normal equations of a loss, collected over trajectories.

    A hit that no parameter explains, since engines resolve it in different ways, outweighs all others by its square.
    Each trajectory therefore counts by a Cauchy weight, w_b = 1 / (1 + L_b / (MISFIT^2 median L)), with L_b its own
    loss: a trajectory that fits like most of them counts fully, whatever the noise.
    """

    def __init__(self) -> None:
        self._losses: list[Tensor] = []
        self._normals: list[Normal] = []
        self._common: list[Tensor] = []

    def collect(self, losses: Tensor, normal: Normal, common: Tensor) -> None:
        """Take losses (B,) of trajectories, their normal equations, and errors they share (B, P, K), see `common`."""
        self._losses.append(losses)
        self._normals.append(normal)
        self._common.append(common)

    @property
    def weights(self) -> Tensor:
        """How much each trajectory counts, shape (B,)."""
        losses = torch.cat(self._losses)
        scale = MISFIT**2 * losses.median()
        return 1 / (1 + losses / scale) if scale > 0 else torch.ones_like(losses)

    @property
    def normal(self) -> Normal:
        """The normal equations of all trajectories, weighed."""
        weights = self.weights
        matrix, vector, square = (torch.cat([getattr(one, name) for one in self._normals]) for name in FIELDS)
        return Normal(weights[:, None, None] * matrix, weights[:, None] * vector, weights * square)

    @property
    def common(self) -> Tensor:
        """J^T W e, weighed and summed over trajectories, shape (P, K).

        e is what each of K independent errors that all of them share, such as that of the scale of an image, adds to
        the residuals within a standard deviation.
        """
        return torch.einsum("b,bpk->pk", self.weights, torch.cat(self._common))

    def add(
        self,
        layer: PhysicsLayer,
        physical: PhysicalParameters,
        loss: PoseLoss,
        trajectories: Trajectories,
        real: Tensor,
        own: OwnUnknowns | None = None,
        shifted: Sequence[Trajectories] = (),
    ) -> Tensor:
        """Add a batch of trajectories, but for those whose slopes hold for tiny changes alone (see `slopes`).

        Args:
            layer: The physics.
            physical: The physical parameters, where the physics computes.
            loss: What errors of predicted poses cost.
            trajectories: Initial states, wrenches, and the poses that should come out; on the device of the physics.
            real: Which frames count, shape (B, T).
            own: The trajectories' own unknowns, if they have any.
            shifted: The same trajectories with a standard deviation of each error that all of them share.

        Returns:
            The loss of each trajectory, shape (B,).
        """
        with torch.no_grad():
            residual = trajectories.residual(layer, physical())
            value = torch.stack(list(loss(residual, real).values())).sum(0)
        answer, usable = (each.to(residual.device) for each in slopes(layer, physical, trajectories))
        answer = answer if own is None else own.reduce(answer, loss, real)
        usable = usable | ~usable.any()  # better all than none
        residual, answer = residual[usable], answer[:, usable]
        added = residual.new_zeros(0, *residual.shape)
        if shifted:
            with torch.no_grad():
                moved = torch.stack([one.residual(layer, physical()) for one in shifted])
            added = moved[:, usable] - residual
        weight = loss.weights(residual, real[usable])
        common = torch.einsum("pbtni,btni,kbtni->bpk", answer, weight, added)
        self.collect(value[usable], normal_of(loss, residual, answer, real[usable]), common)
        return value

    def step(self, largest: float) -> Tensor:
        """Solve the normal equations, and shorten x so that no component exceeds `largest`; shape (P,)."""
        normal = self.normal
        every = torch.ones_like(normal.square, dtype=torch.bool)
        step = solve_shared(normal, every, ridge_of(normal.matrix.sum(0)))
        return step * min(1.0, largest / max(float(step.abs().max()), RIDGE))

    def covariance(self) -> Tensor:
        """Estimate the covariance of the parameters, shape (P, P), once the step is taken (see `covariance_of`).

        An error that all trajectories share does not show in it; C C^T is added for what is known of such, `common`.
        """
        normal = self.normal
        total = normal.matrix.sum(0)
        ridge = ridge_of(total)
        spread = covariance_of(normal.solved(ridge), ridge, torch.full_like(ridge, LEAST**2))
        shared = torch.linalg.solve(total + torch.diag(ridge), self.common)
        return known(spread + shared @ shared.T, total, ROUNDING**2 * len(normal.square))
