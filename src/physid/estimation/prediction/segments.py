"""Cutting trajectories into segments that start anew, so that errors do not pile up."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import pairwise

import torch
from torch import Tensor

from physid.estimation.prediction.seams import observe_apart
from physid.physics import Effect
from physid.setting import Section, setting

CALIBRATED = "decisions 0011 and 0012, calibration bank 607"
Cut = tuple[int, int, bool]  # first frame, frames, whether it is busy


class CutRule(Section):
    """How trajectories are cut around events: seldom more than one impact to a segment, and frames before and after."""

    lead: float = setting(20 / 240, "s", "before an event that belongs to it", CALIBRATED, ge=0)
    trail: float = setting(6 / 240, "s", "after an event that belongs to it", CALIBRATED, ge=0)
    longest: float = setting(15 / 240, "s", "longest contact segment", CALIBRATED, gt=0)
    least: float = setting(8 / 240, "s", "a shorter contact-free stretch is no segment of its own", CALIBRATED, ge=0)
    fewest: tuple[int, int, int, int] = setting(
        (4, 3, 8, 6), "frames", "of these four at least, however slow the camera", CALIBRATED
    )

    def frames(self, time_step: float) -> tuple[int, int, int, int]:
        """Return the same in frames, at least so many that the velocities before and after an event are seen."""
        times = (self.lead, self.trail, self.longest, self.least)
        lead, trail, longest, least = (
            max(round(time / time_step), fewest) for time, fewest in zip(times, self.fewest, strict=True)
        )
        return lead, trail, longest, least


CLASSES = (16, 32, 64, 128)  # segments of up to so many frames are simulated together


@dataclass(frozen=True)
class Batch:
    """Segments of similar length.

    Attributes:
        segments: Which segments, shape (k,).
        trajectory: Whose they are, shape (k,).
        frame: Their frames, shape (k, L); beyond the end the last frame of the trajectory.
        inside: Which of these belong to the segment, shape (k, L).
    """

    segments: Tensor
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
        """Cut C data sets or columns (C, R, T, N, 6) into segments, zero outside; shape (k, M, C) with M = L N 6."""
        return self.cut(value, fill=0.0).flatten(2).movedim(0, -1)

    def put(self, value: Tensor, into: Tensor) -> None:
        """Write (C, k, L, ...) back to (C, R, T, ...)."""
        inside = self.inside.flatten().nonzero()[:, 0]
        place = (self.trajectory[:, None] * into.shape[2] + self.frame).flatten()[inside]
        into.flatten(1, 2).index_copy_(1, place, value.flatten(1, 2).index_select(1, inside))

    def split(self, parts: int) -> list[Batch]:
        """Return at most so many parts that take equally long, each with its longest segments first."""
        order = self.inside.sum(1).argsort(descending=True, stable=True)
        return [
            Batch(self.segments[rows], self.trajectory[rows], self.frame[rows], self.inside[rows])
            for rows in (order[part::parts] for part in range(min(parts, len(order))))
        ]


@dataclass(frozen=True)
class Segmentation:
    """How R trajectories of T frames are cut into K segments; every frame is in one segment, but for `only`.

    Attributes:
        trajectories: R.
        frames: T.
        trajectory: Whose each segment is, shape (K,).
        start: First frame, shape (K,).
        size: Number of frames, shape (K,).
        contact: Segments of a stretch with events, in which small errors grow fast, shape (K,).
        struck: Those that hold an event themselves, not only frames before and after one, shape (K,).
        lying: Bodies that lie on the ground at its beginning, whatever their size, shape (K, N); None for none.
    """

    trajectories: int
    frames: int
    trajectory: Tensor
    start: Tensor
    size: Tensor
    contact: Tensor
    struck: Tensor
    lying: Tensor | None = None

    @classmethod
    def equal(cls, trajectories: int, frames: int, length: int) -> Segmentation:
        """Cut all trajectories alike, into equal parts of at most so many frames."""
        parts = -(-frames // length)
        edges = [frames * k // parts for k in range(parts + 1)]
        return cls._of([[(a, b - a, False) for a, b in pairwise(edges)]] * trajectories, frames)

    @classmethod
    def pairs(cls, trajectories: int, frames: int, first: int) -> Segmentation:
        """Cut all trajectories into pairs of a frame and the next, from the frame `first` on; one may be left over."""
        start = torch.arange(first, frames - 1, 2)
        row = torch.arange(trajectories).repeat_interleave(len(start))
        size = torch.full((len(row),), 2)
        return cls(trajectories, frames, row, start.repeat(trajectories), size, *_none(len(row)))

    @classmethod
    def whole(cls, length: Tensor, frames: int) -> Segmentation:
        """Leave trajectories of the lengths (R,) whole, of T frames with the padding."""
        count = len(length)
        zero = torch.zeros(count, dtype=torch.int64)
        return cls(count, frames, torch.arange(count), zero, length.long(), *_none(count))

    @classmethod
    def around(cls, events: Tensor, cutting: CutRule, time_step: float = 1 / 240) -> Segmentation:
        """Cut so that stretches with events become short segments, and contact-free ones stay whole.

        Args:
            events: Frames at which small errors grow fast, shape (R, T).
            cutting: Lengths.
            time_step: Time between frames [s].
        """
        cut = cls._of([_cuts(row, *cutting.frames(time_step)) for row in events], events.shape[1])
        return replace(cut, struck=cut.sum_frames(events[None].double())[0] > 0)

    @classmethod
    def _of(cls, cuts: list[list[Cut]], frames: int) -> Segmentation:
        row, start, size, contact = torch.tensor([(row, *cut) for row, own in enumerate(cuts) for cut in own]).T
        none = torch.zeros(len(row)).bool()
        return cls(len(cuts), frames, row.contiguous(), start.contiguous(), size.contiguous(), contact.bool(), none)

    def __len__(self) -> int:
        return len(self.start)

    def only(self, chosen: Tensor) -> Segmentation:
        """Return some of the segments (indices, in order); the other frames are in none."""
        trajectory, start, size, contact, struck = (
            value[chosen] for value in (self.trajectory, self.start, self.size, self.contact, self.struck)
        )
        lying = None if self.lying is None else self.lying[chosen]
        return Segmentation(self.trajectories, self.frames, trajectory, start, size, contact, struck, lying)

    @cached_property
    def seams(self) -> Tensor:
        """Frames at which a segment begins, and those after its last one, shape (R, T)."""
        found = torch.zeros(self.trajectories, self.frames + 1, dtype=torch.bool)
        for frame in (self.start, self.start + self.size):
            found[self.trajectory, frame] = True
        return found[:, :-1]

    def observe(self, effect: Effect, pose: Tensor, time: Tensor, rows: Tensor | None = None) -> Tensor:
        """Return what a camera under an effect reports, of each segment alone if it mixes frames (see `observe_apart`).

        Args:
            effect: Of perception, one value for each row or for all.
            pose: Poses of the trajectories, once or several times over, shape (B, T, N, 7).
            time: Of the frames [s], shape (B, T).
            rows: Which of these they are, shape (B,); None for all.
        """
        place = (torch.arange(len(pose)) if rows is None else rows) % self.trajectories
        return observe_apart(effect, pose, time, self.seams[place])

    @cached_property
    def batches(self) -> list[Batch]:
        """The segments, those of similar length together."""
        made, lower = [], 0
        for upper in (*CLASSES, self.frames):
            segments = ((self.size > lower) & (self.size <= upper)).nonzero()[:, 0]
            lower = max(upper, lower)
            if len(segments):
                frame = self.start[segments, None] + torch.arange(int(self.size[segments].max()))
                inside = frame < (self.start + self.size)[segments, None]
                made.append(Batch(segments, self.trajectory[segments], frame.clamp_max(self.frames - 1), inside))
        return made

    @property
    def cost(self) -> int:
        """Frames that are simulated for one variant."""
        return sum(batch.frame.numel() for batch in self.batches)

    @cached_property
    def position(self) -> Tensor:
        """How many frames each frame is after the first of its segment, shape (R, T)."""
        into = torch.zeros(1, self.trajectories, self.frames, dtype=torch.int64)
        for batch in self.batches:
            batch.put((batch.frame - self.start[batch.segments, None])[None], into)
        return into[0]

    def spread(self, value: Tensor) -> Tensor:
        """Give every frame the value (K,) of its segment, shape (R, T)."""
        table = torch.zeros(1, self.trajectories, self.frames, dtype=value.dtype)
        for batch in self.batches:
            batch.put(value[None, batch.segments, None].expand(1, *batch.frame.shape), table)
        return table[0]

    def sum_frames(self, value: Tensor) -> Tensor:
        """Sum (C, R, T) over the frames of each segment, shape (C, K)."""
        total = value.new_zeros(len(value), len(self))
        for batch in self.batches:
            total[:, batch.segments] = batch.cut(value, fill=0.0).sum(-1)
        return total

    def sum_segments(self, value: Tensor) -> Tensor:
        """Sum (K, ...) over the segments of each trajectory, shape (R, ...)."""
        return value.new_zeros(self.trajectories, *value.shape[1:]).index_add(0, self.trajectory, value)


def _none(count: int) -> tuple[Tensor, Tensor]:
    """Return that no segment is of a stretch with events, and none holds one, shape (K,) each."""
    return torch.zeros(count).bool(), torch.zeros(count).bool()


def _cuts(events: Tensor, lead: int, trail: int, longest: int, least: int) -> list[Cut]:
    """Return the segments of one trajectory; events has shape (T,)."""
    contact = events.clone()
    for frame in events.nonzero()[:, 0].tolist():
        contact[max(0, frame - lead) : frame + trail + 1] = True
    runs = _runs(contact)
    for first, count in runs:
        if not contact[first] and count < least and len(runs) > 1:
            contact[first : first + count] = True
    cuts: list[Cut] = []
    for first, count in _runs(contact):
        parts = -(-count // longest) if contact[first] else 1
        edges = [first + count * k // parts for k in range(parts + 1)]
        cuts += [(a, b - a, bool(contact[first])) for a, b in pairwise(edges)]
    return cuts


def _runs(mask: Tensor) -> list[tuple[int, int]]:
    """Return (first frame, frames) of the stretches in which a mask (T,) does not change."""
    edges = [0, *((mask[1:] != mask[:-1]).nonzero()[:, 0] + 1).tolist(), len(mask)]
    return [(a, b - a) for a, b in pairwise(edges)]


def at_once(simulate: Callable[[Batch], None], batches: Sequence[Batch]) -> None:
    """Simulate batches, as many at once as torch uses threads: threads of one batch would wait in each step."""
    threads, total = torch.get_num_threads(), sum(batch.frame.numel() for batch in batches)
    parts = [part for batch in batches for part in batch.split(max(1, round(threads * batch.frame.numel() / total)))]
    parts = sorted(parts, key=lambda part: -part.frame.numel())
    inference = torch.is_inference_mode_enabled()  # each thread has a mode of its own

    def work(part: Batch) -> None:
        with torch.inference_mode(inference):
            simulate(part)

    for _ in map(simulate, parts) if min(threads, len(parts)) == 1 else _pool(threads).map(work, parts):
        pass


@lru_cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, initializer=torch.set_num_threads, initargs=(1,))
