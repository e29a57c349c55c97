"""Gauss-Newton over many batches: sums of what one step over all trajectories needs."""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, final

import torch
from torch import Tensor

from physid.training.intervals import ROUNDING
from physid.training.pose_loss import PoseLoss
from physid.training.sensitivity import residuals
from physid.training.slopes import slopes
from physid.training.trajectories import Trajectories

if TYPE_CHECKING:
    from physid.training.video.model import VideoModel

FLOOR = 1e-12
"""Smallest curvature, relative to the largest: a parameter without influence stays where it is."""


class OwnUnknowns(Protocol):
    """Unknowns of each trajectory beside the parameters of all of them, say its first pose, fitted beforehand."""

    def reduce(self, answer: Tensor, loss: PoseLoss, real: Tensor) -> Tensor:
        """Take out of the derivatives J (P, B, T, N, 6) by the parameters what these unknowns would do as well."""
        ...


@final
@dataclass
class NormalEquations:
    """Gradient and curvature of a loss, summed over trajectories.

    Attributes:
        gradients: Derivative of each trajectory's loss by the P parameters, pieces of shape (B, P).
        curvature: 2 J^T W J summed over trajectories, shape (P, P).
        common: 2 J^T W e summed over trajectories, shape (P, K): e is what each of K independent errors that all of
            them share, such as that of the scale of an image, adds to the residuals within a standard deviation.
    """

    gradients: list[Tensor]
    curvature: Tensor
    common: Tensor

    @classmethod
    def empty(cls, parameters: int) -> NormalEquations:
        """Begin without any trajectory."""
        zero = torch.zeros(parameters, dtype=torch.float64)
        return cls([], torch.diag(zero), zero[:, None])

    def add(
        self,
        model: VideoModel,
        loss: PoseLoss,
        trajectories: Trajectories,
        real: Tensor,
        own: OwnUnknowns | None = None,
        shifted: Sequence[Trajectories] = (),
    ) -> Tensor:
        """Add a batch of trajectories, but for those whose slopes hold for tiny changes alone (see `slopes`).

        Args:
            model: Gives physics and parameters.
            loss: What errors of predicted poses cost.
            trajectories: First states, wrenches, and the poses that should come out; on the device of the physics.
            real: Which frames count, shape (B, T).
            own: The trajectories' own unknowns, if they have any.
            shifted: The same trajectories with a standard deviation of each error that all of them share.

        Returns:
            The loss of each trajectory, shape (B,).
        """
        physical = copy.deepcopy(model.physical).to(model.physics_device)
        with torch.no_grad():
            residual = residuals(model.layer, physical, trajectories)
            value = torch.stack(list(loss(residual, real).values())).sum(0)
        found = slopes(model.layer, physical, trajectories)
        answer = found.sensitivity if own is None else own.reduce(found.sensitivity, loss, real)
        usable = found.usable | ~found.usable.any()  # better all than none
        weighed = loss.weights(residual, real)[usable] * answer[:, usable]
        self.gradients.append(2 * torch.einsum("pbtni,btni->bp", weighed, residual[usable]))
        self.curvature += 2 * torch.einsum("pbtni,qbtni->pq", weighed, answer[:, usable])
        if shifted:
            with torch.no_grad():
                added = torch.stack([residuals(model.layer, physical, one) for one in shifted]) - residual
            self.common = self.common + 2 * torch.einsum("pbtni,kbtni->pk", weighed, added[:, usable])
        return value

    def step(self, largest: float) -> Tensor:
        """Solve H x = -g, and shorten x so that no component exceeds `largest`; shape (P,)."""
        step: Tensor = torch.linalg.solve(self._stiff(), -torch.cat(self.gradients).sum(0))
        return step * min(1.0, largest / max(float(step.abs().max()), FLOOR))

    def covariance(self) -> Tensor:
        """Estimate the covariance of the parameters, H^-1 (sum_b g_b g_b^T + C C^T) H^-1, shape (P, P).

        The spread of the gradients over trajectories stands for all that their residuals hold, noise and misfit, which
        only need to be independent between trajectories (Huber 1967, White 1982). An error that all trajectories share
        does not show there; C is what is known of it, `common`.
        """
        gradients, inverse = torch.cat(self.gradients), torch.linalg.inv(self._stiff())
        share = len(gradients) / max(len(gradients) - len(self.curvature), 1)
        covariance = inverse @ (share * gradients.T @ gradients + self.common @ self.common.T) @ inverse
        unseen = self.curvature.diagonal() <= 2 * ROUNDING**2 * len(gradients)
        return torch.where(torch.diag(unseen), math.inf, covariance)

    def _stiff(self) -> Tensor:
        diagonal = self.curvature.diagonal()
        return self.curvature + torch.diag(FLOOR * diagonal.max() + torch.finfo(diagonal.dtype).tiny + 0 * diagonal)
