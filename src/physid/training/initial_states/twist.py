"""Twists from poses alone, for recordings that carry none."""

from __future__ import annotations

import torch
from torch import Tensor

from physid.physics.rotations import conjugate, logarithm, multiply

WINDOW = 8
"""Frames of a fit: long enough to average the noise of the poses, short against the time between impacts."""


def twist_from_poses(pose: Tensor, length: Tensor, time_step: float, *, window: int = WINDOW) -> Tensor:
    """Estimate the twists with which bodies arrive at their poses.

    Around every frame a parabola p(t) = a + b t + c t^2 is fitted to the positions, and to the rotation vectors from
    that frame's rotation, over three windows: frames before, around, and after. The window that the parabola fits best
    counts (one with an impact inside does not). The engine takes p to p + h v and so arrives with the mean velocity of
    the last step, b - c h.

    Args:
        pose: Shape (B, T, N, 7).
        length: Frames that are real, shape (B,).
        time_step: h [s].
        window: Frames of a window.

    Returns:
        Angular [rad/s] and linear [m/s] velocities, shape (B, T, N, 6).
    """
    frames = pose.shape[1]
    window = min(window, int(length.min()))
    if window < 3:
        raise ValueError(f"twists need at least 3 frames of poses, got a trajectory of {int(length.min())}")
    at = torch.arange(frames, device=pose.device)
    candidates = []
    for lead in (window - 1, window // 2, 0):
        first = torch.minimum((at - lead).clamp_min(0), (length - window)[:, None]).clamp_min(0)
        # Padded frames lie beyond any window; they get some twist, which nobody reads.
        candidates.append(_fit(pose, (at - first).clamp_max(window - 1), window, time_step))
    misfit = torch.stack([fit[1] for fit in candidates])
    best = misfit.argmin(0)[None, ..., None]
    twist = torch.stack([fit[0] for fit in candidates])
    twist = twist.gather(0, best.expand(1, *twist.shape[1:-1], 3))[0]
    return twist.flatten(-2)


def _fit(pose: Tensor, lead: Tensor, window: int, time_step: float) -> tuple[Tensor, Tensor]:
    """Fit parabolas over windows that begin `lead` (B, T) frames before each frame.

    Returns:
        Velocities (B, T, N, 2, 3), angular then linear, and mean squared misfits (B, T, N, 2).
    """
    batch, frames, bodies, _ = pose.shape
    steps = torch.arange(window, device=pose.device)
    index = torch.arange(frames, device=pose.device)[:, None] - lead[..., None] + steps
    seen = pose[torch.arange(batch, device=pose.device)[:, None, None], index]
    turn = logarithm(multiply(seen[..., 3:], conjugate(pose[..., 3:])[:, :, None]))
    motion = torch.stack([turn, seen[..., :3] - pose[:, :, None, :, :3]], -2).flatten(3)
    # Only `window` different bases occur, one for each lead.
    time = (steps - steps[:, None]).to(pose) * time_step
    basis = torch.stack([torch.ones_like(time), time, time**2], -1)
    coefficients = torch.linalg.pinv(basis)[lead] @ motion
    misfit = (basis[lead] @ coefficients - motion).unflatten(-1, (bodies, 2, 3)).square().mean((2, -1))
    velocity = coefficients[:, :, 1] - time_step * coefficients[:, :, 2]
    return velocity.unflatten(-1, (bodies, 2, 3)), misfit
