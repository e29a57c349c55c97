"""Twists from poses alone, for recordings that carry none."""

from __future__ import annotations

import torch
from torch import Tensor

from physid.physics.rotations import conjugate, logarithm, multiply

SHORTEST_WINDOW = 1e-6  # [s] padded frames have one time
WINDOW = 8
"""Frames of a fit: long enough to average the noise of the poses, short against the time between impacts."""


def twist_from_poses(
    pose: Tensor,
    length: Tensor,
    time_step: float,
    *,
    window: int = WINDOW,
    time: Tensor | None = None,
    seen: Tensor | None = None,
    arrival: float | None = None,
) -> Tensor:
    """Estimate the twists with which bodies arrive at their poses.

    Around every frame a parabola p(t) = a + b t + c t^2 is fitted to the positions, and to the rotation vectors from
    that frame's rotation, over three windows: frames before, around, and after. The window that the parabola fits best
    counts (one with an impact inside does not). A semi-implicit engine takes p to p + h v and so arrives with the mean
    velocity of the last step, b - c h; the velocity of that instant, which `Midpoint` goes by, is b.

    Args:
        pose: Shape (B, T, N, 7).
        length: Frames that are real, shape (B,).
        time_step: Time between frames [s].
        window: Frames of a window.
        time: Times of the frames [s], shape (B, T); None for frames one time step apart.
        seen: Frames that count, shape (B, T); None for all.
        arrival: h [s], 0 for the velocity of that instant; None for `time_step`.

    Returns:
        Angular [rad/s] and linear [m/s] velocities, shape (B, T, N, 6).

    Raises:
        ValueError: If a trajectory has fewer than 3 frames.
    """
    frames = pose.shape[1]
    window = min(window, int(length.min()))
    if window < 3:
        raise ValueError(
            f"expected at least 3 frames of poses, from which velocities follow, found a trajectory of "
            f"{int(length.min())}; leave it out"
        )
    step = time_step if arrival is None else arrival
    at = torch.arange(frames, device=pose.device)
    candidates = []
    for lead in (window - 1, window // 2, 0):
        first = torch.minimum((at - lead).clamp_min(0), (length - window)[:, None]).clamp_min(0)
        # Padded frames lie beyond any window; they get some twist, which nobody reads.
        back = (at - first).clamp_max(window - 1)
        if time is None:
            candidates.append(_fit(pose, back, window, time_step, step))
        else:
            candidates.append(_fit_uneven(pose, time, seen, back, window, step))
    misfit = torch.stack([fit[1] for fit in candidates])
    best = misfit.argmin(0)[None, ..., None]
    twist = torch.stack([fit[0] for fit in candidates])
    twist = twist.gather(0, best.expand(1, *twist.shape[1:-1], 3))[0]
    return twist.flatten(-2)


def _motion(pose: Tensor, lead: Tensor, window: int) -> tuple[Tensor, Tensor]:
    """Return the motion (B, T, window, 6 N) over windows that begin `lead` (B, T) frames before each, and the frames.

    Rotation vectors from each frame's rotation and shifts from its place, of each body; frames (B, T, window).
    """
    batch, frames = pose.shape[:2]
    steps = torch.arange(window, device=pose.device)
    index = torch.arange(frames, device=pose.device)[:, None] - lead[..., None] + steps
    seen = pose[torch.arange(batch, device=pose.device)[:, None, None], index]
    turn = logarithm(multiply(seen[..., 3:], conjugate(pose[..., 3:])[:, :, None]))
    return torch.stack([turn, seen[..., :3] - pose[:, :, None, :, :3]], -2).flatten(3), index


def _fit(pose: Tensor, lead: Tensor, window: int, time_step: float, step: float) -> tuple[Tensor, Tensor]:
    """Fit parabolas over windows of even frames that begin `lead` (B, T) frames before each frame.

    Returns:
        Velocities (B, T, N, 2, 3), angular then linear, and mean squared misfits (B, T, N, 2).
    """
    bodies, steps = pose.shape[2], torch.arange(window, device=pose.device)
    motion, _ = _motion(pose, lead, window)
    # Only `window` different bases occur, one for each lead.
    time = (steps - steps[:, None]).to(pose) * time_step
    basis = torch.stack([torch.ones_like(time), time, time**2], -1)
    coefficients = torch.linalg.pinv(basis)[lead] @ motion
    misfit = (basis[lead] @ coefficients - motion).unflatten(-1, (bodies, 2, 3)).square().mean((2, -1))
    velocity = coefficients[:, :, 1] - step * coefficients[:, :, 2]
    return velocity.unflatten(-1, (bodies, 2, 3)), misfit


def _fit_uneven(
    pose: Tensor, time: Tensor, seen: Tensor | None, lead: Tensor, window: int, step: float
) -> tuple[Tensor, Tensor]:
    """Do as `_fit` does with frames at any times, of which only those that were seen count."""
    bodies, rows = pose.shape[2], torch.arange(len(pose), device=pose.device)[:, None, None]
    motion, index = _motion(pose, lead, window)
    since = time[rows, index] - time[..., None]
    weight = torch.ones_like(since) if seen is None else seen[rows, index].to(pose)
    span = since.abs().amax(-1, keepdim=True).clamp_min(SHORTEST_WINDOW)
    share = since / span
    basis = torch.stack([torch.ones_like(share), share, share**2], -1) * weight[..., None]
    motion = motion * weight[..., None]
    coefficients = torch.linalg.pinv(basis) @ motion
    misfit = (basis @ coefficients - motion).unflatten(-1, (bodies, 2, 3)).square().sum(2).mean(-1)
    few = weight.sum(-1)
    # A parabola through three poses fits them always; it is worse than any that was tested by a fourth.
    misfit = torch.where((few > 3)[..., None, None], misfit / few[..., None, None].clamp_min(1), torch.inf)
    velocity = coefficients[:, :, 1] / span - step * coefficients[:, :, 2] / span**2
    return velocity.unflatten(-1, (bodies, 2, 3)), misfit
