"""Recordings in batches: whole trajectories or segments of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
import torch
from torch import Tensor
from torch.utils.data import Dataset

from physid.data.format import RecordingSet
from physid.data.recording import Recording

Item = dict[str, Tensor]
Video = Literal["none", "all"] | Sequence[int]
JITTER = 0.02  # share of the time step by which the steps of an even log may differ
OVER_TIME = ("pose", "twist", "wrench", "frames", "shown")  # filled up along time where lengths differ


class Segments(Dataset[Item]):
    """Segments of n consecutive frames of some trajectories; with n None each whole trajectory is one segment.

    An item holds, for n frames, N bodies and f decoded frames of H x W pixels:

    * `pose` (n, N, 7), `wrench` (n, N, 6) and, where the set has it, `twist` (n, N, 6), float64; an absent wrench is
      zero, and its last row is not used
    * `length`: frames that are real, for in a batch shorter trajectories are filled up with their last frame
    * `index` and `start`: which trajectory of the set it is, and its first frame there
    * with video: `shown` (f,), which frames of the segment are decoded, in order, and `frames` (f, H, W, 3), uint8; of
      the whole trajectory the `first` frame and the `background` (H, W, 3), uint8, and the `mask` of the first frame
      (N, H, W), bool

    Numbers are read once and kept; video is decoded when asked for, in the worker that asks. With `decode` false only
    `shown` is served, for whoever keeps decoded films (see `physid.data.films`).

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

    Raises:
        ValueError: If a trajectory is shorter than a segment, or video is asked for beyond the segment.
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
    ) -> None:
        if draw < 0 or every < 1:
            raise ValueError(f"draw must not be negative and every be positive, got {draw} and {every}")
        self._recordings = recordings
        self._length = length
        self._video = video
        self._draw, self._every, self._decode, self._unposed = draw, every, decode, unposed
        self._numbers: dict[int, Item] = {}
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
        item = {name: value[start:end] for name, value in numbers.items()}
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
            self._numbers[trajectory] = _numbers_of(self._recordings, trajectory, self._unposed)
        return self._numbers[trajectory]

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


def _numbers_of(recordings: RecordingSet, trajectory: int, unposed: bool) -> Item:
    """Read poses, wrenches and, where they are there, twists.

    Raises:
        ValueError: If they are no even log: a segment has one pose and one force for each time step.
    """
    posed = recordings.has_poses(trajectory)
    if not posed and not unposed:
        raise ValueError(
            f"{recordings.paths[trajectory]}: pose: expected poses, found a recording with video only; read them first "
            "(physid track)"
        )
    recording = recordings.read(trajectory, video=not posed)
    reason = _irregular(recording, recordings.scene.time_step)
    if reason:
        raise ValueError(
            f"{recordings.paths[trajectory]}: expected one pose and one force of each body every time step, found "
            f"{reason}; resample the recording for what learns from segments or films"
        )
    pose = recording.pose
    if pose is None:
        pose = np.full((recording.length, len(recordings.scene.bodies), 7), np.nan)
    wrench = np.zeros((*pose.shape[:2], 6)) if recording.wrench is None else recording.wrench
    numbers = {"pose": pose, "wrench": wrench}
    if recording.twist is not None:
        numbers["twist"] = recording.twist
    return {name: torch.from_numpy(value) for name, value in numbers.items()}


def _irregular(recording: Recording, time_step: float) -> str:
    """Return what sets a recording apart from an even log; nothing where it is one."""
    if recording.wrench_time is not None:
        return "forces with a clock of their own (wrench_time)"
    if recording.pose is not None and not recording.seen.all():
        return f"a body that was not seen in frame {int(np.argwhere(~recording.seen)[0, 0])}"
    off = np.abs(np.diff(recording.stamps(time_step)) - time_step) > JITTER * time_step
    return f"another step after frame {int(off.argmax())}" if off.any() else ""


def collate(items: Sequence[Item]) -> Item:
    """Stack items along a new first axis B; shorter trajectories are filled up with their last frame.

    Raises:
        ValueError: If some items carry velocities or video and others do not.
    """
    if any(item.keys() != items[0].keys() for item in items):
        raise ValueError("trajectories of one batch must carry the same arrays; split the set by what was recorded")
    return {name: _stack([item[name] for item in items], name) for name in items[0]}


def _stack(values: Sequence[Tensor], name: str) -> Tensor:
    """Stack tensors, filling along time where their lengths differ."""
    longest = max((len(value) for value in values if value.ndim), default=0)
    if name not in OVER_TIME or all(len(value) == longest for value in values):
        return torch.stack(list(values))
    missing = [value[-1:].expand(longest - len(value), *value.shape[1:]) for value in values]
    return torch.stack([torch.cat(pair) for pair in zip(values, missing, strict=True)])
