"""Frames at which small errors grow fast: impacts, jolts, contact between bodies, tumbling on an edge."""

from __future__ import annotations

import torch
from torch import Tensor

from physid.diagnosis.inputs.motion_phases import PHASES
from physid.estimation.measurement.poses import pose_difference
from physid.estimation.measurement.sensor_noise import Noise
from physid.physics.rotations import to_matrix
from physid.scenes.scene import Scene

TILTED = 0.05  # [rad]
HOT = ("impact", "contact_between_objects")
REACH = 6  # frames before and after, whose velocities are compared
JOLT = 6.0  # [standard deviations] and ...
JOLT_LEAST = (1.5, 0.5)  # [rad/s], [m/s] change of velocity that is one


def find_events(phases: Tensor, pose: Tensor, present: Tensor, noise: Noise, scene: Scene) -> Tensor:
    """Find the frames in which a body hits another, is jolted, or touches the ground other than with a whole face.

    Args:
        phases: Codes of PHASES, shape (R, T, N).
        pose: Poses, shape (R, T, N, 7).
        present: Frames that exist and are not outliers, shape (R, T, N).
        noise: Of the poses.
        scene: The ground.

    Returns:
        Shape (R, T).
    """
    normal = torch.tensor(scene.ground.normal, dtype=pose.dtype)
    along = (normal @ to_matrix(pose[..., 3:])).abs().amax(-1)
    tilted = torch.acos(along.clamp(-1, 1)) > TILTED
    hot = torch.stack([phases == PHASES.index(name) for name in HOT]).any(0)
    flying = phases == PHASES.index("free_fall")
    return (hot | (tilted & ~flying) | find_jolts(pose, present, noise, scene.time_step)).any(-1)


def find_jolts(pose: Tensor, present: Tensor, noise: Noise, time_step: float) -> Tensor:
    """Find sudden changes of velocity in the poses alone, whatever a model says of them.

    Lines through the frames before and after a frame are compared; their slopes differ by chance with a variance of
    24 sigma^2 / (n^3 - n) / h^2 for n frames each.

    Args:
        pose: Shape (R, T, N, 7).
        present: Frames that exist and are not outliers, shape (R, T, N).
        noise: Of the poses.
        time_step: h [s].

    Returns:
        Shape (R, T, N).
    """
    jolted = torch.zeros(pose.shape[:-1], dtype=torch.bool)
    if pose.shape[1] < 2 * REACH:
        return jolted
    step = pose_difference(pose[:, 1:], pose[:, :-1])
    step = step * (present[:, 1:] * present[:, :-1])[..., None]
    path = torch.cat([torch.zeros_like(step[:, :1]), step.cumsum(1)], 1)
    time = torch.arange(REACH, dtype=pose.dtype) - (REACH - 1) / 2
    slope = (path.unfold(1, REACH, 1) @ time) / time.square().sum() / time_step
    change = (slope[:, REACH:] - slope[:, :-REACH]).unflatten(-1, (2, 3)).norm(dim=-1)
    chance = torch.tensor([noise.rotation, noise.position], dtype=pose.dtype) * (24 / (REACH**3 - REACH)) ** 0.5
    limit = (JOLT * chance / time_step).maximum(torch.tensor(JOLT_LEAST, dtype=pose.dtype))
    jolted[:, REACH : REACH + change.shape[1]] = (change > limit).any(-1)
    return jolted
