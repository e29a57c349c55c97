"""Recordings that nothing can be concluded from are refused, with what is wrong and what would be needed."""

from __future__ import annotations

import torch

from physid.diagnosis.inputs.observations import Observations
from physid.diagnosis.settings.inputs import RequirementSettings
from physid.estimation.measurement import NoiseSettings, stray_poses


def require_usable(observations: Observations, settings: RequirementSettings, noise: NoiseSettings) -> None:
    """Refuse observations that cannot be diagnosed.

    Args:
        observations: What was recorded.
        settings: What is required.
        noise: What an outlier is.

    Raises:
        ValueError: If there are too few trajectories or frames, nothing moves, units are evidently wrong, many poses
            are outliers, or forces are missing.
    """
    least, shortest = settings.least_fitted, settings.least_frames
    fitted, frames = int(observations.fitted.sum()), observations.pose.shape[1]
    if fitted < least or frames < shortest:
        raise ValueError(
            f"expected at least {least} trajectories to fit to, of {shortest} frames or more, found "
            f"{fitted} of {frames} frames; record more (24 trajectories of a second each are plenty)"
        )
    _require_units(observations, settings)
    _require_motion(observations, settings)
    _require_order(observations, settings, noise)
    _require_forces(observations, settings)


def _require_order(observations: Observations, settings: RequirementSettings, noise: NoiseSettings) -> None:
    """Refuse poses that jump about."""
    wild = float(stray_poses(observations.pose, observations.present, noise).double().mean())
    position = observations.pose[..., :3]
    bent = (position[:, 1:-1] - (position[:, :-2] + position[:, 2:]) / 2).norm(dim=-1)
    spread = (position - position.mean(1, keepdim=True)).norm(dim=-1).median()
    rough = float(bent.median())
    if wild > settings.most_outliers or rough > max(settings.rough * float(spread), settings.still_position):
        raise ValueError(
            f"expected poses of a motion, found jumps: {100 * wild:.0f} % leave their neighbours further than any "
            f"motion could, half of all by {1000 * rough:.1f} mm or more; check the tracker and the order of the frames"
        )


def _require_units(observations: Observations, settings: RequirementSettings) -> None:
    """Refuse lengths that are evidently not in metres."""
    scene = observations.scene
    position = observations.pose[..., :3]
    normal = torch.tensor(scene.ground.normal, dtype=position.dtype)
    height = float((position @ normal - scene.ground.offset).abs().median())
    speed = float((position[:, 1:] - position[:, :-1]).norm(dim=-1).median()) / scene.time_step
    largest = float(scene.sizes.max())
    if height > settings.farthest * largest or speed > settings.fastest:
        raise ValueError(
            f"expected poses in metres, found bodies of {largest:g} m at {height:.4g} m from the ground, moving at "
            f"{speed:.4g} m/s; are these millimetres? Divide positions by 1000"
        )


def _require_motion(observations: Observations, settings: RequirementSettings) -> None:
    """Refuse recordings in which nothing moves."""
    pose = observations.pose
    turn = 2 * torch.acos((pose[..., 3:] * pose[:, :1, :, 3:]).sum(-1).abs().clamp_max(1)).amax()
    way = (pose[..., :3] - pose[:, :1, :, :3]).norm(dim=-1).amax()
    if float(turn) < settings.still_rotation and float(way) < settings.still_position:
        raise ValueError(
            f"expected moving bodies, found none that goes further than {1000 * float(way):.1f} mm: nothing can be "
            "learned from rest; push harder than friction holds, or start with a velocity"
        )


def _require_forces(observations: Observations, settings: RequirementSettings) -> None:
    """Refuse recordings on level ground in which bodies set off by themselves."""
    scene = observations.scene
    gravity, normal = (torch.tensor(each, dtype=torch.float64) for each in (scene.gravity, scene.ground.normal))
    level = float(torch.linalg.cross(gravity, normal).norm()) < settings.level * float(gravity.norm())
    if bool((observations.timeline.grid.wrench != 0).any()) or not level or len(scene.bodies) > 1:
        return
    way = observations.pose[..., :3] - observations.pose[:, :1, :, :3]
    flat = way - (way @ normal)[..., None] * normal
    height = (observations.pose[:, 0, :, :3] @ normal - scene.ground.offset).amax(-1)
    lying = height < settings.lying * float(scene.sizes.max())
    still = flat[:, : settings.first_frames].norm(dim=-1).amax((1, 2)) < settings.still_position
    moved = flat.norm(dim=-1).amax((1, 2)) > settings.set_off
    if bool((lying & still & moved).any()):
        index = int((lying & still & moved).nonzero()[0, 0])
        raise ValueError(
            f"trajectory {index}: expected the commanded forces, found none, yet a body sets off from rest on level "
            "ground; add the dataset `wrench`"
        )
