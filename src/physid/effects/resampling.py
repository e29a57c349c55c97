"""Poses between the frames of a trajectory."""

from __future__ import annotations

import torch
from torch import Tensor

from physid.physics.rotations import conjugate, exponential, logarithm, multiply


def at_times(pose: Tensor, time: Tensor, wanted: Tensor) -> Tensor:
    """Compute poses at other times, with constant velocity from frame to frame and beyond both ends.

    With t_{j-1} < wanted <= t_j positions are p_j - s (p_j - p_{j-1}) and attitudes q_j exp(-s ln(q_{j-1}^-1 q_j)),
    where s = (t_j - wanted) / (t_j - t_{j-1}) is in [0, 1). The time of a frame gives its pose, bit by bit.

    Args:
        pose: Poses of at least two frames, shape (B, T, N, 7).
        time: Times of the frames [s], not decreasing, shape (1 or B, T).
        wanted: Times to sample [s], shape (1 or B, W).

    Returns:
        Poses of shape (B, W, N, 7), differentiable in `pose` and `wanted`.
    """
    batch, last = pose.shape[0], pose.shape[1] - 1
    time, wanted = time.expand(batch, -1).contiguous(), wanted.expand(batch, -1)
    upper = torch.searchsorted(time, wanted.detach().contiguous()).clamp_max(last)
    before = (upper - 1).clamp_min(0)
    step = time.gather(1, before + 1) - time.gather(1, before)
    # Frames that only fill up a shorter trajectory have the time of its last one, and no velocity.
    back = ((time.gather(1, upper) - wanted) / torch.where(step > 0, step, 1.0))[..., None, None]
    start, end, anchor = (_pick(pose, frames) for frames in (before, before + 1, upper))
    turn = logarithm(multiply(conjugate(start[..., 3:]), end[..., 3:]))
    quaternion = multiply(anchor[..., 3:], exponential(-back * turn))
    return torch.cat([anchor[..., :3] - back * (end[..., :3] - start[..., :3]), quaternion], -1)


def _pick(pose: Tensor, frames: Tensor) -> Tensor:
    """Return the poses of whole frames (B, W)."""
    return pose.gather(1, frames[..., None, None].expand(-1, -1, *pose.shape[2:]))
