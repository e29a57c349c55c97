"""Frames at which small errors grow fast: impacts, jolts, contact between bodies, tumbling on an edge."""

from __future__ import annotations

import torch
from torch import Tensor

from physid.diagnosis.inputs.motion_phases import PHASES
from physid.diagnosis.settings.inputs import EventSettings
from physid.estimation.measurement import Noise, pose_difference
from physid.physics.rotations import to_matrix
from physid.scenes.scene import Scene

HOT = ("impact", "contact_between_objects")


def find_events(
    phases: Tensor, pose: Tensor, present: Tensor, noise: Noise, scene: Scene, settings: EventSettings
) -> Tensor:
    """Find the frames in which a body hits another, is jolted, or touches the ground other than with a whole face.

    Args:
        phases: Codes of PHASES, shape (R, T, N).
        pose: Poses, shape (R, T, N, 7).
        present: Frames that exist and are not outliers, shape (R, T, N).
        noise: Of the poses.
        scene: The ground.
        settings: What tilts and what jolts.

    Returns:
        Shape (R, T).
    """
    normal = torch.tensor(scene.ground.normal, dtype=pose.dtype)
    along = (normal @ to_matrix(pose[..., 3:])).abs().amax(-1)
    tilted = torch.acos(along.clamp(-1, 1)) > settings.tilted
    hot = torch.stack([phases == PHASES.index(name) for name in HOT]).any(0)
    flying = phases == PHASES.index("free_fall")
    return (hot | (tilted & ~flying) | find_jolts(pose, present, noise, scene.time_step, settings)).any(-1)


def find_jolts(pose: Tensor, present: Tensor, noise: Noise, time_step: float, settings: EventSettings) -> Tensor:
    """Find sudden changes of velocity in the poses alone, whatever a model says of them.

    Lines through the frames before and after a frame are compared; their slopes differ by chance with a variance of
    24 sigma^2 / (n^3 - n) / h^2 for n frames each.

    Args:
        pose: Shape (R, T, N, 7).
        present: Frames that exist and are not outliers, shape (R, T, N).
        noise: Of the poses.
        time_step: h [s].
        settings: What a jolt is.

    Returns:
        Shape (R, T, N).
    """
    reach, least = settings.reach, (settings.jolt_spin, settings.jolt_speed)
    jolted = torch.zeros(pose.shape[:-1], dtype=torch.bool)
    if pose.shape[1] < 2 * reach:
        return jolted
    step = pose_difference(pose[:, 1:], pose[:, :-1])
    step = step * (present[:, 1:] * present[:, :-1])[..., None]
    path = torch.cat([torch.zeros_like(step[:, :1]), step.cumsum(1)], 1)
    time = torch.arange(reach, dtype=pose.dtype) - (reach - 1) / 2
    slope = (path.unfold(1, reach, 1) @ time) / time.square().sum() / time_step
    change = (slope[:, reach:] - slope[:, :-reach]).unflatten(-1, (2, 3)).norm(dim=-1)
    chance = torch.tensor([noise.rotation, noise.position], dtype=pose.dtype) * (24 / (reach**3 - reach)) ** 0.5
    limit = (settings.jolt * chance / time_step).maximum(torch.tensor(least, dtype=pose.dtype))
    jolted[:, reach : reach + change.shape[1]] = (change > limit).any(-1)
    return jolted
