"""In which phases of a motion an effect acts, by the exact motion alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from physid.benchmark.sealing.replay import Look, look_at, steady
from physid.data.generation.settings import GenerateConfig
from physid.physics import Effect
from physid.scenes import Excitation, Scene
from physid.scenes.rotations import rotate
from physid.simulators import Motion

Array = NDArray[np.float64]
SHARE = 0.2  # part of an effect's work that a phase must hold to be named
NOTHING = 1e-12  # [J] the engine's rounding
FLYING = 2e-3  # [m] distance from the ground
HARD = 3.0  # change of the speed along the normal within a step, over that of free fall, from which on it is an impact
NEAR = 3e-3  # [m] between two bodies that push each other
STILL, SLOW, STILL_SPIN = 0.01, 0.3, 0.05  # [m/s], [m/s], [rad/s]
SWITCH, SWITCH_TIME, RARE = 0.3, 0.02, 0.2
"""A change of a command by more than this share of the largest is a switch, for so long [s]; where more than this share
of all frames were switches, none is."""


def acting_phases(config: GenerateConfig, effects: Sequence[Effect]) -> list[str]:
    """Name the phases in which effects change the motion.

    From every true state of the fitted trajectories the effect-free simulator goes to the next frame; what the
    velocities differ by, as kinetic energy of that difference, is summed by phase. Phases that hold at least a fifth
    are named.

    Args:
        config: The recording set.
        effects: What is hidden in it.

    Returns:
        Names of phases, the strongest first; none for effects that only change what is seen.
    """
    work: dict[str, float] = {}
    config = steady(config)
    scene = config.true_scene()
    for index in (index for index, split in enumerate(config.splits()) if split == "fit"):
        look = look_at(config, index, effects)
        names = phases(scene, look.excitation, look.motion).ravel().tolist()
        for name, value in zip(names, _change(scene, look).flat, strict=True):
            work[name] = work.get(name, 0.0) + float(value)
    total = sum(work.values())
    strongest = sorted(work, key=lambda name: -work[name])
    return [name for name in strongest if total > NOTHING and work[name] >= SHARE * total]


def _change(scene: Scene, look: Look) -> Array:
    """Return the kinetic energy of what one effect-free step misses [J], shape (T - 1, N)."""
    mass = np.array([body.mass for body in scene.bodies])
    moment = np.array([body.moments().mean() for body in scene.bodies])
    square = np.square(look.motion.twist[1:] - np.array([motion.twist[1] for motion in look.steps(scene)]))
    energy: Array = (moment * square[..., :3].sum(-1) + mass * square[..., 3:].sum(-1)) / 2
    return energy


def phases(scene: Scene, excitation: Excitation, motion: Motion) -> NDArray[np.str_]:
    """Name what each body does at each frame but the last, by the diagnosis' words; shape (T - 1, N)."""
    wrench = excitation.wrench[:-1]
    normal, gravity = np.array(scene.ground.normal), float(np.linalg.norm(scene.gravity))
    speed = np.linalg.norm(motion.twist[:-1, :, 3:], axis=-1)
    pushed = np.linalg.norm(wrench, axis=-1) > 1e-9
    still = (speed < STILL) & (np.linalg.norm(motion.twist[:-1, :, :3], axis=-1) < STILL_SPIN)
    jump = np.abs(np.diff(motion.twist[..., 3:] @ normal, axis=0))
    name = np.where(speed < SLOW, "slide_slow", "slide_fast").astype(object)
    name[~pushed] = "coast"
    name[still & pushed] = "stick"
    name[still & ~pushed] = "rest"
    name[_switched(wrench, scene.time_step)] = "force_switch"
    name[_height(scene, motion.pose[:-1]) > FLYING] = "free_fall"
    name[_spread(jump > HARD * gravity * scene.time_step, 2)] = "impact"
    if len(scene.bodies) == 2:
        name[_spread(np.repeat(_apart(scene, motion.pose[:-1])[:, None] < NEAR, 2, 1), 2)] = "contact_between_objects"
    return name.astype(str)


def _height(scene: Scene, pose: Array) -> Array:
    """Return how far the lowest corner of each body is above the ground [m], shape (T, N)."""
    normal = np.array(scene.ground.normal)
    reach = sum(
        np.abs(rotate(pose[..., 3:], axis) @ normal) * scene.sizes[:, k] / 2 for k, axis in enumerate(np.eye(3))
    )
    return np.asarray(pose[..., :3] @ normal - scene.ground.offset - reach)


def _apart(scene: Scene, pose: Array) -> Array:
    """Return the distance of two boxes along the best of their own axes [m], shape (T,)."""
    axes = np.stack([rotate(pose[..., 3:], axis) for axis in np.eye(3)], 2)
    between = pose[:, 1, :3] - pose[:, 0, :3]
    gaps = []
    for body in range(2):
        for k in range(3):
            along = axes[:, body, k]
            reach = sum(
                np.abs((axes[:, other, j] * along).sum(-1)) * scene.sizes[other, j] / 2
                for other in range(2)
                for j in range(3)
            )
            gaps.append(np.abs((between * along).sum(-1)) - reach)
    return np.asarray(np.max(gaps, axis=0))


def _switched(wrench: Array, time_step: float) -> NDArray[np.bool_]:
    """Find the frames during and shortly after large changes of the command, shape (T, N)."""
    change = np.zeros(wrench.shape[:2])
    change[1:] = np.linalg.norm(np.diff(wrench, axis=0), axis=-1)
    jumps = change > SWITCH * max(float(np.linalg.norm(wrench, axis=-1).max()), 1e-9)
    if jumps.mean() > RARE:
        return np.zeros_like(jumps)
    return _spread(jumps, max(1, round(SWITCH_TIME / time_step)))


def _spread(mask: NDArray[np.bool_], frames: int) -> NDArray[np.bool_]:
    """Extend what is true (T, N) over the next frames."""
    wide = mask.copy()
    for k in range(1, frames + 1):
        wide[k:] |= mask[:-k]
    return wide
