"""The steps in which recorded motion is simulated: from frame to frame, and where the force changes in between."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from physid.physics import check_shape

Array = NDArray[np.float64]
SHORTEST = 1e-3
"""Share of the time step below which steps are merged: at 60 frames per second and 1 m/s a body moves 17 um in it, less
than any tracker sees. The force in a merged step is the mean, so that no impulse is lost."""
ROUNDING = 1e-9  # share of the time step by which a step may be off and is the time step itself: 0.1 + 0.2 is not 0.3


@dataclass(frozen=True)
class StepGrid:
    """Steps of R trajectories; shorter ones are filled up with steps of no force, which nothing refers to.

    Attributes:
        steps: Lengths [s], shape (R, S); positive.
        wrench: Torque [N m] and force [N] that act in each step, world frame, shape (R, S, N, 6).
        frame_step: After how many steps each frame lies: the state (0 to S) that its pose is compared with, shape
            (R, T).
        count: Steps that are real, shape (R,).

    Raises:
        ValueError: If shapes disagree, a length is not positive, or a frame lies outside of the steps.
    """

    steps: Tensor
    wrench: Tensor
    frame_step: Tensor
    count: Tensor

    def __post_init__(self) -> None:
        check_shape("steps", self.steps, (None, None))
        rows, steps = self.steps.shape
        check_shape("wrench", self.wrench, (rows, steps, None, 6))
        check_shape("frame_step", self.frame_step, (rows, None))
        check_shape("count", self.count, (rows,))
        if bool((self.steps <= 0).any()):
            raise ValueError(f"steps must be positive, got {float(self.steps.min()):g} s")
        backwards = bool((self.frame_step.diff(dim=1) < 0).any())
        if backwards or bool((self.frame_step < 0).any()) or bool((self.frame_step > self.count[:, None]).any()):
            raise ValueError("frame_step must not decrease, and lie between 0 and the number of steps")

    @property
    def times(self) -> Tensor:
        """Time of each state since the first frame [s], shape (R, S + 1)."""
        return torch.nn.functional.pad(self.steps.cumsum(1), (1, 0))

    @property
    def real(self) -> Tensor:
        """Which steps are real, shape (R, S)."""
        return torch.arange(self.steps.shape[1], device=self.steps.device) < self.count[:, None]

    def between(self, row: Tensor, frame: Tensor) -> StepGrid:
        """Return the steps between consecutive frames (k, L) of trajectories (k,)."""
        states = self.frame_step[row[:, None], frame]
        first = states[:, :1]
        count = (states[:, -1:] - first).clamp_min(1)
        index = (first + torch.arange(int(count.max()), device=first.device)).clamp_max(self.steps.shape[1] - 1)
        steps, wrench = self.steps[row[:, None], index], self.wrench[row[:, None], index]
        return StepGrid(steps, wrench, states - first, count[:, 0])

    def refine(self, factors: int | Tensor) -> StepGrid:
        """Return the grid with steps that are cut into equal parts; frames stay where they are, and so do forces.

        Args:
            factors: Into how many parts: of every step, or of each, shape (R, S).

        Raises:
            ValueError: If a factor is not positive.
        """
        whole = factors if isinstance(factors, Tensor) else torch.full_like(self.frame_step[:1, :1], factors)
        parts = torch.where(self.real, whole.to(self.count).expand(self.steps.shape), 1)
        if bool((parts < 1).any()):
            raise ValueError(f"factors must be at least 1, got {int(parts.min())}")
        ends = torch.nn.functional.pad((parts * self.real).cumsum(1), (1, 0))
        count = ends.gather(1, self.count[:, None])[:, 0]
        longest = max(int(count.max()), 1)
        # Which step each part belongs to: the number of steps that end before or with it.
        place = torch.arange(longest, device=parts.device).expand(len(parts), -1).contiguous()
        owner = torch.searchsorted(ends[:, 1:].contiguous(), place, right=True).clamp_max(self.steps.shape[1] - 1)
        filled = place >= count[:, None]
        last = self.steps.gather(1, (self.count - 1).clamp_min(0)[:, None])
        steps = torch.where(filled, last, (self.steps / parts).gather(1, owner))
        wrench = self.wrench.gather(1, owner[..., None, None].expand(-1, -1, *self.wrench.shape[2:]))
        wrench = torch.where(filled[..., None, None], 0.0, wrench)
        return StepGrid(steps, wrench, ends.gather(1, self.frame_step), count)

    def parts_of(self, length: float) -> Tensor:
        """Return into how many equal parts of about a length [s] each step is cut, at least one, shape (R, S)."""
        return (self.steps / length).round().long().clamp_min(1)

    def chosen(self, which: Tensor) -> StepGrid:
        """Return the grid of some trajectories, by index or mask, no longer than they need."""
        count = self.count[which]
        longest = max(int(count.max()), 1) if len(count) else 1
        return StepGrid(self.steps[which][:, :longest], self.wrench[which][:, :longest], self.frame_step[which], count)

    def to(self, device: torch.device | str) -> StepGrid:
        """Return the same on another device."""
        return replace(self, **{name: getattr(self, name).to(device) for name in vars(self)})


@dataclass(frozen=True)
class Steps:
    """Steps of one trajectory.

    Attributes:
        lengths: [s], shape (S,).
        wrench: That acts in each, shape (S, N, 6).
        frame_step: After how many steps each frame lies, shape (T,).
    """

    lengths: Array
    wrench: Array
    frame_step: NDArray[np.int64]


def mean_wrench(grid: StepGrid) -> Tensor:
    """Return the mean wrench from each frame to the next, shape (R, T, N, 6); zero after the last frame."""
    impulse = grid.wrench * grid.steps[..., None, None]
    total = torch.cat([torch.zeros_like(impulse[:, :1]), impulse.cumsum(1)], 1)
    given = total.gather(1, grid.frame_step[..., None, None].expand(-1, -1, *total.shape[2:])).diff(dim=1)
    length = grid.times.gather(1, grid.frame_step).diff(dim=1)
    mean = given / torch.where(length > 0, length, 1.0)[..., None, None]
    return torch.cat([mean, torch.zeros_like(mean[:, :1])], 1)


def lay_steps(time: Array, wrench: Array, wrench_time: Array, time_step: float, shortest: float | None = None) -> Steps:
    """Lay steps from frame to frame that end, too, where the force changes: the union of both clocks.

    Each row of forces is held until the next (a zero-order hold); before the first there is none. A change that is
    nearer to a frame or to another change than the shortest step is no end of a step; the step's force is then the mean
    over it, so that the impulse is that of the held forces exactly.

    Args:
        time: Stamps of the frames [s], increasing, shape (T,).
        wrench: Rows of forces, shape (S, N, 6).
        wrench_time: From when on each is held [s], increasing, shape (S,).
        time_step: Nominal time between frames [s].
        shortest: Shortest step that a change of the force may cause [s]; `SHORTEST` of the time step by default. A
            longer one, say a quarter of the time step, averages forces that were logged much faster than the poses.
    """
    least = SHORTEST * time_step
    frames, switches = time - time[0], wrench_time - time[0]
    if switches[0] > 0:
        switches, wrench = np.append(0.0, switches), np.concatenate([np.zeros_like(wrench[:1]), wrench])
    change = np.append(True, (wrench[1:] != wrench[:-1]).any((1, 2)))
    switches, wrench = switches[change], wrench[change]
    kept = _thinned(frames, least)
    sides = _neighbours(kept, switches)
    closest = kept[sides[np.arange(len(switches)), np.abs(kept[sides] - switches[:, None]).argmin(1)]]
    switches = np.where(np.abs(closest - switches) <= ROUNDING * time_step, closest, switches)
    inside = switches[(switches > 0) & (switches < kept[-1])]
    near = np.searchsorted(kept, inside)
    distance = np.minimum(np.abs(kept[near] - inside), np.abs(inside - kept[near - 1]))
    apart = _thinned(inside[distance > max(least, shortest or 0.0)], max(least, shortest or 0.0))
    ends = np.sort(np.concatenate([kept, apart]))
    lengths = np.diff(ends)
    lengths = np.where(np.abs(lengths - time_step) <= ROUNDING * time_step, time_step, lengths)
    # A frame belongs to the last end that is not after it, but for those that were merged into the very last frame.
    nearest = np.abs(frames[:, None] - ends[_neighbours(ends, frames)]).argmin(1)
    frame_step = _neighbours(ends, frames)[np.arange(len(frames)), nearest]
    return Steps(lengths, _held(ends, switches, wrench), np.maximum.accumulate(frame_step))


def _neighbours(ends: Array, times: Array) -> NDArray[np.int64]:
    """Return the two ends of steps beside each time, shape (n, 2)."""
    right = np.searchsorted(ends, times).clip(0, len(ends) - 1)
    return np.stack([np.maximum(right - 1, 0), right], 1)


def _held(ends: Array, switches: Array, wrench: Array) -> Array:
    """Return the mean (S, N, 6) over each step of forces that are held from each switch to the next."""
    if len(ends) < 2:
        return np.zeros((0, *wrench.shape[1:]))
    cuts = np.union1d(ends, switches[(switches > 0) & (switches < ends[-1])])
    row = np.searchsorted(switches, cuts[:-1], side="right") - 1
    first = np.searchsorted(cuts, ends[:-1])
    parts = np.diff(np.append(first, len(row)))
    mean = wrench[row[first]]
    mixed = np.flatnonzero(parts > 1)
    if len(mixed):
        # Of steps with several forces in them; all others keep theirs to the last bit.
        share = np.diff(cuts)[:, None, None] * wrench[row]
        whole = np.add.reduceat(share, first, axis=0)
        mean[mixed] = whole[mixed] / np.diff(ends)[mixed, None, None]
    return mean


def _thinned(times: Array, least: float) -> Array:
    """Leave out times that are nearer than `least` to the one kept before them; the first stays."""
    while len(times) > 1 and (close := np.diff(times) < least).any():
        # Of close ones in a row every second goes: those beside them are then looked at again.
        run = np.arange(len(close)) - np.maximum.accumulate(np.where(close, -1, np.arange(len(close))))
        times = np.delete(times, np.flatnonzero(close & (run % 2 == 1)) + 1)
    return times


def stacked(rows: Sequence[Steps], frames: int, time_step: float) -> StepGrid:
    """Stack the steps of trajectories; shorter ones are filled up.

    Args:
        rows: Of each trajectory.
        frames: Frames T of the longest.
        time_step: Length of the steps that fill up [s].
    """
    longest = max(1, *(len(one.lengths) for one in rows))
    shape = (len(rows), longest, *rows[0].wrench.shape[1:])
    steps, wrench = np.full(shape[:2], time_step), np.zeros(shape)
    frame_step = np.empty((len(rows), frames), dtype=np.int64)
    for row, one in enumerate(rows):
        steps[row, : len(one.lengths)], wrench[row, : len(one.lengths)] = one.lengths, one.wrench
        frame_step[row] = one.frame_step[np.minimum(np.arange(frames), len(one.frame_step) - 1)]
    count = torch.tensor([len(one.lengths) for one in rows])
    return StepGrid(torch.from_numpy(steps), torch.from_numpy(wrench), torch.from_numpy(frame_step), count)
