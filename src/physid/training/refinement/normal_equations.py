"""Gauss-Newton over many batches: sums of what one step over all trajectories needs."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol, final

import torch
from torch import Tensor

from physid.training.parameters.intervals import Pull, known
from physid.training.parameters.pose_loss import PoseLoss
from physid.training.parameters.sensitivity import residuals
from physid.training.parameters.slopes import slopes
from physid.training.parameters.trajectories import Trajectories

if TYPE_CHECKING:
    from physid.training.vision.model import VideoModel

MISFIT = 3.0
"""Root of a trajectory's loss, relative to the median's, from which on it counts half."""
FLOOR = 1e-12
"""Smallest curvature, relative to the largest: a parameter without influence stays where it is."""


class OwnUnknowns(Protocol):
    """Unknowns of each trajectory beside the parameters of all of them, say its initial pose, fitted beforehand."""

    def reduce(self, answer: Tensor, loss: PoseLoss, real: Tensor) -> Tensor:
        """Take out of the derivatives J (P, B, T, N, 6) by the parameters what these unknowns would do as well."""
        ...


@final
class NormalEquations:
    """Gradient and curvature of a loss, collected over trajectories.

    A hit that no parameter explains, since engines resolve it in different ways, outweighs all others by its square.
    Each trajectory therefore counts by a Cauchy weight, w_b = 1 / (1 + L_b / (MISFIT^2 median L)), with L_b its own
    loss: a trajectory that fits like most of them counts fully, whatever the noise.
    """

    def __init__(self, parameters: int) -> None:
        self._parameters = parameters
        self._losses: list[Tensor] = []
        self._pulls: list[Pull] = []
        self._common: list[Tensor] = []

    def collect(self, losses: Tensor, pull: Pull, common: Tensor) -> None:
        """Take losses (B,) of trajectories, how much they pull, and the errors they share (B, P, K), see `common`."""
        self._losses.append(losses)
        self._pulls.append(pull)
        self._common.append(common)

    @property
    def weights(self) -> Tensor:
        """How much each trajectory counts, shape (B,)."""
        losses = torch.cat(self._losses)
        scale = MISFIT**2 * losses.median()
        return 1 / (1 + losses / scale) if scale > 0 else torch.ones_like(losses)

    @property
    def gradients(self) -> Tensor:
        """Weighed derivative of each trajectory's loss by the parameters, shape (B, P)."""
        return self.weights[:, None] * torch.cat([pull.gradient for pull in self._pulls])

    @property
    def curvature(self) -> Tensor:
        """2 J^T W J, weighed and summed over trajectories, shape (P, P)."""
        each = torch.cat([pull.curvature for pull in self._pulls])
        return torch.einsum("b,bpq->pq", self.weights, each)

    @property
    def common(self) -> Tensor:
        """2 J^T W e, weighed and summed over trajectories, shape (P, K).

        e is what each of K independent errors that all of them share, such as that of the scale of an image, adds to
        the residuals within a standard deviation.
        """
        return torch.einsum("b,bpk->pk", self.weights, torch.cat(self._common))

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
            trajectories: Initial states, wrenches, and the poses that should come out; on the device of the physics.
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
        residual, answer = residual[usable], answer[:, usable]
        added = residual.new_zeros(0, *residual.shape)
        if shifted:
            with torch.no_grad():
                moved = torch.stack([residuals(model.layer, physical, one) for one in shifted])
            added = moved[:, usable] - residual
        weight = loss.weights(residual, real[usable])
        common = 2 * torch.einsum("pbtni,btni,kbtni->bpk", answer, weight, added)
        self.collect(value[usable], Pull.of(loss, residual, answer, real[usable]), common)
        return value

    def step(self, largest: float) -> Tensor:
        """Solve H x = -g, and shorten x so that no component exceeds `largest`; shape (P,)."""
        step: Tensor = torch.linalg.solve(self._stiff(), -self.gradients.sum(0))
        return step * min(1.0, largest / max(float(step.abs().max()), FLOOR))

    def covariance(self) -> Tensor:
        """Estimate the covariance of the parameters, H^-1 (sum_b g_b g_b^T + C C^T) H^-1, shape (P, P).

        The spread of the gradients over trajectories stands for all that their residuals hold, noise and misfit, which
        only need to be independent between trajectories (Huber 1967, White 1982). An error that all trajectories share
        does not show there; C is what is known of it, `common`.
        """
        gradients, common, inverse = self.gradients, self.common, torch.linalg.inv(self._stiff())
        share = len(gradients) / max(len(gradients) - self._parameters, 1)
        covariance = inverse @ (share * gradients.T @ gradients + common @ common.T) @ inverse
        return known(covariance, self.curvature, len(gradients))

    def _stiff(self) -> Tensor:
        curvature = self.curvature
        diagonal = curvature.diagonal()
        return curvature + torch.diag(FLOOR * diagonal.max() + torch.finfo(diagonal.dtype).tiny + 0 * diagonal)
