"""When the steps of a rollout begin, and how long they last: the same for all worlds, or for each world and step."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from physid.physics.effect import Effect
from physid.physics.state import State, check_shape
from physid.physics.world import World

CLOCKS = (1 / 240, 1 / 160)
"""Two time steps between which an actuation effect shows whether it depends on them [s]."""

PROBED = 64
"""Commands that it is shown: enough for what it remembers over a third of a second."""


@dataclass(frozen=True)
class TimeGrid:
    """The steps of the engine in a rollout, T frames of `world.substeps` equal steps each.

    Attributes:
        begin: Time at which each step begins [s], on the clock that effects see, shape (B or 1, T substeps).
        length: h of each step [s], shape (B or 1, T substeps).
        even: Whether every step is as long as `world.step`.
    """

    begin: Tensor
    length: Tensor
    even: bool

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
        return cls(begin, length, steps is None)

    def time(self, step: int) -> Tensor:
        """Return the time at which a step begins [s], shape (B or 1,)."""
        return self.begin[:, step]

    def step(self, step: int) -> Tensor:
        """Return the length of a step [s], shape (B or 1,)."""
        return self.length[:, step]

    @property
    def uneven(self) -> Tensor | None:
        """The lengths of the steps, or None where all are `world.step`."""
        return None if self.even else self.length


def _check(name: str, value: Tensor, shape: tuple[int | None, ...], batch: int) -> None:
    check_shape(name, value, shape)
    if value.shape[0] not in (1, batch):
        raise ValueError(f"{name} must have a first axis of 1 or {batch}, one for each world, got {value.shape[0]}")


def require_no_clock(effect: Effect) -> None:
    """Refuse an actuation effect that counts time in steps of one length where steps differ.

    Raises:
        ValueError: If what it does to commands at its typical size depends on the time step.
    """
    typical = {name: torch.tensor([size.typical], dtype=torch.float64) for name, size in effect.quantities().items()}
    probe, ramp = effect.replace(**typical), torch.arange(1.0, PROBED + 1, dtype=torch.float64)
    wrench = ramp[None, :, None, None].expand(1, PROBED, 1, 6)
    if not torch.equal(*(probe.actuate(wrench, step) for step in CLOCKS)):
        raise ValueError(
            f"{effect.name} shifts or filters commands in steps of one length, but the steps of this rollout differ; "
            "let it act on the commands at their own rate first, and roll out without it"
        )
