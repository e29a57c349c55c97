"""How velocities become poses: the scheme of a step."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import final


class Integration:
    """A scheme of integration: one of those of this file."""


@final
@dataclass(frozen=True)
class SemiImplicit(Integration):
    """Poses move with the velocity at the end of the step, x+ = x + h v+: first order, what most simulators do.

    The scheme for recordings that such a simulator made with the same step: its error is then that of the recording. A
    longer step stands for n = h / s of the simulator's: where a force is constant, these move a body by

        s (v_1 + ... + v_n) = h (v+ - (1 - s / h) / 2 (v+ - v)),

    and so does the step. What a force that changes, or an impact, does between them is left out. A step shorter than s
    ends where the motion x + t v + a t (t + s) / 2 through the ends of the simulator's steps is then.

    Attributes:
        step: Length s of the simulator's steps [s]; None for that of each step of the engine.

    Raises:
        ValueError: If the length is not positive.
    """

    step: float | None = None

    def __post_init__(self) -> None:
        if self.step is not None and not (math.isfinite(self.step) and self.step > 0):
            raise ValueError(f"integration.step must be positive [s], or left out, got {self.step}")


@final
@dataclass(frozen=True)
class Midpoint(Integration):
    """Poses move with the mean velocity, x+ = x + h (v + v+) / 2: second order between events, for any recording.

    Half the step with the velocity before, free of forces; there, at the midpoint, forces, contacts and the velocity
    after; the other half with that (Moreau 1988). The turning of a free body keeps its energy and angular momentum. An
    impact takes place where in the step it falls (see `physid.physics.schemes.impact`).
    """
