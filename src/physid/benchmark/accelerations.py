"""Accelerations from noisy poses, and what a nominal model of sliding leaves of them: the raw material of baselines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter

from physid.data.format import RecordingSet
from physid.data.recording import Recording
from physid.scenes.placing import span
from physid.scenes.scene import Scene

Array = NDArray[np.float64]
SMOOTHING = 0.2  # [s] length of the cubic that is laid through the positions (Savitzky, Golay 1964)
MOVING = 0.05  # [m/s] slower frames are left out: friction has no direction there
HARD = 12.0  # [m/s^2] frames with more acceleration are left out: impacts
LIFTED = 0.5  # part of the weight below which a body does not press on the ground


@dataclass(frozen=True)
class Samples:
    """Frames of the first body that slide or fly, in the ground's plane.

    Attributes:
        time: Since the first frame [s], shape (n,).
        position: [m], shape (n, 2).
        velocity: [m/s], shape (n, 2).
        acceleration: Without gravity [m/s^2], shape (n, 2).
        force: Commanded [N], shape (n, 2).
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
    chosen = [recordings.read(index) for index in recordings.indices(splits)]
    parts = [_differentiate(recordings.scene, one) for one in chosen]
    joined = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    frames, step = chosen[0].length, recordings.scene.time_step
    impulse = np.zeros(frames)
    impulse[frames // 2] = 1.0
    return Samples(**joined, spread=float(np.linalg.norm(_smooth(impulse[:, None], step, 2))))


def _differentiate(scene: Scene, recording: Recording) -> dict[str, Array]:
    """Return the samples of one trajectory, see `Samples`."""
    assert recording.pose is not None
    step, axes, normal = scene.time_step, span(scene.ground), np.array(scene.ground.normal)
    place = recording.pose[:, 0, :3]
    wrench = np.zeros((len(place), 6)) if recording.wrench is None else recording.wrench[:, 0]
    velocity, acceleration = _smooth(place, step, 1), _smooth(place, step, 2)
    free = acceleration - np.array(scene.gravity)
    force = wrench[:, 3:] @ axes.T
    load = free @ normal
    good = (np.linalg.norm(velocity @ axes.T, axis=1) > MOVING) & (np.linalg.norm(acceleration, axis=1) < HARD)
    found = {
        "time": np.arange(len(place)) * step,
        "position": place @ axes.T,
        "velocity": velocity @ axes.T,
        "acceleration": free @ axes.T,
        "force": force,
        "change": np.gradient(_smooth(force, step, 0), step, axis=0),
        "load": np.where(load > LIFTED * np.linalg.norm(scene.gravity), load, 0.0),
        "gravity": np.tile(np.array(scene.gravity) @ axes.T, (len(place), 1)),
    }
    return {name: value[good] for name, value in found.items()}


def _smooth(values: Array, step: float, order: int) -> Array:
    """Return a derivative of a cubic through the neighbours of each frame, shape (T, k)."""
    length = min(round(SMOOTHING / step), len(values) - 1) // 2 * 2 + 1
    found: Array = savgol_filter(values, length, 3, deriv=order, delta=step, axis=0)
    return found
