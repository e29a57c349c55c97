"""First guesses of unknown initial states, from the initial poses alone."""

from __future__ import annotations

import torch
from torch import Tensor

from physid.physics.rotations import conjugate, exponential, logarithm, multiply
from physid.scenes.lying import lay_down
from physid.scenes.scene import Scene
from physid.training.parameters.trajectories import Trajectories

SPAN = 0.06  # [s] over which a motion is taken to be smooth
FLAT = 0.03  # [rad] a face that leans more than this does not lie on the ground
NEAR = 0.25  # a body lies on the ground if the gap is below this share of its height ...
STEADY = 0.5  # ... and it falls by less than this share of a free fall


def guess(trajectories: Trajectories, scene: Scene) -> tuple[Tensor, Tensor, Tensor]:
    """Fit polynomials to the initial poses.

    A body that lies on the ground is put exactly there and moves in its plane, with a constant acceleration. Others are
    taken to fall freely.

    Args:
        trajectories: Observed poses, B of T frames.
        scene: Sizes, ground, gravity, time step.

    Returns:
        Poses (B, N, 7) and twists (B, N, 6) at the first frame, and which bodies lie on the ground, (B, N).
    """
    frames = min(max(5, round(SPAN / scene.time_step)), trajectories.pose.shape[1])
    pose, real = trajectories.pose[:, :frames], trajectories.real[:, :frames].to(trajectories.pose)
    anchor = pose[:, :1, :, 3:]
    turn = logarithm(multiply(pose[..., 3:], conjugate(anchor.expand_as(pose[..., 3:]))))
    motion = torch.cat([turn, pose[..., :3]], -1)
    last, share = _times(trajectories, frames, scene.time_step)

    normal, gravity = pose.new_tensor(scene.ground.normal), pose.new_tensor(scene.gravity)
    place, speed, bend = _polynomial(motion, real, share, 2)
    laid = lay_down(_compose(place, anchor), scene)
    sunk = ((speed + bend)[..., 3:] @ normal).abs()
    fall = (gravity @ normal).abs() * last[:, None] ** 2 / 2
    lies = (laid.lean < FLAT) & (laid.gap.abs() < NEAR * laid.height) & (sunk < STEADY * fall)
    spin = (speed[..., :3] @ normal)[..., None] * normal
    slide = speed[..., 3:] - (speed[..., 3:] @ normal)[..., None] * normal

    dropped = torch.cat([torch.zeros_like(gravity), gravity / 2]) * (share * last[:, None])[..., None, None] ** 2
    free_place, free_speed, _ = _polynomial(motion - dropped, real, share, 1)
    twist = torch.where(lies[..., None], torch.cat([spin, slide], -1), free_speed) / last[:, None, None]
    return torch.where(lies[..., None], laid.pose, _compose(free_place, anchor)), twist, lies


def _times(trajectories: Trajectories, frames: int, time_step: float) -> tuple[Tensor, Tensor]:
    """Return how long the first frames take [s], (B or 1,), and at which share of that each lies, (B or 1, F)."""
    if trajectories.time is None:
        count = torch.arange(frames).to(trajectories.pose)[None]
        return count.new_full((1,), (frames - 1) * time_step), count / (frames - 1)
    time = trajectories.time[:, :frames] - trajectories.time[:, :1]
    last = time[:, -1].clamp_min(torch.finfo(time.dtype).eps)
    return last, time / last[:, None]


def _compose(motion: Tensor, anchor: Tensor) -> Tensor:
    """Return poses from rotation vectors relative to attitudes (B, 1, N, 4), and positions; motion is (B, N, 6)."""
    return torch.cat([motion[..., 3:], multiply(exponential(motion[..., :3]), anchor[:, 0])], -1)


def _polynomial(value: Tensor, real: Tensor, share: Tensor, degree: int) -> tuple[Tensor, Tensor, Tensor]:
    """Fit a + b s + c s^2 to (B, F, N, 6) over shares s (B or 1, F) of the time; returns a, b, c, each (B, N, 6)."""
    basis = torch.stack([share**power for power in range(degree + 1)], -1).expand(len(value), -1, -1)
    gram = torch.einsum("bt,bti,btj->bij", real, basis, basis) + 1e-9 * torch.eye(degree + 1).to(share)
    wanted = torch.einsum("bt,bti,btnk->bink", real, basis, value)
    found = torch.linalg.solve(gram, wanted.flatten(2)).unflatten(2, value.shape[2:])
    bend = found[:, 2] if degree == 2 else torch.zeros_like(found[:, 0])
    return found[:, 0], found[:, 1], bend
