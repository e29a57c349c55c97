"""The effect-free engine, started anew from the true state every now and then."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physid.scenes.rotations import conjugate, from_vector, multiply, to_vector
from physid.scenes.scene import Scene
from physid.scenes.setup import Excitation
from physid.scenes.setups.placing import span
from physid.simulators.bullet.engine import Engine
from physid.simulators.bullet.world import Motion

Array = NDArray[np.float64]
SPAN = 0.1  # [s] over which the change of a rate is told


def replay(
    scene: Scene,
    excitation: Excitation,
    motion: Motion,
    segment: float,
    change: Array | None = None,
) -> Array:
    """Run the effect-free engine from the true state at the start of each segment.

    Args:
        scene: The scene.
        excitation: The commands.
        motion: The true motion.
        segment: Length of a segment [s].
        change: Of initial states, in the axes of the ground: of their poses, and of their rates in 0.1 s; of all
            segments alike (2, N, 6), or of each (W, 2, N, 6).

    Returns:
        Poses, shape (T, N, 7).
    """
    length, rows = length_of(scene, segment), []
    with Engine(scene, scene.time_step) as engine:
        for number, start in enumerate(range(0, len(motion.pose) - 1, length)):
            pose, twist = motion.pose[start], motion.twist[start]
            if change is not None:
                pose, twist = _disturbed(scene, pose, twist, change if change.ndim == 3 else change[number])
            engine.set_state(pose, twist)
            rows.append(engine.read()[0])
            for load in excitation.wrench[start : min(start + length, len(motion.pose)) - 1].tolist():
                engine.push(rows[-1], load)
                engine.step()
                rows.append(engine.read()[0])
    joined = np.array(rows)
    return np.concatenate([joined, motion.pose[len(joined) :]])


def _disturbed(scene: Scene, pose: Array, twist: Array, change: Array) -> tuple[Array, Array]:
    """Move an initial state in the axes of the ground, see `replay`."""
    axes = axes_of(scene)
    place, rate = change
    shifted = pose[:, :3] + place[:, :3] @ axes
    turned = multiply(from_vector(place[:, 3:] @ axes), pose[:, 3:])
    moved = np.concatenate([rate[:, 3:] @ axes, rate[:, :3] @ axes], 1) / SPAN
    return np.concatenate([shifted, turned], 1), twist + moved


def length_of(scene: Scene, segment: float) -> int:
    """Return how many frames a segment of some seconds has."""
    return max(1, round(segment / scene.time_step))


def axes_of(scene: Scene) -> Array:
    """Return the axes of the ground as rows: two along it, then its normal."""
    return np.concatenate([span(scene.ground), np.array(scene.ground.normal)[None]])


def difference(pose: Array, other: Array, scene: Scene) -> Array:
    """Return positions and rotation vectors by which poses differ, in the axes of the ground, shape (T, N, 6)."""
    axes = axes_of(scene)
    shift = pose[..., :3] - other[..., :3]
    turn = to_vector(multiply(pose[..., 3:], conjugate(other[..., 3:])))
    return np.concatenate([shift @ axes.T, turn @ axes.T], -1)
