"""Cutting trajectories into windows that start anew, so that errors do not pile up."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import torch
from torch import Tensor

Cut = tuple[int, int, bool]  # first frame, frames, whether it is busy


@dataclass(frozen=True)
class Cutting:
    """How trajectories are cut around events.

    Attributes:
        lead: Frames before an event that are busy like it.
        trail: Frames after it.
        longest: Most frames of a busy window.
        least: A calm stretch of fewer frames is no window of its own.
    """

    lead: int
    trail: int
    longest: int
    least: int


# One hit to a window, seldom more; frames before and after tell its velocities.
HITS = Cutting(lead=20, trail=6, longest=15, least=8)
# Calm windows as long as they can be; overlaps of bodies are gone when they begin.
CALM = Cutting(lead=4, trail=16, longest=30, least=12)
CLASSES = (16, 32, 64, 128)  # windows of up to so many frames are simulated together


@dataclass(frozen=True)
class Batch:
    """Windows of similar length.

    Attributes:
        windows: Which windows, shape (k,).
        trajectory: Whose they are, shape (k,).
        frame: Their frames, shape (k, L); beyond the end the last frame of the trajectory.
        inside: Which of these belong to the window, shape (k, L).
    """

    windows: Tensor
    trajectory: Tensor
    frame: Tensor
    inside: Tensor

    def cut(self, value: Tensor, fill: float | None = None) -> Tensor:
        """Turn (C, R, T, ...) into (C, k, L, ...); what is not inside holds a later value, or `fill`."""
        place = (self.trajectory[:, None] * value.shape[2] + self.frame).flatten()
        taken: Tensor = value.flatten(1, 2).index_select(1, place).unflatten(1, self.frame.shape)
        if fill is None:
            return taken
        return taken.masked_fill_(~self.inside.reshape(*self.inside.shape, *[1] * (taken.ndim - 3)), fill)

    def columns(self, value: Tensor) -> Tensor:
        """Turn C data sets or columns (C, R, T, N, 6) into those of the windows, zero outside; (k, M, C), M = L N 6."""
        return self.cut(value, fill=0.0).flatten(2).movedim(0, -1)

    def put(self, value: Tensor, into: Tensor) -> None:
        """Write (C, k, L, ...) back to (C, R, T, ...)."""
        inside = self.inside.flatten().nonzero()[:, 0]
        place = (self.trajectory[:, None] * into.shape[2] + self.frame).flatten()[inside]
        into.flatten(1, 2).index_copy_(1, place, value.flatten(1, 2).index_select(1, inside))

    def split(self, parts: int) -> list[Batch]:
        """Return at most so many parts that take equally long, each with its longest windows first."""
        order = self.inside.sum(1).argsort(descending=True, stable=True)
        return [
            Batch(self.windows[rows], self.trajectory[rows], self.frame[rows], self.inside[rows])
            for rows in (order[part::parts] for part in range(min(parts, len(order))))
        ]


@dataclass(frozen=True)
class Windows:
    """How R trajectories of T frames are cut into K windows; every frame is in one window, but for `only`.

    Attributes:
        trajectories: R.
        frames: T.
        trajectory: Whose each window is, shape (K,).
        start: First frame, shape (K,).
        size: Number of frames, shape (K,).
        busy: Windows with events, in which small errors grow fast, shape (K,).
    """

    trajectories: int
    frames: int
    trajectory: Tensor
    start: Tensor
    size: Tensor
    busy: Tensor

    @classmethod
    def equal(cls, trajectories: int, frames: int, length: int) -> Windows:
        """Cut all trajectories alike, into equal parts of at most so many frames."""
        parts = -(-frames // length)
        edges = [frames * k // parts for k in range(parts + 1)]
        return cls._of([[(a, b - a, False) for a, b in pairwise(edges)]] * trajectories, frames)

    @classmethod
    def around(cls, events: Tensor, cutting: Cutting) -> Windows:
        """Cut so that stretches with events become short windows, and calm stretches stay whole.

        Args:
            events: Frames at which small errors grow fast, shape (R, T).
            cutting: Lengths.
        """
        return cls._of([_cuts(row, cutting) for row in events], events.shape[1])

    @classmethod
    def _of(cls, cuts: list[list[Cut]], frames: int) -> Windows:
        row, start, size, busy = torch.tensor([(row, *cut) for row, own in enumerate(cuts) for cut in own]).T
        return cls(len(cuts), frames, row.contiguous(), start.contiguous(), size.contiguous(), busy.bool())

    def __len__(self) -> int:
        return len(self.start)

    def only(self, chosen: Tensor) -> Windows:
        """Return some of the windows (indices, in order); the other frames are in none."""
        parts = (value[chosen] for value in (self.trajectory, self.start, self.size, self.busy))
        return Windows(self.trajectories, self.frames, *parts)

    @cached_property
    def batches(self) -> list[Batch]:
        """The windows, those of similar length together."""
        made, lower = [], 0
        for upper in (*CLASSES, self.frames):
            windows = ((self.size > lower) & (self.size <= upper)).nonzero()[:, 0]
            lower = max(upper, lower)
            if len(windows):
                frame = self.start[windows, None] + torch.arange(int(self.size[windows].max()))
                inside = frame < (self.start + self.size)[windows, None]
                made.append(Batch(windows, self.trajectory[windows], frame.clamp_max(self.frames - 1), inside))
        return made

    @property
    def cost(self) -> int:
        """Frames that are simulated for one variant."""
        return sum(batch.frame.numel() for batch in self.batches)

    @cached_property
    def position(self) -> Tensor:
        """How many frames each frame is after the first of its window, shape (R, T)."""
        into = torch.zeros(1, self.trajectories, self.frames, dtype=torch.int64)
        for batch in self.batches:
            batch.put((batch.frame - self.start[batch.windows, None])[None], into)
        return into[0]

    def spread(self, value: Tensor) -> Tensor:
        """Give every frame the value (K,) of its window, shape (R, T)."""
        table = torch.zeros(1, self.trajectories, self.frames, dtype=value.dtype)
        for batch in self.batches:
            batch.put(value[None, batch.windows, None].expand(1, *batch.frame.shape), table)
        return table[0]

    def sum_frames(self, value: Tensor) -> Tensor:
        """Sum (C, R, T) over the frames of each window, shape (C, K)."""
        total = value.new_zeros(len(value), len(self))
        for batch in self.batches:
            total[:, batch.windows] = batch.cut(value, fill=0.0).sum(-1)
        return total

    def sum_windows(self, value: Tensor) -> Tensor:
        """Sum (K, ...) over the windows of each trajectory, shape (R, ...)."""
        return value.new_zeros(self.trajectories, *value.shape[1:]).index_add(0, self.trajectory, value)


def _cuts(events: Tensor, cutting: Cutting) -> list[Cut]:
    """Return the windows of one trajectory; events has shape (T,)."""
    busy = events.clone()
    for frame in events.nonzero()[:, 0].tolist():
        busy[max(0, frame - cutting.lead) : frame + cutting.trail + 1] = True
    runs = _runs(busy)
    for first, count in runs:
        if not busy[first] and count < cutting.least and len(runs) > 1:
            busy[first : first + count] = True
    cuts: list[Cut] = []
    for first, count in _runs(busy):
        parts = -(-count // cutting.longest) if busy[first] else 1
        edges = [first + count * k // parts for k in range(parts + 1)]
        cuts += [(a, b - a, bool(busy[first])) for a, b in pairwise(edges)]
    return cuts


def _runs(mask: Tensor) -> list[tuple[int, int]]:
    """Return (first frame, frames) of the stretches in which a mask (T,) does not change."""
    edges = [0, *((mask[1:] != mask[:-1]).nonzero()[:, 0] + 1).tolist(), len(mask)]
    return [(a, b - a) for a, b in pairwise(edges)]
