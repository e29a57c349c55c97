"""When the steps of a rollout begin, and how long they last: the same for all worlds, or for each world and step."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from physid.physics.state import State, check_shape
from physid.physics.world import World


@dataclass(frozen=True)
class TimeGrid:
    """The steps of the engine in a rollout, T frames of `world.substeps` equal steps each.

    Attributes:
        begin: Time at which each step begins [s], on the clock that effects see, shape (B or 1, T substeps).
        length: h of each step [s], shape (B or 1, T substeps).
        even: Whether every step is as long as `world.step`.
        substeps: Steps in a frame.
        midpoint: Whether forces are taken at the middle of a step.
    """

    begin: Tensor
    length: Tensor
    even: bool
    substeps: int
    midpoint: bool

    @classmethod
    def of(
        cls, world: World, state: State, frames: int, steps: Tensor | None = None, start: Tensor | None = None
    ) -> TimeGrid:
        """Lay out the steps of a rollout.

        Args:
            world: Its time step and substeps.
            state: The states at the first frame.
            frames: T.
            steps: Length of each frame [s], shape (B or 1, T); None for `world.time_step`.
            start: Time of the first frame on the clock that effects see [s], shape (B or 1,); None for 0.

        Raises:
            ValueError: If a shape is off, a value is not finite, or a length is not positive.
        """
        like, batch, substeps = state.pose.detach(), state.pose.shape[0], world.substeps
        if steps is None:
            count = torch.arange(frames * substeps, dtype=like.dtype, device=like.device)
            begin, length = (count * world.step)[None], like.new_full((1, frames * substeps), world.step)
        else:
            _check("steps", steps, (None, frames), batch)
            if not bool((steps > 0).all()):
                raise ValueError(f"steps must be positive lengths of time [s], got {float(steps.min()):.6g}")
            length = (steps.detach().to(like) / substeps).repeat_interleave(substeps, 1)
            begin = length.cumsum(1) - length
        if start is not None:
            _check("start", start, (None,), batch)
            begin = begin + start.detach().to(like)[:, None]
        return cls(begin, length, steps is None, substeps, world.midpoint)

    @cached_property
    def time(self) -> Tensor:
        """Time at which forces are taken [s], the beginning of a step or under `Midpoint` its middle; as `begin`."""
        return self.begin + self.length / 2 if self.midpoint else self.begin

    def until_forces(self, step: int) -> Tensor | None:
        """Return how long after the beginning of a step forces are taken [s], shape (B or 1,); None for no time."""
        return self.length[:, step] / 2 if self.midpoint else None

    def step(self, step: int) -> Tensor:
        """Return the length of a step [s], shape (B or 1,)."""
        return self.length[:, step]

    @property
    def frames(self) -> Tensor:
        """Times at which the frames begin [s], shape (B or 1, T)."""
        return self.begin[:, :: self.substeps]

    @property
    def uneven(self) -> Tensor | None:
        """The lengths of the steps, or None where all are `world.step`."""
        return None if self.even else self.length


def _check(name: str, value: Tensor, shape: tuple[int | None, ...], batch: int) -> None:
    check_shape(name, value, shape)
    if value.shape[0] not in (1, batch):
        raise ValueError(f"{name} must have a first axis of 1 or {batch}, one for each world, got {value.shape[0]}")
