"""How noisy recorded poses are, from the poses alone."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from physid.physics.rotations import conjugate, logarithm, multiply
from physid.training.identifiability.identifiability import SensorNoise
from physid.training.parameters.pose_loss import PoseLoss
from physid.training.parameters.trajectories import Trajectories

GAIN = math.sqrt(20.0)  # third differences of white noise: 1 + 9 + 9 + 1
MEDIAN = 0.6745  # of the magnitude of a normal variable of deviation 1
MOST_UNEQUAL = 100.0
"""Largest ratio of the two noises [m/rad], or of its inverse, that is believed."""
LEAST = SensorNoise(1e-4, 1e-3)
"""Below this the engine's own errors count, not noise: where a pushed block turns, engines differ by some mrad."""


def pose_noise(trajectories: Trajectories) -> SensorNoise:
    """Estimate the white noise of poses.

    Third differences of a smooth motion vanish with the third power of the time step; what remains is noise. Their
    median magnitude does not see the few frames around an impact (Rice 1984, Hampel 1974).

    Args:
        trajectories: Recorded poses, at least four frames of each.

    Returns:
        Standard deviations of positions and rotations, at least `LEAST`.
    """
    real, pose = trajectories.real, trajectories.pose
    if pose.shape[1] < 4:
        return SensorNoise()
    if trajectories.time is not None and trajectories.seen is not None:
        return _uneven(pose, trajectories.time, real)
    inside = real[:, 3:]
    turn = logarithm(multiply(conjugate(pose[:, :-1, :, 3:]), pose[:, 1:, :, 3:]))
    position, rotation = _deviation(pose[..., :3].diff(n=3, dim=1)[inside]), _deviation(turn.diff(n=2, dim=1)[inside])
    return SensorNoise(max(position, LEAST.position), max(rotation, LEAST.rotation))


def _uneven(pose: Tensor, time: Tensor, real: Tensor) -> SensorNoise:
    """Do as `pose_noise` does at any times: with third divided differences, scaled so that white noise keeps its size.

    Weights are w_i = 1 / prod_j (t_i - t_j) over the root of their sum of squares.
    """
    windows, since = pose.unfold(1, 4, 1).movedim(-1, 2), time.unfold(1, 4, 1)
    apart = since[..., :, None] - since[..., None, :] + torch.eye(4).to(since)
    inside = real.unfold(1, 4, 1).all(-1)
    weight = 1 / torch.where(inside[..., None], apart.prod(-1), 1.0)
    weight = weight / weight.norm(dim=-1, keepdim=True)
    turn = logarithm(multiply(conjugate(windows[:, :, :1, :, 3:].expand_as(windows[..., 3:])), windows[..., 3:]))
    place, turned = (
        torch.einsum("btw,btwni->btni", weight, value)[inside] * GAIN for value in (windows[..., :3], turn)
    )
    return SensorNoise(max(_deviation(place), LEAST.position), max(_deviation(turned), LEAST.rotation))


def weighed_by(noise: SensorNoise) -> PoseLoss:
    """Return the loss in which a deviation of a rotation counts as much as one of a position."""
    ratio = min(max(noise.position / noise.rotation, 1 / MOST_UNEQUAL), MOST_UNEQUAL)
    return PoseLoss(rotation_weight=ratio**2)


def _deviation(difference: Tensor) -> float:
    """Return the deviation of what was differenced, the largest over the axes (one axis may be still)."""
    return float(difference.abs().flatten(0, 1).median(0).values.max()) / MEDIAN / GAIN if len(difference) else 0.0
