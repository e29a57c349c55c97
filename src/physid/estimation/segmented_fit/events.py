"""Frames at which small errors grow fast: impacts, jolts, contact between bodies, tumbling on an edge."""

from __future__ import annotations

import torch
from torch import Tensor

from physid.estimation.measurement import Noise, pose_difference
from physid.estimation.prediction import Segmentation
from physid.estimation.segmented_fit.motion_phases import PHASES
from physid.estimation.segmented_fit.settings import EventSettings
from physid.physics.rotations import to_matrix
from physid.scenes import Scene

HOT = ("impact", "contact_between_objects")


def find_events(
    phases: Tensor,
    pose: Tensor,
    present: Tensor,
    time: Tensor,
    smooth: Tensor,
    noise: Noise,
    scene: Scene,
    settings: EventSettings,
) -> Tensor:
    """Find the frames in which a body strikes another, is jolted, or touches the ground other than with a whole face.

    Args:
        phases: Codes of PHASES, shape (R, T, N).
        pose: Poses, shape (R, T, N, 7).
        present: Frames that exist and are not outliers, shape (R, T, N).
        time: Of the frames [s], shape (R, T).
        smooth: What the model's accelerations move, shape (R, T, N, 6); see `smooth_path`.
        noise: Of the poses.
        scene: The ground.
        settings: What tilts and what jolts.

    Returns:
        Shape (R, T).
    """
    jolts = find_jolts(pose, present, time, smooth, noise, scene.time_step, settings)
    tumbling = find_tumbling(phases, pose, scene, settings) & (present > 0)
    return (_hot(phases) | tumbling | jolts).any(-1)


def find_tumbling(phases: Tensor, pose: Tensor, scene: Scene, settings: EventSettings) -> Tensor:
    """Find where a body touches the ground other than with a whole face, shape (R, T, N).

    Args:
        phases: Codes of PHASES, shape (R, T, N).
        pose: Poses, shape (R, T, N, 7).
        scene: The ground.
        settings: From which lean on a body touches with an edge.
    """
    normal = torch.tensor(scene.ground.normal, dtype=pose.dtype)
    along = (normal @ to_matrix(pose[..., 3:])).abs().amax(-1)
    tilted = torch.acos(along.clamp(-1, 1)) > settings.tilted
    return tilted & (phases != PHASES.index("free_fall"))


def _hot(phases: Tensor) -> Tensor:
    """Return where the model predicts an impact or a contact between bodies, shape (R, T, N)."""
    return torch.stack([phases == PHASES.index(name) for name in HOT]).any(0)


def smooth_path(twist: Tensor, phases: Tensor, time: Tensor, segments: Segmentation) -> Tensor:
    """Integrate a model's accelerations twice, without what it does in impacts and where segments start anew.

    What gravity, commands and friction change of a velocity is no jolt, however slow the camera.

    Args:
        twist: Predicted, shape (R, T, N, 6).
        phases: Codes of PHASES, shape (R, T, N).
        time: Of the frames [s], shape (R, T).
        segments: That the prediction was made in.

    Returns:
        Shape (R, T, N, 6), from rest; rotations as integrals of the spin.
    """
    length = time.diff(dim=1)[..., None, None].clamp_min(1e-9)
    acceleration = twist.diff(dim=1) / length
    known = ~_hot(phases)[:, :-1] & (segments.position[:, 1:, None] > 0)
    # A step that says nothing continues the last one that does, or the first.
    steps = torch.arange(known.shape[1])[None, :, None].expand_as(known)
    last = torch.where(known, steps, -1).cummax(1).values
    first = torch.where(known, steps, known.shape[1]).amin(1, keepdim=True).clamp_max(known.shape[1] - 1)
    index = torch.where(last < 0, first, last)[..., None].expand_as(acceleration)
    acceleration = acceleration.gather(1, index) * known.any(1, keepdim=True)[..., None]
    zero = torch.zeros_like(twist[:, :1])
    velocity = torch.cat([zero, (acceleration * length).cumsum(1)], 1)
    moved = (velocity[:, :-1] + velocity[:, 1:]) / 2 * length
    return torch.cat([zero, moved.cumsum(1)], 1)


def find_jolts(
    pose: Tensor,
    present: Tensor,
    time: Tensor,
    smooth: Tensor,
    noise: Noise,
    time_step: float,
    settings: EventSettings,
) -> Tensor:
    """Find sudden changes of velocity that no acceleration of the model explains.

    Lines through the frames before and after a frame are compared; their slopes differ by chance with a variance of
    sigma^2 / S each, S the sum of the squared distances of their times from their mean.

    Args:
        pose: Shape (R, T, N, 7).
        present: Frames that exist and are not outliers, shape (R, T, N).
        time: Of the frames [s], shape (R, T).
        smooth: What is taken off the motion, shape (R, T, N, 6).
        noise: Of the poses.
        time_step: Usual time between frames [s].
        settings: What a jolt is.

    Returns:
        Shape (R, T, N).
    """
    reach = max(settings.fewest, round(settings.reach / time_step))
    jolted = torch.zeros(pose.shape[:-1], dtype=torch.bool)
    if pose.shape[1] < 2 * reach:
        return jolted
    frames = torch.arange(pose.shape[1])[None, :, None].expand(present.shape)
    last = torch.where(present > 0, frames, 0).cummax(1).values[..., None].expand_as(pose)
    filled = pose.gather(1, last)
    step = pose_difference(filled[:, 1:], filled[:, :-1])
    path = torch.cat([torch.zeros_like(step[:, :1]), step.cumsum(1)], 1) - smooth
    weight = present.to(path).unfold(1, reach, 1)[..., None, :]
    moment = time.unfold(1, reach, 1)[:, :, None, None]
    total = weight.sum(-1, keepdim=True).clamp_min(1)
    moment = moment - (weight * moment).sum(-1, keepdim=True) / total
    square = (weight * moment.square()).sum(-1)
    slope = (weight * moment * path.unfold(1, reach, 1)).sum(-1) / square.clamp_min(1e-30)
    change = (slope[:, reach:] - slope[:, :-reach]).unflatten(-1, (2, 3)).norm(dim=-1)
    variance = 1 / square  # infinite where fewer than two frames are left
    chance = (variance[:, reach:] + variance[:, :-reach]).sqrt()
    level = torch.tensor([noise.rotation, noise.position], dtype=pose.dtype)
    least = torch.tensor([settings.jolt_spin, settings.jolt_speed], dtype=pose.dtype)
    limit = (settings.jolt * level * chance).maximum(least)
    jolted[:, reach : reach + change.shape[1]] = (change > limit).any(-1)
    return jolted
