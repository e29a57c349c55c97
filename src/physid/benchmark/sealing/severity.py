"""How much an effect shows: the displacement that no nominal model could follow, over the noise of the sensor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from physid.benchmark.sealing.replay import SPAN, Look, axes_of, difference, length_of, look_at, steady
from physid.data.generation.settings import GenerateConfig
from physid.physics import Effect
from physid.scenes import Scene, find_setup, with_parameters

Array = NDArray[np.float64]
WINDOW = 0.5  # [s] after so long the nominal model starts again from the true state: impacts would amplify anything
CHANGE = 0.02  # relative change of an unknown parameter, for differences
LOOKS = 4  # trajectories that are looked at
JITTERS, JITTER = 3, 0.2  # runs from other initial states, which differ by a fifth of the noise (its rate: per 0.1 s)
STEPS = 3  # of Gauss-Newton, by which initial states follow what is seen
BRIEF = 0.05  # [s] segments in which unknown parameters are fitted to an effect ...
REFITS, SETTLED = 6, 1e-4  # ... in so many steps at most, until they change by less than this share ...
ROBUST, SMALL = 12, 1e-3  # rounds of a robust fit, and the smallest misfit of a block that counts
BENT = 0.2  # share by which opposite changes may differ in a segment that counts there
ELASTIC = 0.95  # largest restitution
FARTHEST = 2.0  # ... and by this factor at most in each
MOST = 10.0  # larger differences, in units of the noise, count as this: one impact that falls into another step
"""In the others, those along the ground's normal follow from contact."""
UNSEEN = np.array([1.0, 1.0, 1e6, 1e6, 1e6, 1.0])
"""A reader of films takes bodies to lie on the ground: what leaves it (height, tilt) is as good as never seen."""


def severity(config: GenerateConfig, effects: Sequence[Effect]) -> float:
    """Measure how much effects show in a recording set.

    The effect-free engine starts from the true state every half second and runs on under the same commands, with the
    unknown parameters that explain the effects best. What the observed poses differ by, divided by the sensor's noise,
    is d. From d are removed, by least squares, what other initial states change in each segment (`_first_states`, and
    `_followed`) and the changes that unknown parameters make. e is the same for the effect-free engine from first
    states that differ by a fifth of the noise, and by up to half a step along the motion: where impacts amplify what
    nobody can know, or fall into other steps, an effect shows only by what it adds. With means over segments, bodies,
    frames and coordinates the severity is the root of the median over trajectories of mean d^2 - mean e^2, 0 if that is
    negative: one impact that falls into another step makes no severity.

    Args:
        config: The recording set, noise included.
        effects: What is hidden in it.

    Returns:
        Severity [standard deviations of the noise]; 0 without effects.
    """
    if not effects:
        return 0.0
    config = steady(config)
    chosen = [index for index, split in enumerate(config.splits()) if split == "fit"][:LOOKS]
    looks = [look_at(config, index, effects) for index in chosen]
    spread = np.array([config.noise.position] * 3 + [config.noise.rotation] * 3) * (UNSEEN if config.video else 1.0)
    # What a camera shows late has its impacts in other brief segments, and no unknown parameter explains that.
    scenes = {config.true_scene(), _refitted(config, looks, spread)}
    return min(_left(scene, config.unknown, dict(zip(chosen, looks, strict=True)), spread) for scene in scenes)


def _left(scene: Scene, unknown: Sequence[str], looks: Mapping[int, Look], spread: Array) -> float:
    """Return the severity beside small changes of unknown parameters about their values in a scene."""
    parts = [_columns(scene, unknown, look, spread, index) for index, look in looks.items()]
    columns = [part[1 + JITTERS :] for part in parts]
    change = _robust([part[: 1 + JITTERS] for part in parts], columns)
    square = np.array(
        [
            np.mean(np.clip(part[: 1 + JITTERS] - change @ column, -MOST, MOST) ** 2, 1)
            for part, column in zip(parts, columns, strict=True)
        ]
    )
    return float(np.sqrt(max(0.0, np.median(square[:, 0] - square[:, 1:].mean(1)))))


def _refitted(config: GenerateConfig, looks: Sequence[Look], spread: Array) -> Scene:
    """Return the scene with the unknown parameters that follow the effects best over a few frames.

    Over so few frames impacts amplify nothing, and Gauss-Newton gets there: an effect that is exactly a change of an
    unknown parameter is absorbed exactly, at any size.
    """
    scene = config.true_scene()
    if not config.unknown:
        return scene
    for _ in range(REFITS):
        segments = [part for look in looks for part in _brief(scene, config.unknown, look, spread)]
        if not segments:
            break
        wanted = CHANGE * _robust([part[:1] for part in segments], [part[1:] for part in segments])[0]
        factors = np.clip(1 + wanted, 1 / FARTHEST, FARTHEST)
        values = {
            name: min(scene.value(name) * float(factor), ELASTIC if name.endswith(".restitution") else np.inf)
            for name, factor in zip(config.unknown, factors, strict=True)
        }
        scene = with_parameters(scene, values)
        if np.abs(wanted).max() < SETTLED:
            break
    return scene


def _brief(scene: Scene, unknown: Sequence[str], look: Look, spread: Array) -> list[Array]:
    """Return d and the changes by each unknown parameter, (1 + P, n), in each brief segment where these are linear."""
    plain = look.replay(scene, BRIEF)
    scenes = [*_varied(scene, unknown), *_varied(scene, unknown, -CHANGE)]
    varied = (look.replay(each, BRIEF) for each in scenes)
    rows = [difference(each, plain, scene) / spread for each in (look.seen, *varied)]
    length = length_of(scene, BRIEF)
    segments = []
    for start in range(0, len(look.seen) - 1, length):
        cut = np.array([_detrended(row[start : start + length], _free(scene)).ravel() for row in rows])
        rise, fall = cut[1 : 1 + len(unknown)], cut[1 + len(unknown) :]
        if np.linalg.norm(rise + fall) <= BENT * np.linalg.norm(rise - fall):
            segments.append(np.concatenate([cut[:1], (rise - fall) / 2]))
    return segments


def _robust(targets: Sequence[Array], columns: Sequence[Array]) -> Array:
    """Explain targets (J, n_b) by columns (P, n_b) in blocks b, such that a few outliers blocks decide nothing.

    The sum of the root mean squares of the blocks is minimised, by least squares with the inverse of these as weights.

    Returns:
        Coefficients, shape (J, P).
    """
    change = np.zeros((len(targets[0]), len(columns[0])))
    for row in range(len(change)) if change.size else ():
        for _ in range(ROBUST):
            left = [target[row] - change[row] @ column for target, column in zip(targets, columns, strict=True)]
            weight = [1 / max(np.sqrt(np.mean(one**2)), SMALL) ** 0.5 for one in left]
            matrix = np.concatenate([w * column for w, column in zip(weight, columns, strict=True)], 1).T
            vector = np.concatenate([w * target[row] for w, target in zip(weight, targets, strict=True)])
            change[row] = np.linalg.lstsq(matrix, vector, rcond=None)[0]
    return change


def _columns(scene: Scene, unknown: Sequence[str], look: Look, spread: Array, index: int) -> Array:
    """Return d of a trajectory, e by each jitter, and the changes by each unknown parameter: shape (1 + J + P, n)."""
    generator = np.random.default_rng(index)
    plain = look.replay(scene, WINDOW)
    bodies = len(scene.bodies)
    draws = [generator.standard_normal((2, bodies, 6)) * _free(scene) for _ in range(JITTERS)]
    jitters = (JITTER * spread * draw + _other_phase(scene, look, generator) for draw in draws)
    others = [look.replay(scene, WINDOW, jitter) for jitter in jitters]
    others += [look.replay(each, WINDOW) for each in _varied(scene, unknown)]
    rows = np.array([difference(each, plain, scene) / spread for each in (look.seen, *others)])
    states = _first_states(scene, look, plain, spread)
    followed = _followed(scene, look, states, spread)
    cut = []
    for number, start in enumerate(range(0, len(look.seen) - 1, length_of(scene, WINDOW))):
        segment, free = _flat(rows, scene, start), _flat(states, scene, start)
        left = segment - np.linalg.lstsq(free.T, segment.T, rcond=None)[0].T @ free
        left[0] = min(left[0], followed[number], key=np.linalg.norm)
        cut.append(left)
    return np.concatenate(cut, 1)


def _other_phase(scene: Scene, look: Look, generator: np.random.Generator) -> Array:
    """Move the initial state of each segment along its motion by up to half a step either way, (W, 2, N, 6).

    A motion that comes a little earlier is the same motion, but its impacts fall into other steps of the simulator.
    """
    starts = range(0, len(look.motion.pose) - 1, length_of(scene, WINDOW))
    twist = look.motion.twist[list(starts)]
    axes = axes_of(scene)
    along = np.concatenate([twist[..., 3:] @ axes.T, twist[..., :3] @ axes.T], -1) * _free(scene)
    share = generator.uniform(-0.5, 0.5, (len(along), 1, 1))
    return np.stack([scene.time_step / look.substeps * share * along, np.zeros_like(along)], 1)


def _followed(scene: Scene, look: Look, states: Array, spread: Array) -> list[Array]:
    """Return what is left of d in each segment when it starts again where the camera sees it start.

    A turned camera shows a turned experiment: other initial states follow it exactly, but not to first order. From
    where the camera sees it, steps of Gauss-Newton with the changes `states` (D, T, N, 6) about the true motion go on.
    """
    initial = range(0, len(look.seen) - 1, length_of(scene, WINDOW))
    change, left = _seen_starts(scene, look, initial), [np.array([np.inf])] * len(initial)
    for _ in range(STEPS):
        again = look.replay(scene, WINDOW, change)
        wide = difference(look.seen, again, scene)[None] / spread
        for number, start in enumerate(initial):
            segment, free = _flat(wide, scene, start)[0], _flat(states, scene, start)
            step = np.linalg.lstsq(free.T, segment, rcond=None)[0]
            left[number] = min(left[number], segment - step @ free, key=np.linalg.norm)
            for amount, (rate, body, k) in zip(step, _places(scene), strict=True):
                change[number, rate, body, k] += amount * spread[k]
    return left


def _seen_starts(scene: Scene, look: Look, initial: Sequence[int]) -> Array:
    """Return by how much initial states that the camera sees differ from the true ones (see `replay`), (W, 2, N, 6)."""
    seen, true = look.seen, look.motion.pose

    def rates(pose: Array) -> Array:
        return difference(pose[1:], pose[:-1], scene) / scene.time_step

    apart = difference(seen, true, scene), SPAN * (rates(seen) - rates(true))
    change = np.stack([value[list(initial)] for value in apart], 1) * _free(scene)
    return change


def _flat(rows: Array, scene: Scene, start: int) -> Array:
    """Return the segment that starts at a frame of (J, T, N, 6) as rows, shape (J, n)."""
    return rows[:, start : start + length_of(scene, WINDOW)].reshape(len(rows), -1)


def _first_states(scene: Scene, look: Look, plain: Array, spread: Array) -> Array:
    """Return what a small change of each free coordinate of the initial states changes, shape (D, T, N, 6)."""
    made = []
    for place in _places(scene):
        unit = np.zeros((2, len(scene.bodies), 6))
        unit[place] = JITTER
        moved = look.replay(scene, WINDOW, unit * spread)
        made.append(difference(moved, plain, scene) / spread / JITTER)
    return np.array(made)


def _places(scene: Scene) -> list[tuple[int, int, int]]:
    """List the free coordinates of an initial state: pose or rate, body, coordinate."""
    return [place for place in np.ndindex(2, len(scene.bodies), 6) if _free(scene)[place[-1]]]


def _free(scene: Scene) -> Array:
    """Return which coordinates of an initial state are free: all in flight, else those in the ground's plane; (6,)."""
    return np.ones(6) if find_setup(scene.name).leaves_ground else np.array([1.0, 1.0, 0.0, 0.0, 0.0, 1.0])


def _varied(scene: Scene, unknown: Sequence[str], change: float = CHANGE) -> list[Scene]:
    """Return the scene with each unknown parameter changed a little."""
    return [with_parameters(scene, {name: (1 + change) * scene.value(name)}) for name in unknown]


def _detrended(segment: Array, free: Array) -> Array:
    """Remove offset and trend of each free coordinate of a segment, shape (T, N, 6)."""
    base = np.stack([np.ones(len(segment)), np.arange(len(segment))], 1)
    flat = segment.reshape(len(segment), -1)
    fit = (base @ np.linalg.lstsq(base, flat, rcond=None)[0]).reshape(segment.shape)
    left: Array = segment - np.where(free > 0, fit, 0.0)
    return left
