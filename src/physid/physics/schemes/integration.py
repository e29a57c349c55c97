"""How velocities become poses: the scheme of a step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final


class Integration:
    """A scheme of integration: one of those of this file."""


@final
@dataclass(frozen=True)
class SemiImplicit(Integration):
    """Poses move with the velocity at the end of the step, x+ = x + h v+: first order, what most simulators do.

    The scheme for recordings that such a simulator made with the same step: its error is then that of the recording.
    """


@final
@dataclass(frozen=True)
class Midpoint(Integration):
    """Poses move with the mean velocity, x+ = x + h (v + v+) / 2: second order between events, for any recording.

    Half the step with the velocity before, free of forces; there, at the midpoint, forces, contacts and the velocity
    after; the other half with that (Moreau 1988). The turning of a free body keeps its energy and angular momentum. An
    impact takes place where in the step it falls (see `physid.physics.schemes.impact`).
    """
