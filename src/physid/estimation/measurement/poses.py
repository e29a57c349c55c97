"""How far poses lie from others."""

from __future__ import annotations

import torch
from torch import Tensor

from physid.physics.rotations import conjugate, exponential, logarithm, multiply


def pose_difference(first: Tensor, second: Tensor) -> Tensor:
    """Compute how far poses (..., 7) lie from others: rotation vector [rad], then position [m], shape (..., 6)."""
    turn = logarithm(multiply(first[..., 3:], conjugate(second[..., 3:])))
    return torch.cat([turn, first[..., :3] - second[..., :3]], -1)


def moved(pose: Tensor, change: Tensor) -> Tensor:
    """Turn and shift poses (..., 7) by rotation vectors [rad] and positions [m], (..., 6); undoes `pose_difference`."""
    return torch.cat([pose[..., :3] + change[..., 3:], multiply(exponential(change[..., :3]), pose[..., 3:])], -1)
