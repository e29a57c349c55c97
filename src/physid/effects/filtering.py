"""What a linear filter in time makes of poses."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from physid.physics.rotations import conjugate, exponential, logarithm, multiply

PASSES = 4
"""How often a smoothing averages; the more, the nearer to a Gaussian bell (excess kurtosis 3 / PASSES)."""

Change = Callable[[Tensor], Tensor]
"""From values at the frames (B, T, K) to what a filter adds to them."""


def filtered(pose: Tensor, change: Change) -> Tensor:
    """Filter the coordinates of poses: positions and quaternions, which have unit length afterwards.

    Args:
        pose: Poses, shape (B, T, N, 7).
        change: What the filter adds to coordinates; where that is zero, a pose keeps every bit.

    Returns:
        Poses of the same shape.
    """
    position, quaternion = pose[..., :3], pose[..., 3:]
    # q and -q are one attitude; a filter adds up what are neighbours.
    flips = (quaternion[:, 1:] * quaternion[:, :-1]).sum(-1, keepdim=True).detach() < 0
    sign = torch.cat([torch.ones_like(quaternion[:, :1, :, :1]), 1.0 - 2.0 * flips], 1).cumprod(1)
    added = change(torch.cat([position, sign * quaternion], -1).flatten(2)).unflatten(2, pose.shape[2:])
    turn = multiply(conjugate(quaternion), sign * added[..., 3:]) + quaternion.new_tensor([0.0, 0.0, 0.0, 1.0])
    turned = multiply(quaternion, exponential(logarithm(turn / turn.norm(dim=-1, keepdim=True))))
    return torch.cat([position + added[..., :3], turned], -1)


def lag(values: Tensor, time: Tensor, constant: Tensor) -> Tensor:
    """Compute what exponential smoothing adds to values: d = y - x, where y_k = y_{k-1} + a_k (x_k - y_{k-1}).

    With a_k = h_k / (h_k + tau) a steady motion is tau late: d_k = (1 - a_k) (d_{k-1} - (x_k - x_{k-1})). Before the
    first frame values went on as in the first step, d_0 = -tau (x_1 - x_0) / h_1; so they begin anew at a frame that
    has the time of the one before.

    Args:
        values: x, shape (B, T, K).
        time: Times of the frames [s], not decreasing, shape (1 or B, T).
        constant: tau [s], shape (1 or B,).

    Returns:
        d, shape (B, T, K); its derivative by tau at 0 is minus the slope.
    """
    if values.shape[1] < 2:
        return torch.zeros_like(values)
    step, constant, way = time.diff(dim=1), constant[:, None], values.diff(dim=1)
    goes_on = step > 0
    length = torch.where(goes_on, step, 1.0)
    kept = (constant / (length + constant))[..., None]
    anew = torch.nn.functional.pad(torch.where(goes_on, -constant / length, 0.0)[..., None] * way, (0, 0, 0, 1))
    behind = [anew[:, 0]]
    for k, moved in enumerate(way.unbind(1)):
        behind.append(torch.where(goes_on[:, k, None], kept[:, k] * (behind[-1] - moved), anew[:, k + 1]))
    return torch.stack(behind, 1)


def smoothing(values: Tensor, time: Tensor, variance: Tensor) -> Tensor:
    """Compute what a smoothing adds to values: y - x, where (1 - (s / 2n) d^2/dt^2)^n y = x with n = `PASSES`.

    That is the mean of x under a symmetric bell of variance s. Second derivatives are divided differences of three
    frames, and none at the ends and beside frames of equal times.

    Args:
        values: x, shape (B, T, K).
        time: Times of the frames [s], not decreasing, shape (1 or B, T); no mean reaches across frames of equal times.
        variance: s [s^2], shape (1 or B,).

    Returns:
        y - x, shape (B, T, K); its derivative by s at 0 is half the second derivative of x.
    """
    if values.shape[1] < 3:
        return torch.zeros_like(values)
    step = time.diff(dim=1)
    known = (step[:, 1:] > 0) & (step[:, :-1] > 0)
    before, after = (torch.where(known, each, 1.0) for each in (step[:, :-1], step[:, 1:]))
    weight = torch.where(known, variance[:, None] / PASSES / (before + after), 0.0)
    lower, upper = (torch.nn.functional.pad(weight / each, (1, 1))[..., None] for each in (before, after))

    def bend(x: Tensor) -> Tensor:
        """Return s / 2n times the second derivative."""
        way = torch.nn.functional.pad(x.diff(dim=1), (0, 0, 1, 1))
        return upper * way[:, 1:] - lower * way[:, :-1]

    pivots, shares = _eliminated(lower, upper)
    added = torch.zeros_like(values)
    for _ in range(PASSES):
        added = added + _solved(bend(values + added), lower, pivots, shares)
    return added


def _eliminated(lower: Tensor, upper: Tensor) -> tuple[list[Tensor], list[Tensor]]:
    """Eliminate below the diagonal of 1 + lower + upper with -lower and -upper beside it (Thomas 1949)."""
    pivots: list[Tensor] = []
    shares: list[Tensor] = []
    for left, right in zip(lower.unbind(1), upper.unbind(1), strict=True):
        pivots.append(1 + right + (left * (1 - shares[-1]) if shares else left))
        shares.append(right / pivots[-1])
    return pivots, shares


def _solved(value: Tensor, lower: Tensor, pivots: list[Tensor], shares: list[Tensor]) -> Tensor:
    """Solve for one right-hand side (B, T, K), see `_eliminated`."""
    forward: list[Tensor] = []
    for right, left, pivot in zip(value.unbind(1), lower.unbind(1), pivots, strict=True):
        forward.append((right + left * forward[-1] if forward else right) / pivot)
    backward = [forward[-1]]
    for reached, share in zip(forward[-2::-1], shares[-2::-1], strict=True):
        backward.append(reached + share * backward[-1])
    return torch.stack(backward[::-1], 1)
