"""Accelerations from noisy poses, and what a nominal model of sliding leaves of them: the raw material of baselines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter
from scipy.signal import savgol_filter

from physid.data import Recording, RecordingSet
from physid.scenes import Scene
from physid.scenes.setups.placing import span

Array = NDArray[np.float64]
SMOOTHING = 0.2  # [s] length of the cubic that is laid through the positions (Savitzky, Golay 1964)
MOVING = 0.05  # [m/s] slower frames are left out: friction has no direction there
HARD = 12.0  # [m/s^2] frames with more acceleration are left out: impacts
SAME_TIME = 1e-6  # [step] times that differ by rounding only
LIFTED = 0.5  # part of the weight below which a body does not press on the ground


@dataclass(frozen=True)
class Samples:
    """Frames of the first body that slide or fly, in the ground's plane.

    Attributes:
        time: Since the first frame [s], shape (n,).
        position: [m], shape (n, 2).
        velocity: [m/s], shape (n, 2).
        acceleration: Without gravity [m/s^2], shape (n, 2).
        force: Commanded, averaged as the accelerations are [N], shape (n, 2).
        change: Its rate of change [N/s], shape (n, 2).
        load: Normal force over mass, 0 in flight [m/s^2], shape (n,).
        gravity: In the plane [m/s^2], shape (n, 2).
        spread: Standard deviation of an acceleration over that of a position [1/s^2].
    """

    time: Array
    position: Array
    velocity: Array
    acceleration: Array
    force: Array
    change: Array
    load: Array
    gravity: Array
    spread: float


def samples(recordings: RecordingSet, splits: Sequence[str]) -> Samples:
    """Differentiate the positions of the first body in all trajectories of some splits."""
    chosen, step = [recordings.read(index) for index in recordings.indices(splits)], recordings.scene.time_step
    parts = [_differentiate(recordings.scene, one) for one in chosen]
    joined = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    frames = len(_evenly(chosen[0], step)[0])
    impulse = np.zeros(frames)
    impulse[frames // 2] = 1.0
    return Samples(**joined, spread=float(np.linalg.norm(_smooth(impulse[:, None], step, 2))))


def _differentiate(scene: Scene, recording: Recording) -> dict[str, Array]:
    """Return the samples of one trajectory, see `Samples`."""
    step, axes, normal = scene.time_step, span(scene.ground), np.array(scene.ground.normal)
    place, wrench = _evenly(recording, step)
    velocity, acceleration = _smooth(place, step, 1), _smooth(place, step, 2)
    free = acceleration - np.array(scene.gravity)
    force = _averaged(wrench[:, 3:] @ axes.T, step)
    load = free @ normal
    good = (np.linalg.norm(velocity @ axes.T, axis=1) > MOVING) & (np.linalg.norm(acceleration, axis=1) < HARD)
    good = minimum_filter(good, _length(len(place), step))  # no frame of the cubic may be a stop or an impact
    found = {
        "time": np.arange(len(place)) * step,
        "position": place @ axes.T,
        "velocity": velocity @ axes.T,
        "acceleration": free @ axes.T,
        "force": force,
        "change": np.gradient(force, step, axis=0),
        "load": np.where(load > LIFTED * np.linalg.norm(scene.gravity), load, 0.0),
        "gravity": np.tile(np.array(scene.gravity) @ axes.T, (len(place), 1)),
    }
    return {name: value[good] for name, value in found.items()}


def _evenly(recording: Recording, step: float) -> tuple[Array, Array]:
    """Return positions (T, 3) and commanded wrenches (T, 6) of the first body at even times, a step apart.

    Positions in between are on the line from frame to frame; a command is held.
    """
    assert recording.pose is not None
    stamps = recording.stamps(step)
    even = stamps[0] + step * np.arange(round((stamps[-1] - stamps[0]) / step) + 1)
    seen = recording.seen[:, 0]
    place = np.stack([np.interp(even, stamps[seen], column[seen]) for column in recording.pose[:, 0, :3].T], 1)
    if recording.wrench is None:
        return place, np.zeros((len(even), 6))
    held = np.searchsorted(recording.wrench_stamps(step), even + SAME_TIME * step, side="right") - 1
    return place, np.where(held[:, None] < 0, 0.0, recording.wrench[held, 0])


def _smooth(values: Array, step: float, order: int) -> Array:
    """Return a derivative of a cubic through the neighbours of each frame, shape (T, k)."""
    found: Array = savgol_filter(values, _length(len(values), step), 3, deriv=order, delta=step, axis=0)
    return found


def _length(frames: int, step: float) -> int:
    """Return the odd number of frames that the cubic is laid through."""
    return min(round(SMOOTHING / step), frames - 1) // 2 * 2 + 1


def _averaged(values: Array, step: float) -> Array:
    """Average accelerations (T, k) as differentiating their positions does: integrate twice, then differentiate."""
    held = np.concatenate([np.zeros_like(values[:1]), values[:-1]])  # x_{t+1} - 2 x_t + x_{t-1} = h^2 a_t
    return _smooth(step**2 * held.cumsum(0).cumsum(0), step, 2)
