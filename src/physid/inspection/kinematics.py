"""Velocities and accelerations of recorded bodies, and how noisy the poses are; from the poses and stamps alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from physid.data import Recording
from physid.estimation.measurement import Noise, NoiseSettings, noise_of_poses, outlier_poses, pose_difference
from physid.scenes import Scene
from physid.scenes.camera import corners

Array = NDArray[np.float64]
WINDOW, LONGEST, LASTING = 7, 41, 0.15  # frames of a local parabola: at least, at most; [s] at most
UNBOUNDED = NoiseSettings(least=(0.0, 0.0))
GAP = 2.0  # time steps per frame beyond which a window has too large a hole


@dataclass(frozen=True)
class Kinematics:
    """Local parabolas through windows of frames in which a body was seen, all bodies and trajectories in one row.

    Attributes:
        trajectory: Which one, shape (n,).
        frame: Middle of the window, shape (n,).
        body: Which body, shape (n,).
        velocity: [m/s], shape (n, 3).
        acceleration: [m/s^2], shape (n, 3).
        residual: Root mean square distance of the positions from the parabola [m], shape (n,).
        force: Mean over the window [N], shape (n, 3).
        height: Of the lowest corner over the ground [m], shape (n,).
        turning: Angle between neighbouring frames [rad], shape (n,).
        spin: Angular velocity [rad/s], shape (n, 3).
        angular: Angular acceleration [rad/s^2], shape (n, 3). Both are of a parabola through the turns from frame to
            frame, added up, which is exact about an axis that stays.
        torque: Mean over the window [N m], shape (n, 3).
        lean: Largest turn within the window about an axis along the ground [rad], shape (n,).
    """

    trajectory: NDArray[np.int64]
    frame: NDArray[np.int64]
    body: NDArray[np.int64]
    velocity: Array
    acceleration: Array
    residual: Array
    force: Array
    height: Array
    turning: Array
    spin: Array
    angular: Array
    torque: Array
    lean: Array

    def of(self, which: NDArray[np.bool_]) -> Kinematics:
        """Return some of the windows."""
        return Kinematics(**{name: value[which] for name, value in vars(self).items()})


def acceleration_noise(noise: float, time_step: float, window: int) -> float:
    """Return the standard deviation of the acceleration of a parabola through n even points [m/s^2].

    s_a = 2 s / (h^2 sqrt(n (n^2 - 1) (n^2 - 4) / 180)), by least squares.
    """
    return float(2 * noise / time_step**2 / np.sqrt(window * (window**2 - 1) * (window**2 - 4) / 180))


def window_for(noise: float, time_step: float, wanted: float) -> int:
    """Return the fewest frames, an odd number, whose parabola has an acceleration as exact as `wanted` [m/s^2]."""
    longest = max(WINDOW, min(LONGEST, int(LASTING / time_step)))
    sizes = range(WINDOW, longest + 1, 2)
    return next((one for one in sizes if acceleration_noise(noise, time_step, one) <= wanted), sizes[-1])


def kinematics_of(recordings: list[Recording], scene: Scene, window: int) -> Kinematics:
    """Fit x(t) = x + v t + a t^2 / 2 to every window of frames.

    Args:
        recordings: With poses.
        scene: Their scene.
        window: Frames of a window, an odd number.
    """
    parts = [
        _windows(one, scene, index, body, window)
        for index, one in enumerate(recordings)
        for body in range(len(scene.bodies))
        if one.pose is not None
    ]
    names = Kinematics.__dataclass_fields__
    return Kinematics(**{name: np.concatenate([part[name] for part in parts]) for name in names})


def _windows(one: Recording, scene: Scene, index: int, body: int, window: int) -> dict[str, NDArray[np.generic]]:
    """Fit the windows of one body in one trajectory."""
    assert one.pose is not None
    frame = np.flatnonzero(one.seen[:, body])
    time, pose = one.stamps(scene.time_step)[frame], one.pose[frame, body]
    place, design, inverse = _parabolas(time, scene.time_step, window)
    middle = place[:, window // 2]
    fit = inverse @ (pose[place, :3] - pose[middle][:, None, :3])
    off = pose[place, :3] - pose[middle][:, None, :3] - design @ fit
    turn = pose_difference(torch.from_numpy(pose[1:]), torch.from_numpy(pose[:-1]))[:, :3].numpy()
    walk, normal = np.concatenate([np.zeros((1, 3)), np.cumsum(turn, 0)]), np.array(scene.ground.normal)
    about = walk[place] - walk[middle][:, None]
    twist, wrench = inverse @ about, _mean_wrench(one, scene, body, time, place)
    lowest = lowest_corner(pose, scene, body)
    number = np.full(len(place), index), np.full(len(place), body)
    return {
        "trajectory": number[0],
        "frame": frame[middle],
        "body": number[1],
        "velocity": fit[:, 1] / scene.time_step,
        "acceleration": fit[:, 2] / scene.time_step**2,
        "residual": np.sqrt(np.square(off).sum(-1).mean(-1)),
        "force": wrench[:, 3:],
        "height": lowest[middle],
        "turning": np.linalg.norm(turn, axis=-1)[np.maximum(middle - 1, 0)] if len(turn) else np.zeros(len(place)),
        "spin": twist[:, 1] / scene.time_step,
        "angular": twist[:, 2] / scene.time_step**2,
        "torque": wrench[:, :3],
        "lean": np.linalg.norm(about - (about @ normal)[..., None] * normal, axis=-1).max(1, initial=0.0),
    }


def _parabolas(time: Array, time_step: float, window: int) -> tuple[NDArray[np.int64], Array, Array]:
    """Return the frames of each window (n, w), what a parabola is in them (n, w, 3), and what fits it (n, 3, w)."""
    count = max(len(time) - window + 1, 0)
    place = np.arange(count)[:, None] + np.arange(window)
    within = time[place[:, -1]] - time[place[:, 0]] <= GAP * window * time_step if count else np.zeros(0, bool)
    place = place[within]
    since = (time[place] - time[place[:, window // 2]][:, None]) / time_step
    design = np.stack([np.ones_like(since), since, since**2 / 2], -1)
    return place, design, np.linalg.pinv(design) if len(place) else np.zeros((0, 3, window))


def shifted_forces(one: Recording, scene: Scene, body: int, window: int, shifts: Array) -> Array:
    """Return forces as the parabolas of `kinematics_of` smooth accelerations, at other times.

    Held forces are integrated twice, and a parabola goes through each window of that: where a body is pushed by nothing
    else, this is exactly its mass times the acceleration of its window, whatever the stamps.

    Args:
        one: With poses and forces.
        scene: Its scene.
        body: Which body.
        window: Frames of a window, an odd number.
        shifts: By which the forces are taken to come later [s], shape (S,).

    Returns:
        For the windows of this body in `kinematics_of`, shape (S, n, 3) [N].
    """
    assert one.wrench is not None
    time = one.stamps(scene.time_step)[np.flatnonzero(one.seen[:, body])]
    place, _, inverse = _parabolas(time, scene.time_step, window)
    force, start = one.wrench[:, body, 3:], one.wrench_stamps(scene.time_step)
    held = np.diff(start, append=start[-1:])[:, None]
    impulse = np.concatenate([np.zeros((1, 3)), np.cumsum(force * held, 0)[:-1]])
    moved = np.concatenate([np.zeros((1, 3)), np.cumsum((impulse + 0.5 * force * held) * held, 0)[:-1]])
    at = time - shifts[:, None]
    row = np.clip(np.searchsorted(start, at, side="right") - 1, 0, None)
    since = np.maximum(at - start[row], 0.0)[..., None]
    twice = moved[row] + impulse[row] * since + 0.5 * force[row] * since**2
    ways = twice[:, place] - twice[:, place[:, window // 2]][:, :, None]
    return np.asarray(np.einsum("nw,snwd->snd", inverse[:, 2], ways) / scene.time_step**2)


def lowest_corner(pose: Array, scene: Scene, body: int) -> Array:
    """Return the height of the lowest corner over the ground [m], shape (T,), of poses (T, 7) of a body."""
    heights = corners(pose[:, None], scene.sizes[body : body + 1])[:, 0] @ np.array(scene.ground.normal)
    return np.asarray(heights.min(-1) - scene.ground.offset)


def _mean_wrench(one: Recording, scene: Scene, body: int, time: Array, place: NDArray[np.int64]) -> Array:
    """Return the mean of the held torques and forces over windows (n, 6)."""
    if one.wrench is None or not len(place):
        return np.zeros((len(place), 6))
    start = one.wrench_stamps(scene.time_step)
    ends = np.append(start, max(time[-1], start[-1]) + scene.time_step)
    impulse = np.concatenate([np.zeros((1, 6)), np.cumsum(one.wrench[:, body] * np.diff(ends)[:, None], 0)])
    first, last = time[place[:, 0]], time[place[:, -1]]
    given = np.stack(
        [np.interp(last, ends, impulse[:, k]) - np.interp(first, ends, impulse[:, k]) for k in range(6)], 1
    )
    return np.asarray(given / (last - first)[:, None])


def noise_of(recordings: list[Recording], time_step: float) -> Noise:
    """Return the noise that no smooth motion of a body explains (see `noise_of_poses`), outliers left out.

    Args:
        recordings: With poses.
        time_step: Nominal time between frames [s].
    """
    frames = np.arange(max(len(one.seen) for one in recordings))
    poses, times, real = list[Array](), list[Array](), list[NDArray[np.bool_]]()
    for one in recordings:
        assert one.pose is not None
        for body, seen in enumerate(one.seen.T):
            rows = np.flatnonzero(seen)[np.minimum(frames, seen.sum() - 1)]
            poses.append(one.pose[rows, body, None])
            times.append(one.stamps(time_step)[rows])
            real.append(frames < seen.sum())
    pose, time, there = (torch.from_numpy(np.stack(each)) for each in (poses, times, real))
    return noise_of_poses(pose, there & ~outlier_poses(pose, there[..., None], time)[..., 0], time, UNBOUNDED)
