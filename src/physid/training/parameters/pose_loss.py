"""What it costs that predicted poses leave recorded ones."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from physid.estimation.measurement import Noise, pose_difference

MOST_UNEQUAL = 100.0
"""Largest ratio of the two noises [m/rad], or of its inverse, that is believed."""


def mean_over_time(value: Tensor, real: Tensor) -> Tensor:
    """Average values (B, T, ...) over the frames that are real (B, T); shape (B, ...), zero where there are none."""
    weight = (real / real.sum(1, keepdim=True).clamp_min(1)).to(value)
    return torch.einsum("bt...,bt->b...", value, weight)


@dataclass(frozen=True)
class PoseLoss:
    """The paper's loss, e = |p^ - p|^2 + w |ln(q^-1 q^)|^2, averaged over time and summed over bodies.

    Attributes:
        rotation_weight: w [m^2/rad^2]; the paper's is 1.
        robust: Scale c [m] of a Cauchy loss c^2 ln(1 + e / c^2) in place of e: a few frames that no parameter explains
            then count little. None for e itself.
    """

    rotation_weight: float = 1.0
    robust: float | None = None

    @classmethod
    def weighed_by(cls, noise: Noise) -> PoseLoss:
        """Return the loss in which a deviation of a rotation counts as much as one of a position."""
        ratio = min(max(noise.position / noise.rotation, 1 / MOST_UNEQUAL), MOST_UNEQUAL)
        return cls(rotation_weight=ratio**2)

    def __post_init__(self) -> None:
        if self.rotation_weight < 0 or (self.robust is not None and self.robust <= 0):
            raise ValueError(
                f"rotation_weight must not be negative and robust must be positive or null, got {self.rotation_weight} "
                f"and {self.robust}"
            )

    def __call__(self, residual: Tensor, real: Tensor) -> dict[str, Tensor]:
        """Compute the loss of each trajectory.

        Args:
            residual: Shape (B, T, N, 6), rotation vectors, then positions, see `pose_difference`.
            real: Which frames count, shape (B, T).

        Returns:
            The loss by parts, each of shape (B,): position and rotation, or one of both where it is robust.
        """
        position, rotation = self._squares(residual)
        if self.robust is None:
            return {"position": mean_over_time(position, real), "rotation": mean_over_time(rotation, real)}
        square = self.robust**2
        return {"pose": mean_over_time(square * torch.log1p((position + rotation) / square), real)}

    def between(self, predicted: Tensor, recorded: Tensor, real: Tensor) -> dict[str, Tensor]:
        """Compute the loss of predicted poses (B, T, N, 7) beside recorded ones, as a call does."""
        return self(pose_difference(predicted, recorded), real)

    def weights(self, residual: Tensor, real: Tensor) -> Tensor:
        """Compute W, by which the squares of the residuals sum up to the loss near where they are.

        Args:
            residual: Shape (B, T, N, 6); a robust loss weighs each frame by its slope there.
            real: Which frames count, shape (B, T).

        Returns:
            Shape (B, T, N, 6).
        """
        weight = (real / real.sum(1, keepdim=True).clamp_min(1)).to(residual)
        if self.robust is not None:
            position, rotation = self._squares(residual)
            weight = weight / (1 + (position + rotation) / self.robust**2)
        parts = residual.new_tensor([self.rotation_weight] * 3 + [1.0] * 3)
        return (weight[..., None, None] * parts).expand_as(residual)

    def _squares(self, residual: Tensor) -> tuple[Tensor, Tensor]:
        """Return the position and the rotation part of e, each (B, T)."""
        square = residual.square().sum(2)
        return square[..., 3:].sum(-1), self.rotation_weight * square[..., :3].sum(-1)
