"""Poses between the frames of a trajectory."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn.functional import pad

from physid.physics.rotations import conjugate, exponential, logarithm, multiply


def at_times(pose: Tensor, time: Tensor, wanted: Tensor) -> Tensor:
    """Compute poses at other times, with constant acceleration from frame to frame, constant velocity beyond both ends.

    With t_{j-1} < wanted <= t_j, h = t_j - t_{j-1} and s = (t_j - wanted) / h in [0, 1) positions are p_j - s (p_j -
    p_{j-1}) - a h^2 s (1 - s) / 2, and attitudes q_j exp(-s r - b h^2 s (1 - s) / 2) with r = ln(q_{j-1}^-1 q_j). The
    accelerations a and b are second divided differences over three frames, those before or those after, whichever are
    smaller (essentially non-oscillatory: Harten et al. 1987): a free flight is exact at any frame rate, and an impact
    bends no frame but those beside it. The time of a frame gives its pose, bit by bit.

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
    anchor, way = _pick(pose, upper), _ways(pose)
    inside = (((upper > 0)[..., None, None]) & (back >= 0)).to(pose.dtype)
    bend = 0.5 * inside * back * (1 - back) * _pick(_bends(way, time), before)
    moved = -back * _pick(way, before) - bend
    quaternion = multiply(anchor[..., 3:], exponential(moved[..., 3:]))
    return torch.cat([anchor[..., :3] + moved[..., :3], quaternion], -1)


def _ways(pose: Tensor) -> Tensor:
    """Return shifts and turns (in the body's axes) from each frame to the next, shape (B, T - 1, N, 6)."""
    start, end = pose[:, :-1], pose[:, 1:]
    turn = logarithm(multiply(conjugate(start[..., 3:]), end[..., 3:]))
    return torch.cat([end[..., :3] - start[..., :3], turn], -1)


def _bends(way: Tensor, time: Tensor) -> Tensor:
    """Return the acceleration from each frame to the next times its step squared, shape (B, T - 1, N, 6).

    Args:
        way: Shifts and turns, shape (B, T - 1, N, 6).
        time: Times of the frames [s], shape (B, T).
    """
    step = time.diff(dim=1)
    known = step > 0
    length = torch.where(known, step, 1.0)
    speed = way / length[..., None, None]
    at_frame = speed.diff(dim=1) / (0.5 * (length[:, 1:] + length[:, :-1]))[..., None, None]
    usable = (known[:, 1:] & known[:, :-1])[..., None, None]
    # Of the frame before each step and of the one after it; there is none at the ends.
    sides = [pad(torch.where(usable, at_frame, 0.0), (0, 0, 0, 0, *ends)) for ends in ((1, 0), (0, 1))]
    there = [pad(usable.expand_as(at_frame), (0, 0, 0, 0, *ends)) for ends in ((1, 0), (0, 1))]
    larger = [_size(side).masked_fill(~ok, torch.inf) for side, ok in zip(sides, there, strict=True)]
    smaller = torch.where(larger[0] <= larger[1], sides[0], sides[1])
    bends: Tensor = smaller * (length**2)[..., None, None]
    return bends


def _size(values: Tensor) -> Tensor:
    """Return the lengths of shifts and of turns (..., 6), each for all its coordinates."""
    halves = values.detach().unflatten(-1, (2, 3)).norm(dim=-1, keepdim=True)
    sizes: Tensor = halves.expand(*halves.shape[:-1], 3).flatten(-2)
    return sizes


def _pick(values: Tensor, places: Tensor) -> Tensor:
    """Return the values (B, T, ...) at some places (B, W)."""
    return values.gather(1, places[..., None, None].expand(-1, -1, *values.shape[2:]))
