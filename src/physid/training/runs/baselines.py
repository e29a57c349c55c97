"""What to beat: other predictions of the same trajectories from the same initial states."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from physid.physics.rotations import exponential, multiply, rotate
from physid.scenes import Excitation, Scene
from physid.simulators import find_simulator
from physid.training.parameters import Trajectories

FINE = 1 / 960  # [s]


def held(trajectories: Trajectories) -> Tensor:
    """Predict that nothing moves: the initial pose at all times, (B, T, N, 7)."""
    return trajectories.pose[:, :1].expand_as(trajectories.pose)


def fine_substeps(scene: Scene) -> int:
    """Return as many steps per frame as PyBullet takes where nothing is to be shared with the maker's steps."""
    return max(1, round(scene.time_step / FINE))


def ballistic(trajectories: Trajectories, scene: Scene, step: float | None = None) -> Tensor:
    """Predict free flight with constant spin, frozen at touch-down.

    Args:
        trajectories: Gives the initial states and the frames to predict.
        scene: Gives gravity, the ground, the time step and the sizes.
        step: Over which recorded velocities are mean ones [s]; 0 for those of the instant, None for the time
            step.

    Returns:
        Poses, shape (B, T, N, 7); a body stays where its lowest corner first reaches the ground.
    """
    pose, twist = trajectories.pose[:, :1], trajectories.twist[:, :1]
    if trajectories.time is None:
        time = scene.time_step * torch.arange(trajectories.pose.shape[1]).to(pose)[None, :, None, None]
    else:
        time = (trajectories.time - trajectories.time[:, :1])[..., None, None]
    step = scene.time_step if step is None else step
    fall = 0.5 * time * (time + step) * pose.new_tensor(scene.gravity)
    position = pose[..., :3] + time * twist[..., 3:] + fall
    frames = time.shape[1]
    turned = multiply(exponential(time * twist[..., :3]), pose[..., 3:].expand(-1, frames, -1, -1))
    flight = torch.cat([position, turned], -1)
    down = _lowest(flight, scene) <= scene.ground.offset
    last = torch.where(down.any(1), down.int().argmax(1), frames - 1)
    frame = torch.arange(frames, device=pose.device)[None, :, None].minimum(last[:, None])
    return flight.gather(1, frame[..., None].expand_as(flight))


def bullet(trajectories: Trajectories, scene: Scene, substeps: int) -> Tensor:
    """Predict with PyBullet.

    Args:
        trajectories: Gives the initial states and the wrenches.
        scene: Gives the parameters.
        substeps: Steps of PyBullet per frame.

    Returns:
        Poses, shape (B, T, N, 7).
    """
    initial = zip(
        trajectories.pose[:, 0].cpu().numpy(),
        trajectories.twist[:, 0].cpu().numpy(),
        trajectories.wrench.cpu().numpy(),
        strict=True,
    )
    excitations = [Excitation(pose, twist, wrench) for pose, twist, wrench in initial]
    motions = [motion.pose for motion in find_simulator("pybullet").simulate(scene, excitations, substeps=substeps)]
    return torch.from_numpy(np.stack(motions)).to(trajectories.pose)


def _lowest(pose: Tensor, scene: Scene) -> Tensor:
    """Return the lowest height of each body's corners along the ground's normal [m], shape (B, T, N)."""
    normal = pose.new_tensor(scene.ground.normal)
    half = 0.5 * torch.from_numpy(scene.sizes).to(pose)
    axes = torch.eye(3).to(pose)
    reach = [
        half[:, axis] * (rotate(pose[..., 3:], axes[axis].expand_as(pose[..., :3])) @ normal).abs() for axis in range(3)
    ]
    return pose[..., :3] @ normal - torch.stack(reach).sum(0)
