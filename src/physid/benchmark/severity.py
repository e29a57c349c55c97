"""How much an effect shows: the displacement that no nominal model could follow, over the noise of the sensor."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from physid.bullet.world import Motion, observed, simulate
from physid.data.generate import draw
from physid.data.generation import GenerateConfig
from physid.physics.effect import Effect
from physid.scenes.catalogue import with_parameters
from physid.scenes.placing import span
from physid.scenes.rotations import conjugate, from_vector, multiply, to_vector
from physid.scenes.scene import Scene
from physid.scenes.setup import Excitation

Array = NDArray[np.float64]
WINDOW = 0.5  # [s] after so long the nominal model starts again from the true state: impacts would amplify anything
CHANGE = 0.02  # relative change of an unknown parameter, for differences
LOOKS = 4  # trajectories that are looked at
JITTERS, JITTER = 3, 0.2  # runs from other first states, which differ by a fifth of the noise (its rate: per 0.1 s)
SPAN = 0.1  # [s]
MOST = 10.0  # larger differences, in units of the noise, count as this: one impact that falls into another step
FLYING = ("toss",)  # scenes whose bodies leave the ground: all six coordinates of a first state are free there
"""In the others, those along the ground's normal follow from contact."""


def severity(config: GenerateConfig, effects: Sequence[Effect]) -> float:
    """Measure how much effects show in a recording set.

    The effect-free engine starts from the true state every half second and runs on under the same commands. What the
    observed poses differ by, divided by the sensor's noise, is d. From d are removed, by least squares, an offset and a
    trend of each coordinate in each window (its first state is unknown) and the changes that unknown parameters
    make. e is the same for the effect-free engine from first states that differ by a fifth of the noise: where impacts
    amplify what nobody can know, an effect shows only by what it adds. With means over windows, bodies, frames and
    coordinates the severity is sqrt(mean d^2 - mean e^2), 0 if that is negative.

    Args:
        config: The recording set, noise included.
        effects: What is hidden in it.

    Returns:
        Severity [standard deviations of the noise]; 0 without effects.
    """
    splits = config.splits()
    chosen = [index for index, split in enumerate(splits) if split == "fit"][:LOOKS]
    parts = [_columns(config, effects, index) for index in chosen]
    rows = np.concatenate(parts, 1).T
    shown, columns = rows[:, : 1 + JITTERS], rows[:, 1 + JITTERS :]
    if columns.shape[1]:
        shown = shown - columns @ np.linalg.lstsq(columns, shown, rcond=None)[0]
    square = np.mean(np.clip(shown, -MOST, MOST) ** 2, 0)
    return float(np.sqrt(max(0.0, square[0] - square[1:].mean())))


def _columns(config: GenerateConfig, effects: Sequence[Effect], index: int) -> Array:
    """Return d of a trajectory, e by each jitter, and the changes by each unknown parameter: shape (1 + J + P, n)."""
    scene = config.true_scene()
    excitation, motion, _ = draw(config, index, config.protocol, effects)
    seen = observed(motion.pose, effects, scene.time_step)
    spread = np.array([config.noise.position] * 3 + [config.noise.rotation] * 3)
    generator = np.random.default_rng(index)
    plain = replay(scene, excitation, motion, WINDOW)
    others = [replay(scene, excitation, motion, WINDOW, (generator, spread)) for _ in range(JITTERS)]
    others += [replay(each, excitation, motion, WINDOW) for each in _varied(scene, config.unknown)]
    length = _length(scene, WINDOW)
    starts = range(0, len(seen) - 1, length)
    free = [True] * 6 if scene.name in FLYING else [True, True, False, False, False, True]
    rows = (_difference(each, plain, scene) / spread for each in (seen, *others))
    cut = [[_detrended(row[start : start + length], free).ravel() for start in starts] for row in rows]
    return np.array([np.concatenate(row) for row in cut])


def replay(
    scene: Scene,
    excitation: Excitation,
    motion: Motion,
    window: float,
    jitter: tuple[np.random.Generator, Array] | None = None,
) -> Array:
    """Run the effect-free engine from the true state at the start of each window.

    Args:
        scene: The scene.
        excitation: The commands.
        motion: The true motion.
        window: Length of a window [s].
        jitter: Source of randomness, and the noise of the six coordinates of a pose, to disturb first states by.

    Returns:
        Poses, shape (T, N, 7).
    """
    length = _length(scene, window)
    poses = []
    for start in range(0, len(motion.pose) - 1, length):
        stop = min(start + length + 1, len(motion.pose))
        pose, twist = motion.pose[start], motion.twist[start]
        if jitter is not None:
            pose, twist = _disturbed(scene, pose, twist, *jitter)
        poses.append(simulate(scene, Excitation(pose, twist, excitation.wrench[start:stop])).pose[:length])
    joined = np.concatenate(poses)
    return np.concatenate([joined, motion.pose[len(joined) :]])


def _disturbed(
    scene: Scene, pose: Array, twist: Array, generator: np.random.Generator, spread: Array
) -> tuple[Array, Array]:
    """Return a first state as it might be estimated; where bodies stay on the ground, in its plane only."""
    axes = np.concatenate([span(scene.ground), np.array(scene.ground.normal)[None]])
    free = np.ones(6) if scene.name in FLYING else np.array([1.0, 1.0, 0.0, 0.0, 0.0, 1.0])
    size = JITTER * spread * free
    place, rate = (size * generator.standard_normal((len(pose), 6)) for _ in range(2))
    shifted = pose[:, :3] + place[:, :3] @ axes
    turned = multiply(from_vector(place[:, 3:] @ axes), pose[:, 3:])
    moved = np.concatenate([rate[:, 3:] @ axes, rate[:, :3] @ axes], 1) / SPAN
    return np.concatenate([shifted, turned], 1), twist + moved


def _length(scene: Scene, window: float) -> int:
    return max(1, round(window / scene.time_step))


def _varied(scene: Scene, unknown: Sequence[str]) -> list[Scene]:
    """Return the scene with each unknown parameter changed a little."""
    return [with_parameters(scene, {name: (1 + CHANGE) * scene.value(name)}) for name in unknown]


def _difference(pose: Array, other: Array, scene: Scene) -> Array:
    """Return positions and rotation vectors by which poses differ, in the axes of the ground, shape (T, N, 6)."""
    axes = np.concatenate([span(scene.ground), np.array(scene.ground.normal)[None]])
    shift = pose[..., :3] - other[..., :3]
    turn = to_vector(multiply(pose[..., 3:], conjugate(other[..., 3:])))
    return np.concatenate([shift @ axes.T, turn @ axes.T], -1)


def _detrended(window: Array, free: Sequence[bool]) -> Array:
    """Remove offset and trend of each free coordinate of a window, shape (T, N, 6)."""
    base = np.stack([np.ones(len(window)), np.arange(len(window))], 1)
    flat = window.reshape(len(window), -1)
    fit = (base @ np.linalg.lstsq(base, flat, rcond=None)[0]).reshape(window.shape)
    left: Array = window - np.where(np.array(free), fit, 0.0)
    return left
