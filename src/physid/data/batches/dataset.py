"""Recordings in batches: whole trajectories or segments of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
import torch
from torch import Tensor
from torch.utils.data import Dataset

from physid.data import Recording, RecordingSet
from physid.data.observations.step_grid import SHORTEST, mean_wrench
from physid.data.observations.trajectories import from_recordings, require_motion, require_seen
from physid.data.reading import echo_of, read_reading, stretch_of

Item = dict[str, Tensor]
Video = Literal["none", "all"] | Sequence[int]
JITTER = 0.02
"""Share of the time step by which the steps of an even log may differ, for what learns from segments or films; where
steps follow the stamps it is that of the shortest step."""
OVER_TIME = ("pose", "again", "stretch", "twist", "wrench", "frames", "shown", "time", "seen", "steps", "step_wrench",
             "frame_step")  # fmt: skip
"""Filled up along time where lengths differ."""
OF_STEPS = ("steps", "step_wrench", "count", "time_step")
"""Not one for each frame, and of whole trajectories only."""


class Segments(Dataset[Item]):
    """Segments of n consecutive frames of some trajectories; with n None each whole trajectory is one segment.

    An item holds, for n frames, N bodies and f decoded frames of H x W pixels:

    * `pose` (n, N, 7), `wrench` (n, N, 6) and, where the set has it, `twist` (n, N, 6), float64; an absent wrench is
      zero, and its last row is not used
    * of poses that were read from films: `again` (n, N, 7), these poses drawn and read a second time, and `stretch`
      (n, N, 6), what a standard deviation of their scale changes of them, rotation vectors [rad] and positions [m]
    * `length`: frames that are real, for in a batch shorter trajectories are filled up with their last frame
    * `index` and `start`: which trajectory of the set it is, and its first frame there
    * of a whole trajectory that is no even log (stamps that jitter, frames or bodies missing, forces with a clock of
      their own): `time` (n,) since its first frame [s], `seen` (n, N), `steps` (S,) of the engine [s] with the force in
      each, `step_wrench` (S, N, 6), `frame_step` (n,), after how many steps each frame lies, and their `count`;
      `wrench` is then the mean force from frame to frame
    * with video: `shown` (f,), which frames of the segment are decoded, in order, and `frames` (f, H, W, 3), uint8; of
      the whole trajectory the `first` frame and the `background` (H, W, 3), uint8, and the `mask` of the first frame
      (N, H, W), bool

    Numbers are read once and kept; video is decoded when asked for, in the worker that asks. With `decode` false only
    `shown` is served, for whoever keeps decoded films (see `physid.data.batches.films`).

    Args:
        recordings: The set.
        trajectories: Which of its trajectories, by index.
        length: Frames n of a segment; None for whole trajectories.
        stride: Frames between the starts of segments; None for segments that share only their end frames.
        video: "none", "all", or which frames of each segment to decode, say (0, 1, 2).
        draw: So many more frames, drawn from each segment anew whenever it is asked for.
        every: Only every so many frames of a trajectory count as "all", or are drawn.
        decode: Whether to serve the video itself.
        unposed: Whether to serve trajectories without poses, too; these are not finite then.
        moving: Whether to refuse trajectories of one frame, from which motions can be predicted, and not learned.

    Raises:
        ValueError: If a trajectory is shorter than a segment, or no even log where segments or video are asked for, or
            video is asked for beyond the segment.
    """

    def __init__(
        self,
        recordings: RecordingSet,
        trajectories: Sequence[int],
        length: int | None = None,
        stride: int | None = None,
        video: Video = "none",
        draw: int = 0,
        every: int = 1,
        *,
        decode: bool = True,
        unposed: bool = False,
        moving: bool = True,
    ) -> None:
        if draw < 0 or every < 1:
            raise ValueError(f"draw must not be negative and every be positive, got {draw} and {every}")
        self._recordings = recordings
        self._length = length
        self._video = video
        self._draw, self._every, self._decode, self._unposed, self._moving = draw, every, decode, unposed, moving
        self._numbers: dict[int, Item] = {}
        self._echo, self._reading = echo_of(recordings), read_reading(recordings.folder)
        self._places = self._find_places(trajectories, length, stride)

    def _find_places(
        self, trajectories: Sequence[int], length: int | None, stride: int | None
    ) -> list[tuple[int, int]]:
        """List the segments as (trajectory, first frame)."""
        if length is None:
            return [(trajectory, 0) for trajectory in trajectories]
        if length < 2:
            raise ValueError(f"segment must have at least 2 frames, got {length}")
        step = stride or length - 1
        places = []
        for trajectory in trajectories:
            frames = len(self._numbers_of(trajectory)["pose"])
            if frames < length:
                raise ValueError(
                    f"{self._recordings.paths[trajectory]}: expected at least the {length} frames of a segment, "
                    f"found {frames}; choose shorter segments"
                )
            places += [(trajectory, start) for start in range(0, frames - length + 1, step)]
        return places

    def __len__(self) -> int:
        return len(self._places)

    def __getitem__(self, index: int) -> Item:
        trajectory, start = self._places[index]
        numbers = self._numbers_of(trajectory)
        end = None if self._length is None else start + self._length
        item = {name: value if name in OF_STEPS else value[start:end] for name, value in numbers.items()}
        frames = len(item["pose"])
        item |= {
            name: torch.tensor(value) for name, value in (("length", frames), ("index", trajectory), ("start", start))
        }
        if self._video == "none":
            return item
        shown = self._choose(start, frames)
        item["shown"] = torch.tensor(shown)
        return item | self._film(trajectory, start, shown) if self._decode else item

    def _numbers_of(self, trajectory: int) -> Item:
        """Return poses, twists and wrenches of a trajectory, read once."""
        if trajectory not in self._numbers:
            even = self._length is not None or self._video != "none"
            numbers = _numbers_of(self._recordings, trajectory, self._unposed, even, self._moving)
            if self._echo is not None:
                numbers["again"] = torch.from_numpy(self._echo.read(trajectory).pose)
                numbers["stretch"] = self._stretched(numbers["pose"])
            self._numbers[trajectory] = numbers
        return self._numbers[trajectory]

    def _stretched(self, pose: Tensor) -> Tensor:
        """Return what a standard deviation of the scale changes of poses (n, N, 7) from films, shape (n, N, 6)."""
        camera, reading = self._recordings.scene.camera, self._reading
        if reading is None or camera is None:
            return torch.zeros_like(pose[..., :6])
        return reading.stretch_deviation * stretch_of(pose, camera.target)

    def _choose(self, start: int, frames: int) -> list[int]:
        """Choose the frames of a segment to decode, counted from its start."""
        counted = range(-start % self._every, frames, self._every)
        if isinstance(self._video, str):
            return list(counted)
        if not all(0 <= one < frames for one in self._video):
            raise ValueError(f"video must name frames within a segment of {frames}, got {list(self._video)}")
        free = [one for one in counted if one not in self._video]
        if len(free) < self._draw:
            raise ValueError(
                f"draw must be at most the {len(free)} frames that are left of a segment, got {self._draw}"
            )
        drawn = torch.randperm(len(free))[: self._draw].tolist()
        return sorted([*self._video, *(free[one] for one in drawn)])

    def _film(self, trajectory: int, start: int, shown: list[int]) -> Item:
        """Decode frames of a segment, and what a renderer needs of the trajectory."""
        images, mask, background = self._recordings.film(trajectory, [0, *(start + one for one in shown)])
        return {
            "frames": torch.from_numpy(images[1:]),
            "first": torch.from_numpy(images[0]),
            "mask": torch.from_numpy(mask),
            "background": torch.from_numpy(background),
        }


def _numbers_of(recordings: RecordingSet, trajectory: int, unposed: bool, even: bool, moving: bool) -> Item:
    """Read poses, wrenches and, where they are there, twists; stamps and steps of what is no even log.

    Raises:
        ValueError: If they must be an even log and are none: a segment has one pose and one force for each time step;
            or if a body is never seen, or there is one frame alone where it must move.
    """
    posed = recordings.has_poses(trajectory)
    if not posed and not unposed:
        raise ValueError(
            f"{recordings.paths[trajectory]}: pose: expected poses, found a recording with video only; read them first "
            "(physid track)"
        )
    recording, time_step = recordings.read(trajectory, video=not posed), recordings.scene.time_step
    if recording.pose is not None:
        try:
            require_seen(recording, [body.name for body in recordings.scene.bodies])
            if moving:
                require_motion(recording.length)
        except ValueError as error:
            raise ValueError(f"{recordings.paths[trajectory]}: {error}") from None
    reason = _irregular(recording, time_step, JITTER if even else SHORTEST)
    if reason and even:
        raise ValueError(
            f"{recordings.paths[trajectory]}: expected one pose and one force of each body every time step, found "
            f"{reason}; resample the recording for what learns from segments or films (physid fit with SysID takes "
            "whole trajectories as they are: leave data.segment and data.video out)"
        )
    if reason and posed:
        return _timed(recording, time_step, trajectory)
    pose = recording.pose
    if pose is None:
        pose = np.full((recording.length, len(recordings.scene.bodies), 7), np.nan)
    wrench = np.zeros((*pose.shape[:2], 6)) if recording.wrench is None else recording.wrench
    numbers = {"pose": pose, "wrench": wrench}
    if recording.twist is not None:
        numbers["twist"] = recording.twist
    return {name: torch.from_numpy(value) for name, value in numbers.items()}


def _timed(recording: Recording, time_step: float, trajectory: int) -> Item:
    """Lay the steps of a trajectory that is no even log."""
    laid = from_recordings([recording], time_step, [trajectory])
    grid = laid.grid
    item = {"pose": laid.pose[0], "wrench": mean_wrench(grid)[0], "time": laid.time[0], "seen": laid.seen[0]}
    item |= {"steps": grid.steps[0], "step_wrench": grid.wrench[0], "frame_step": grid.frame_step[0]}
    item |= {"count": grid.count[0], "time_step": torch.tensor(time_step, dtype=torch.float64)}
    return item if laid.twist is None else item | {"twist": laid.twist[0]}


def _irregular(recording: Recording, time_step: float, jitter: float) -> str:
    """Return what sets a recording apart from an even log; nothing where it is one."""
    if recording.wrench_time is not None:
        return "forces with a clock of their own (wrench_time)"
    if recording.pose is not None and not recording.seen.all():
        return f"a body that was not seen in frame {int(np.argwhere(~recording.seen)[0, 0])}"
    off = np.abs(np.diff(recording.stamps(time_step)) - time_step) > jitter * time_step
    return f"another step after frame {int(off.argmax())}" if off.any() else ""


def collate(items: Sequence[Item]) -> Item:
    """Stack items along a new first axis B; shorter trajectories are filled up with their last frame.

    Raises:
        ValueError: If some items carry velocities or video and others do not.
    """
    steps = [float(item["time_step"]) for item in items if "time_step" in item]
    if steps:
        items = [item if "time" in item else _evenly(item, steps[0]) for item in items]
    if any(item.keys() != items[0].keys() for item in items):
        raise ValueError("trajectories of one batch must carry the same arrays; split the set by what was recorded")
    batch = {name: _stack([item[name] for item in items], name) for name in items[0] if name != "time_step"}
    if steps:
        # What is filled up was not seen.
        batch["seen"] &= (torch.arange(batch["seen"].shape[1]) < batch["length"][:, None])[..., None]
    return batch


def _evenly(item: Item, time_step: float) -> Item:
    """Give an even log the stamps and steps that others of its batch have."""
    frames, count = len(item["pose"]), max(len(item["pose"]) - 1, 1)
    return item | {
        "time": time_step * torch.arange(frames, dtype=torch.float64),
        "seen": torch.ones(item["pose"].shape[:2], dtype=torch.bool),
        "steps": torch.full((count,), time_step, dtype=torch.float64),
        "step_wrench": item["wrench"][:count],
        "frame_step": torch.arange(frames),
        "count": torch.tensor(count),
        "time_step": torch.tensor(time_step, dtype=torch.float64),
    }


def _stack(values: Sequence[Tensor], name: str) -> Tensor:
    """Stack tensors, filling along time where their lengths differ."""
    longest = max((len(value) for value in values if value.ndim), default=0)
    if name not in OVER_TIME or all(len(value) == longest for value in values):
        return torch.stack(list(values))
    missing = [value[-1:].expand(longest - len(value), *value.shape[1:]) for value in values]
    return torch.stack([torch.cat(pair) for pair in zip(values, missing, strict=True)])
