"""Errors of predicted poses: sums over trajectories, divided once."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, final

import torch
from torch import Tensor, nn
from torchmetrics import Metric

from physid.physics.rotations import angle_between
from physid.scenes import Scene
from physid.training.parameters.pose_loss import mean_over_time


class PerTrajectory(Metric):
    """The mean and deviation over trajectories and bodies of an error's time mean."""

    is_differentiable = False
    higher_is_better = False
    full_state_update = False
    total: Tensor
    square: Tensor
    count: Tensor

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        for name in ("total", "square", "count"):
            self.add_state(name, torch.zeros((), dtype=torch.float64), dist_reduce_fx="sum")

    @abstractmethod
    def error(self, predicted: Tensor, recorded: Tensor) -> Tensor:
        """Compute the error of every frame and body, (B, T, N), from poses (B, T, N, 7)."""

    def update(self, predicted: Tensor, recorded: Tensor, real: Tensor) -> None:
        """Add trajectories.

        Args:
            predicted: Poses, shape (B, T, N, 7).
            recorded: Poses, shape (B, T, N, 7).
            real: Which frames count, shape (B, T).
        """
        mean = mean_over_time(self.error(predicted, recorded).double(), real)
        self.total += mean.sum()
        self.square += mean.square().sum()
        self.count += mean.numel()

    def compute(self) -> Tensor:
        """Return the mean over trajectories."""
        return self.total / self.count

    def deviation(self) -> Tensor:
        """Return the standard deviation over trajectories (n - 1)."""
        return ((self.square - self.total**2 / self.count).clamp_min(0) / (self.count - 1).clamp_min(1)).sqrt()


@final
class PositionError(PerTrajectory):
    """Distance of positions, divided by the object's size: the mean of its edge lengths [-].

    Args:
        size: Mean edge length of each body [m], shape (N,).
    """

    size: Tensor

    def __init__(self, size: Tensor, **options: Any) -> None:
        super().__init__(**options)
        self.register_buffer("size", size, persistent=False)

    def error(self, predicted: Tensor, recorded: Tensor) -> Tensor:
        """Compute |p^ - p| / size (see `PerTrajectory.error`)."""
        distance: Tensor = (predicted[..., :3] - recorded[..., :3]).norm(dim=-1)
        return distance / self.size


@final
class RotationError(PerTrajectory):
    """Geodesic angle between rotations [deg]."""

    def error(self, predicted: Tensor, recorded: Tensor) -> Tensor:
        """Compute |ln(q^-1 q^)| in degrees (see `PerTrajectory.error`)."""
        return torch.rad2deg(angle_between(predicted[..., 3:], recorded[..., 3:]))


@final
class PoseErrors(nn.Module):
    """Both errors of the predictions for a scene.

    Args:
        scene: Gives the sizes of the bodies.
    """

    def __init__(self, scene: Scene) -> None:
        super().__init__()
        self.position = PositionError(torch.from_numpy(scene.sizes).mean(-1))
        self.rotation = RotationError()

    def update(self, predicted: Tensor, recorded: Tensor, real: Tensor) -> None:
        """Add trajectories (see `PerTrajectory.update`)."""
        self.position.update(predicted, recorded, real)
        self.rotation.update(predicted, recorded, real)

    def take(self) -> dict[str, Tensor]:
        """Return mean and deviation over the trajectories by name, and begin anew."""
        values = {}
        for name, metric in (("position_error", self.position), ("rotation_error", self.rotation)):
            values[name], values[f"{name}_deviation"] = metric.compute(), metric.deviation()
            metric.reset()
        return values
