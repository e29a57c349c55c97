"""Recordings that nothing can be concluded from are refused, with what is wrong and what would be needed."""

from __future__ import annotations

import torch

from physid.diagnosis.inputs.observations import Observations
from physid.estimation.measurement.sensor_noise import outlier_poses

LEAST_FITTED = 3  # trajectories: fewer leave no scatter from which an interval could come
LEAST_FRAMES = 12
STILL = (0.02, 0.005)  # [rad], [m] motion below which nothing moves
FASTEST = 100.0  # [m/s] beyond this it is the unit that is wrong
FARTHEST = 100.0  # times the largest edge: so far from the ground nothing is thrown
TOO_WILD = 0.1  # share of outliers that no robust fit survives
ROUGH = 0.2  # share of the whole motion by which poses may leave the middle of their neighbours
STARTS, WAY = 5, 0.02  # first frames and [m]: who lies still in these and has gone so far was pushed


def require_usable(observations: Observations) -> None:
    """Refuse observations that cannot be diagnosed.

    Raises:
        ValueError: If there are too few trajectories or frames, nothing moves, units are evidently wrong, many poses
            are outliers, or forces are missing.
    """
    fitted, frames = int(observations.fitted.sum()), observations.pose.shape[1]
    if fitted < LEAST_FITTED or frames < LEAST_FRAMES:
        raise ValueError(
            f"expected at least {LEAST_FITTED} trajectories to fit to, of {LEAST_FRAMES} frames or more, found "
            f"{fitted} of {frames} frames; record more (24 trajectories of a second each are plenty)"
        )
    _require_units(observations)
    _require_motion(observations)
    _require_order(observations)
    _require_forces(observations)


def _require_order(observations: Observations) -> None:
    """Refuse poses that jump about."""
    wild = float(outlier_poses(observations.pose, observations.present).double().mean())
    position = observations.pose[..., :3]
    bent = (position[:, 1:-1] - (position[:, :-2] + position[:, 2:]) / 2).norm(dim=-1)
    spread = (position - position.mean(1, keepdim=True)).norm(dim=-1).median()
    rough = float(bent.median())
    if wild > TOO_WILD or rough > max(ROUGH * float(spread), STILL[1]):
        raise ValueError(
            f"expected poses of a motion, found jumps: {100 * wild:.0f} % leave their neighbours further than any "
            f"motion could, half of all by {1000 * rough:.1f} mm or more; check the tracker and the order of the frames"
        )


def _require_units(observations: Observations) -> None:
    """Refuse lengths that are evidently not in metres."""
    scene = observations.scene
    position = observations.pose[..., :3]
    normal = torch.tensor(scene.ground.normal, dtype=position.dtype)
    height = float((position @ normal - scene.ground.offset).abs().median())
    speed = float((position[:, 1:] - position[:, :-1]).norm(dim=-1).median()) / scene.time_step
    largest = float(scene.sizes.max())
    if height > FARTHEST * largest or speed > FASTEST:
        raise ValueError(
            f"expected poses in metres, found bodies of {largest:g} m at {height:.4g} m from the ground, moving at "
            f"{speed:.4g} m/s; are these millimetres? Divide positions by 1000"
        )


def _require_motion(observations: Observations) -> None:
    """Refuse recordings in which nothing moves."""
    pose = observations.pose
    turn = 2 * torch.acos((pose[..., 3:] * pose[:, :1, :, 3:]).sum(-1).abs().clamp_max(1)).amax()
    way = (pose[..., :3] - pose[:, :1, :, :3]).norm(dim=-1).amax()
    if float(turn) < STILL[0] and float(way) < STILL[1]:
        raise ValueError(
            f"expected moving bodies, found none that goes further than {1000 * float(way):.1f} mm: nothing can be "
            "learned from rest; push harder than friction holds, or start with a velocity"
        )


def _require_forces(observations: Observations) -> None:
    """Refuse recordings on level ground in which bodies set off by themselves."""
    scene = observations.scene
    gravity, normal = (torch.tensor(each, dtype=torch.float64) for each in (scene.gravity, scene.ground.normal))
    level = float(torch.linalg.cross(gravity, normal).norm()) < 1e-3 * float(gravity.norm())
    if bool((observations.timeline.grid.wrench != 0).any()) or not level or len(scene.bodies) > 1:
        return
    way = observations.pose[..., :3] - observations.pose[:, :1, :, :3]
    flat = way - (way @ normal)[..., None] * normal
    height = (observations.pose[:, 0, :, :3] @ normal - scene.ground.offset).amax(-1)
    lying = height < 0.75 * float(scene.sizes.max())
    still = flat[:, : 2 * STARTS].norm(dim=-1).amax((1, 2)) < STILL[1]
    moved = flat.norm(dim=-1).amax((1, 2)) > WAY
    if bool((lying & still & moved).any()):
        index = int((lying & still & moved).nonzero()[0, 0])
        raise ValueError(
            f"trajectory {index}: expected the commanded forces, found none, yet a body sets off from rest on level "
            "ground; add the dataset `wrench`"
        )
