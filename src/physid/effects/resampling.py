"""Poses between the frames of a trajectory."""

from __future__ import annotations

import torch
from torch import Tensor

from physid.physics.rotations import conjugate, exponential, logarithm, multiply


def at_frames(pose: Tensor, frames: Tensor) -> Tensor:
    """Compute poses at fractions of frames, with constant velocity from frame to frame and beyond both ends.

    Between frames j - 1 and j positions are p_j - s (p_j - p_{j-1}) and attitudes q_j exp(-s ln(q_{j-1}^-1 q_j)) with
    s = j - frame in [0, 1). A whole number gives the pose of that frame, bit by bit.

    Args:
        pose: Poses of at least two frames, shape (B, T, N, 7).
        frames: Where to sample, in frames, shape (1 or B, T).

    Returns:
        Poses of shape (B, T, N, 7), differentiable in both arguments.
    """
    last = pose.shape[1] - 1
    frames = frames.expand(pose.shape[0], -1)
    upper = frames.detach().ceil().clamp(0, last)
    back = (upper - frames)[..., None, None]
    start, end = _pick(pose, (upper - 1).clamp_min(0)), _pick(pose, (upper - 1).clamp_min(0) + 1)
    anchor = _pick(pose, upper)
    step = end[..., :3] - start[..., :3]
    turn = logarithm(multiply(conjugate(start[..., 3:]), end[..., 3:]))
    quaternion = multiply(anchor[..., 3:], exponential(-back * turn))
    return torch.cat([anchor[..., :3] - back * step, quaternion], -1)


def _pick(pose: Tensor, frames: Tensor) -> Tensor:
    """Return the poses of whole frames (B, T)."""
    return pose.gather(1, frames.long()[..., None, None].expand_as(pose))
