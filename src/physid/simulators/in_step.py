"""Worlds that a simulator steps side by side, so that the effects are asked once for all of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from physid.scenes import Excitation

Array = NDArray[np.float64]
State = TypeVar("State", covariant=True)


class Worlds(Protocol[State]):
    """Worlds of a simulator, the longest first."""

    def states(self) -> Sequence[State]:
        """Return the present state of each world."""
        ...

    def act(self, time: Array, wrench: Array) -> None:
        """Apply wrenches (B, N, 6), and what effects change at some times (B,) [s], for the next step."""
        ...

    def advance(self) -> None:
        """Take one step in all worlds."""
        ...

    def keep(self, worlds: int) -> None:
        """Go on with the first so many worlds."""
        ...


def longest_first(excitations: Sequence[Excitation]) -> list[int]:
    """Return the numbers of the excitations, that with most rows first."""
    return sorted(range(len(excitations)), key=lambda world: -len(excitations[world].wrench))


def step_all(
    worlds: Worlds[State], wrenches: Sequence[Array], clocks: Array, time_step: float, substeps: int
) -> list[list[State]]:
    """Step worlds to their ends, and return the states of each at its frames.

    Args:
        worlds: At their initial states.
        wrenches: What acts in each, shapes (T, N, 6), the longest first; row t is held from frame t to frame t + 1.
        clocks: Times that effects see at the first frames [s], shape (B,).
        time_step: Between frames [s].
        substeps: Steps from frame to frame.
    """
    seen, running = [[state] for state in worlds.states()], len(wrenches)
    for frame in range(len(wrenches[0]) - 1):
        if (still := sum(len(wrench) > frame + 1 for wrench in wrenches)) < running:
            running = still
            worlds.keep(running)
        held = np.stack([wrench[frame] for wrench in wrenches[:running]])
        for part in range(substeps):
            worlds.act(clocks[:running] + time_step * (frame + part / substeps), held)
            worlds.advance()
        for states, state in zip(seen, worlds.states(), strict=False):
            states.append(state)
    return seen
