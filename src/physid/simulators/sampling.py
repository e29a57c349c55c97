"""When poses are taken and forces change: on the steps of a simulation, so that both are exact."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from physid.simulators.motion import between_frames
from physid.simulators.protocol import Simulator
from physid.strict import LARGEST

if TYPE_CHECKING:
    from physid.physics import Effect

Indices = NDArray[np.intp]
FINE = 1e-3  # [s] between instants where something happens between the frames
LEAST_PARTS = 20  # steps between two frames from which on a stamp can be put on a step: 5 % of the frames' distance
MOST_JITTER = 0.4  # [-] stamps that wander farther could come out of order
ROUNDING = 1e-9  # [-] quotients that differ from a whole number by less are one


@dataclass(frozen=True)
class Sampling:
    """A grid of simulated instants, those at which poses are taken, and those from which forces are held.

    Attributes:
        step: Between two instants of the grid [s].
        substeps: Steps of the simulator between two instants; None for its own choice.
        frames: Instants of the frames, shape (T,).
        forces: Instants from which each row of the forces is held, shape (S,); the first is 0.
        wander: How many instants a frame may be off its place.
    """

    step: float
    substeps: int | None
    frames: Indices
    forces: Indices
    wander: int = 0

    @property
    def length(self) -> int:
        """Instants to simulate."""
        return int(self.frames[-1]) + self.wander + 1

    def stamps(self, instants: Indices) -> NDArray[np.float64]:
        """Return the times of some instants [s]."""
        return self.step * instants.astype(np.float64)

    def held(self) -> Indices:
        """Return the row of the forces that is held from each instant, shape (length,)."""
        return np.searchsorted(self.forces, np.arange(self.length), side="right") - 1

    def draw_frames(self, generator: np.random.Generator, missing: float) -> Indices:
        """Draw the instants of the frames that are recorded: each wanders evenly, and some are lost.

        The first frame stays where it is, and is there.

        Args:
            generator: Source of randomness.
            missing: Share of the frames that are lost [-].
        """
        off = np.rint(self.wander * generator.uniform(-1.0, 1.0, len(self.frames))).astype(np.intp)
        there = generator.uniform(size=len(self.frames)) >= missing
        off[0], there[:2] = 0, True
        return np.asarray((self.frames + off)[there])


def sample(
    time_step: float,
    count: int,
    simulator: Simulator,
    *,
    substeps: int | None = None,
    jitter: float = 0.0,
    force_rate: float | None = None,
    effects: Sequence[Effect] = (),
) -> Sampling:
    """Choose the grid of a simulation.

    Without jitter, and with forces at the rate of the frames, the grid is that of the frames, or, if an effect acts
    between them, that of the simulator's steps, which one that is not stepped like the model makes no longer than
    `FINE`. Otherwise it is that of the forces or finer, and each frame is taken at the instant next to its time.

    Args:
        time_step: Between frames [s].
        count: Frames T.
        simulator: Who simulates.
        substeps: Steps of the simulator between two frames; None for its own choice.
        jitter: Largest share of the time step by which a frame is off its time [-].
        force_rate: Rows of the forces per second [Hz]; None for that of the frames.
        effects: Effects at work; some act between the frames: forces that come late, a camera with a clock of its own.

    Raises:
        ValueError: If the simulator would take more steps than anybody has time and memory for.
    """
    fine = any(between_frames(effect) for effect in effects)
    parts = substeps or simulator.substeps_for(time_step)
    _require_few(time_step, count, parts)
    if jitter == 0 and force_rate is None:
        if fine and simulator.integration(time_step) is None:
            parts = max(parts, math.ceil(time_step / FINE - ROUNDING))
            _require_few(time_step, count, parts)
        if not fine or parts == 1:
            index = np.arange(count)
            return Sampling(time_step, substeps, index, index)
        index = parts * np.arange(count)
        return Sampling(time_step / parts, 1, index, index)
    period = time_step if force_rate is None else 1 / force_rate
    parts = max(LEAST_PARTS, parts)
    each = max(1, math.ceil(period * parts / time_step - ROUNDING))
    step = period / each
    _require_few(time_step, count, math.ceil(time_step / step))
    frames = np.rint(np.arange(count) * (time_step / step)).astype(np.intp)
    wander = math.floor(jitter * time_step / step + ROUNDING)
    end = int(frames[-1]) + wander
    return Sampling(step, 1, frames, np.arange(0, end + 1, each), wander)


def _require_few(time_step: float, count: int, parts: int) -> None:
    """Refuse a trajectory of more steps of the simulator than can be taken."""
    if count * parts > LARGEST["instants"]:
        raise ValueError(
            f"steps, substeps: expected at most {LARGEST['instants']} steps of the simulator in a trajectory, got "
            f"{count} frames, {time_step:.3g} s apart, of {parts} steps each; lower steps or substeps, or change "
            "frame_rate or force_rate"
        )
