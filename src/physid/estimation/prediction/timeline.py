"""When the poses of trajectories were recorded, and which steps and forces lie between them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import torch
from torch import Tensor

from physid.data.observations.step_grid import StepGrid, mean_wrench
from physid.estimation.prediction.segments import Batch


@dataclass(frozen=True)
class Timeline:
    """Frames and steps of R trajectories.

    Attributes:
        time: Times of the T frames on the clock that effects see [s], shape (R, T).
        grid: Steps of the engine, and the forces that act in them.
    """

    time: Tensor
    grid: StepGrid

    @classmethod
    def regular(cls, wrench: Tensor, time_step: float) -> Timeline:
        """Lay out frames that are one time step apart, with a wrench (R, T, N, 6) held from each to the next."""
        rows, frames = wrench.shape[:2]
        index = torch.arange(frames).expand(rows, -1)
        steps = max(frames - 1, 1)
        grid = StepGrid(
            torch.full((rows, steps), time_step, dtype=torch.float64),
            wrench[:, :steps],
            index.clamp_max(steps),
            torch.full((rows,), steps),
        )
        return cls(time_step * index.double(), grid)

    @property
    def frames(self) -> int:
        """Frames T."""
        return self.time.shape[1]

    @cached_property
    def edges(self) -> Tensor:
        """Times at which steps begin and end [s], shape (R, S + 1)."""
        return self.grid.times + self.time[:, :1]

    def wrench_between(self, edges: Tensor) -> Tensor:
        """Return the mean wrenches between other times (C, R, S + 1) than those of the steps, (C, R, S, N, 6).

        Before the first frame there is none; after the last step the last one is held.
        """
        grid, count = self.grid, len(edges)
        impulse = grid.wrench * (grid.steps * grid.real)[..., None, None]
        given = torch.nn.functional.pad(impulse.cumsum(1), (0, 0, 0, 0, 1, 0))
        end = self.edges.gather(1, grid.count[:, None])
        last = grid.wrench.gather(1, (grid.count - 1).clamp_min(0)[:, None, None, None].expand(-1, 1, *given.shape[2:]))
        wanted = edges.transpose(0, 1).flatten(1)
        inside = wanted.clamp(self.edges[:, :1], end)
        right = torch.searchsorted(self.edges.contiguous(), inside.contiguous()).clamp_min(1)
        low, high = self.edges.gather(1, right - 1), self.edges.gather(1, right)
        share = ((inside - low) / (high - low))[..., None, None]
        index = right[..., None, None].expand(-1, -1, *given.shape[2:])
        total = torch.lerp(given.gather(1, index - 1), given.gather(1, index), share)
        total = total + (wanted - end).clamp_min(0)[..., None, None] * last
        between = total.unflatten(1, (count, -1)).transpose(0, 1).diff(dim=2)
        mean: Tensor = between / edges.diff(dim=2)[..., None, None]
        return mean

    @cached_property
    def step_time(self) -> Tensor:
        """Time at which each step begins [s], shape (R, S)."""
        return self.edges[:, :-1]

    @cached_property
    def owner(self) -> Tensor:
        """The frame after which each step comes, shape (R, S)."""
        count = torch.arange(self.grid.steps.shape[1]).expand(len(self.time), -1).contiguous()
        frame = torch.searchsorted(self.grid.frame_step.contiguous(), count, right=True) - 1
        return frame.clamp(0, self.frames - 1)

    @cached_property
    def wrench(self) -> Tensor:
        """The mean wrench from each frame to the next, shape (R, T, N, 6); zero after the last frame."""
        return mean_wrench(self.grid)

    def on_steps(self, wrench: Tensor) -> Tensor:
        """Turn wrenches held from frame to frame, (C, R, T, N, 6), into those of the steps, (C, R, S, N, 6)."""
        index = self.owner[None, ..., None, None].expand(len(wrench), -1, -1, *wrench.shape[3:])
        return wrench.gather(2, index)

    def refined(self, factors: int | Tensor) -> Timeline:
        """Return the same frames with steps cut into equal parts; see `StepGrid.refine`."""
        return replace(self, grid=self.grid.refine(factors))

    def cut(self, batch: Batch) -> Steps:
        """Find the steps of the segments of a batch."""
        rows, states = batch.trajectory[:, None], self.grid.frame_step
        first = states[batch.trajectory, batch.frame[:, 0]]
        last = torch.where(batch.inside, states[rows, batch.frame], 0).amax(1)
        count = (last - first).clamp_min(1)
        index = first[:, None] + torch.arange(int(count.max()))
        index = index.clamp_max(self.grid.steps.shape[1] - 1)
        at = (states[rows, batch.frame] - first[:, None]).minimum((last - first)[:, None])
        return Steps(
            batch.trajectory, index, count, at, self.grid.steps[rows, index], self.step_time[rows, index][:, 0]
        )

    def cost(self, batch: Batch) -> int:
        """Return how many steps of worlds the segments of a batch take."""
        return self.cut(batch).index.numel()


@dataclass(frozen=True)
class Steps:
    """The steps of k segments of L frames, the longest of S steps.

    Attributes:
        trajectory: Whose the segments are, shape (k,).
        index: Steps of the trajectory, shape (k, S); beyond the end of a segment any.
        count: Steps that a segment has, shape (k,).
        at: After how many of them each frame lies, after all of them beyond the end of a segment, shape (k, L).
        length: Of each step [s], shape (k, S).
        start: Time of the first frame [s], shape (k,).
    """

    trajectory: Tensor
    index: Tensor
    count: Tensor
    at: Tensor
    length: Tensor
    start: Tensor

    def wrench(self, whole: Tensor) -> Tensor:
        """Return the wrenches of the steps, (C, k, S, N, 6), from those of all trajectories, (C, R, S', N, 6)."""
        place = (self.trajectory[:, None] * whole.shape[2] + self.index).flatten()
        cut: Tensor = whole.flatten(1, 2).index_select(1, place).unflatten(1, self.index.shape)
        return cut

    def at_frames(self, states: Tensor) -> Tensor:
        """Pick what holds at the frames, (k, C, L, ...), from what holds after each step, (k C, S + 1, ...)."""
        each = states.unflatten(0, (len(self.at), -1))
        index = self.at.reshape(len(self.at), 1, -1, *[1] * (each.ndim - 3))
        picked: Tensor = each.gather(2, index.expand(-1, each.shape[1], -1, *each.shape[3:]))
        return picked

    def between_frames(self, values: Tensor) -> Tensor:
        """Sum what happens in each step, (k C, S, ...), up to the next frame; (k, C, L, ...), zero in the last."""
        total = torch.cat([torch.zeros_like(values[:, :1]), values.cumsum(1)], 1)
        part = self.at_frames(total).diff(dim=2)
        return torch.cat([part, torch.zeros_like(part[:, :, :1])], 2)
