"""How far poses lie from others."""

from __future__ import annotations

import torch
from torch import Tensor

from physid.physics.rotations import conjugate, logarithm, multiply


def pose_difference(first: Tensor, second: Tensor) -> Tensor:
    """Compute how far poses (..., 7) lie from others: rotation vector [rad], then position [m], shape (..., 6)."""
    turn = logarithm(multiply(first[..., 3:], conjugate(second[..., 3:])))
    return torch.cat([turn, first[..., :3] - second[..., :3]], -1)
