"""Recorded trajectories as arrays: what every command that compares poses with a prediction reads."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from physid.data.format import RecordingSet
from physid.data.observations.step_grid import SHORTEST, StepGrid, lay_steps, stacked
from physid.data.recording import UNIT_TOLERANCE, Recording
from physid.physics import check_shape

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Trajectories:
    """R trajectories of T frames of N bodies; shorter ones are filled up with frames in which nothing is seen.

    Each is simulated from its first frame over the steps of `grid`; the pose of frame t is compared with the state
    after `grid.frame_step[:, t]` steps, wherever `seen` says that there is one.

    Attributes:
        pose: Position of the centre [m] and unit quaternion x y z w, world frame, shape (R, T, N, 7); where a body was
            not seen, its last pose before (or else its first one after).
        seen: Whether a body was seen in a frame, shape (R, T, N).
        time: Time of each frame since the first [s], shape (R, T).
        grid: Steps, and the forces that act in them.
        time_step: Nominal time between frames [s].
        index: Number of each trajectory in the set.
        splits: What each is for, None where its file does not say.
        protocols: How each was excited, likewise.
        first: Frame in the file that frame 0 is (earlier ones, in which no body was seen, are left out).
        twist: Recorded angular [rad/s] and linear [m/s] velocity, shape (R, T, N, 6), zero where not seen; None unless
            every trajectory has it.

    Raises:
        ValueError: If shapes disagree, quaternions are not of unit length, or stamps and steps contradict each other.
    """

    pose: Tensor
    seen: Tensor
    time: Tensor
    grid: StepGrid
    time_step: float
    index: tuple[int, ...]
    splits: tuple[str | None, ...]
    protocols: tuple[str | None, ...]
    first: tuple[int, ...]
    twist: Tensor | None = None

    def __post_init__(self) -> None:
        check_shape("pose", self.pose, (None, None, None, 7))
        rows, frames, bodies, _ = self.pose.shape
        check_shape("seen", self.seen, (rows, frames, bodies))
        check_shape("time", self.time, (rows, frames))
        check_shape("grid.wrench", self.grid.wrench, (rows, None, bodies, 6))
        check_shape("grid.frame_step", self.grid.frame_step, (rows, frames))
        if self.twist is not None:
            check_shape("twist", self.twist, (rows, frames, bodies, 6))
        for name in ("index", "splits", "protocols", "first"):
            if len(getattr(self, name)) != rows:
                raise ValueError(
                    f"{name} must have an entry for each of {rows} trajectories, got {getattr(self, name)}"
                )
        if rows and float((self.pose[..., 3:].norm(dim=-1) - 1).abs().max()) > UNIT_TOLERANCE:
            raise ValueError("pose must hold unit quaternions x y z w")
        off = (self.grid.times.gather(1, self.grid.frame_step) - self.time).abs()
        if rows and float(off.max()) > 2 * SHORTEST * self.time_step:
            raise ValueError(f"frames must lie at the ends of steps, got one {float(off.max()):g} s away")

    def __len__(self) -> int:
        return len(self.pose)

    @property
    def regular(self) -> bool:
        """Whether all real steps are one time step long and each leads to the next frame, as in a simulator's log."""
        frames = torch.arange(self.pose.shape[1], device=self.pose.device)
        each = torch.minimum(frames, self.grid.count[:, None])
        even = (self.grid.steps == self.time_step) | ~self.grid.real
        return bool(even.all()) and bool((self.grid.frame_step == each).all())

    def refine(self, factors: int | Tensor) -> Trajectories:
        """Return the same with steps cut into equal parts (see `StepGrid.refine`)."""
        return replace(self, grid=self.grid.refine(factors))

    def chosen(self, which: Tensor) -> Trajectories:
        """Return some of the trajectories, by index or mask (R,); their arrays are no longer than they need."""
        rows = torch.arange(len(self))[which.cpu()].tolist()
        where = torch.tensor(rows, dtype=torch.long, device=self.pose.device)
        used = self.seen[where].any(2).any(0).nonzero()
        frames = int(used[-1, 0]) + 1 if len(used) else 1
        grid = self.grid.chosen(where)
        changed: dict[str, Any] = {name: getattr(self, name)[where][:, :frames] for name in ("pose", "seen", "time")}
        for name in ("index", "splits", "protocols", "first"):
            changed[name] = tuple(getattr(self, name)[row] for row in rows)
        if self.twist is not None:
            changed["twist"] = self.twist[where][:, :frames]
        return replace(self, grid=replace(grid, frame_step=grid.frame_step[:, :frames]), **changed)

    def to(self, device: torch.device | str) -> Trajectories:
        """Return the same on another device."""
        values = {each.name: getattr(self, each.name) for each in fields(self)}
        moved: dict[str, Any] = {name: one.to(device) for name, one in values.items() if isinstance(one, Tensor)}
        return replace(self, grid=self.grid.to(device), **moved)


def load_trajectories(
    recordings: RecordingSet, indices: Iterable[int] | None = None, *, shortest: float | None = None
) -> Trajectories:
    """Read trajectories of a set.

    Args:
        recordings: The set.
        indices: Which; all by default.
        shortest: Shortest step that a change of the force may cause [s] (see `lay_steps`).

    Raises:
        ValueError: If a file is damaged, its clocks contradict each other, it has no poses or one
            frame alone, or a body is never seen.
    """
    chosen = list(range(len(recordings)) if indices is None else indices)
    if not chosen:
        raise ValueError(
            f"{recordings.folder}: expected trajectories to read, got none; check the splits and the limit"
        )
    read = []
    for index in chosen:
        try:
            recording = recordings.read(index, blank=True)
            require_seen(recording, [body.name for body in recordings.scene.bodies])
            require_motion(recording.length)
        except ValueError as error:
            path = str(recordings.paths[index])
            raise ValueError(str(error) if str(error).startswith(path) else f"{path}: {error}") from None
        read.append(recording)
    return from_recordings(read, recordings.scene.time_step, chosen, shortest=shortest)


def from_recordings(
    recordings: Sequence[Recording],
    time_step: float,
    indices: Sequence[int] | None = None,
    *,
    shortest: float | None = None,
) -> Trajectories:
    """Stack recordings that have poses.

    Args:
        recordings: At least one.
        time_step: Nominal time between frames [s].
        indices: Their numbers in the set; 0, 1, ... by default.
        shortest: Shortest step that a change of the force may cause [s] (see `lay_steps`).
    """
    firsts = [int(one.seen.any(1).argmax()) for one in recordings]
    times = [one.stamps(time_step)[first:] for one, first in zip(recordings, firsts, strict=True)]
    frames = max(len(each) for each in times)
    steps = [
        lay_steps(time, *_forces(one, time_step), time_step, shortest)
        for one, time in zip(recordings, times, strict=True)
    ]
    pose, seen, time, twist = (list[NDArray[Any]]() for _ in range(4))
    for one, first, stamps in zip(recordings, firsts, times, strict=True):
        assert one.pose is not None
        last = np.minimum(np.arange(frames), len(stamps) - 1)
        there = one.seen[first:]
        pose.append(_filled(one.pose[first:], there)[last])
        seen.append(there[last] & (np.arange(frames) < len(stamps))[:, None])
        time.append((stamps - stamps[0])[last])
        if one.twist is not None:
            twist.append(np.nan_to_num(one.twist[first:])[last])
    numbers = tuple(range(len(recordings)) if indices is None else indices)
    return Trajectories(
        pose=torch.from_numpy(np.stack(pose)),
        seen=torch.from_numpy(np.stack(seen)),
        time=torch.from_numpy(np.stack(time)),
        grid=stacked(steps, frames, time_step),
        time_step=time_step,
        index=numbers,
        splits=tuple(one.split for one in recordings),
        protocols=tuple(one.protocol for one in recordings),
        first=tuple(firsts),
        twist=torch.from_numpy(np.stack(twist)) if len(twist) == len(recordings) else None,
    )


def _forces(recording: Recording, time_step: float) -> tuple[Array, Array]:
    """Return rows of forces and from when on each is held; a single row of zeros where there are none."""
    if recording.wrench is None:
        return np.zeros((1, recording.seen.shape[1], 6)), recording.stamps(time_step)[:1]
    return recording.wrench, recording.wrench_stamps(time_step)


def _filled(pose: Array, seen: NDArray[np.bool_]) -> Array:
    """Put the last pose that was seen before, or else the first one after, where a body was not seen."""
    frame = np.where(seen, np.arange(len(pose))[:, None], -1)
    last = np.maximum.accumulate(frame, 0)
    source = np.where(last < 0, seen.argmax(0), last)
    return np.take_along_axis(pose, source[..., None], 0)


def require_seen(recording: Recording, names: Sequence[str]) -> None:
    """Refuse a trajectory in which a body never appears.

    Raises:
        ValueError: If one does not; names it.
    """
    never = np.flatnonzero(~recording.seen.any(0))
    if len(never):
        raise ValueError(
            f"pose: expected every body in some frame, found {names[never[0]]} in none; leave the trajectory out, or "
            "record with the body in view"
        )


def require_motion(frames: int) -> None:
    """Refuse a trajectory of one frame where motion is compared: nothing can be learned from it, or said of it.

    Raises:
        ValueError: If there are fewer than two frames.
    """
    if frames < 2:
        raise ValueError(f"pose: expected at least 2 frames, found {frames}; leave the trajectory out")
