"""Units of the contact problem of a step, in which a body at rest has numbers of order one."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

STANDARD_GRAVITY = 9.81
FINE = 1e-3
"""Steps shorter than this do not make the unit of velocities smaller: an impact would become too large a number [s]."""


def velocity_unit(step: float, *, midpoint: bool) -> float:
    """Return the unit of velocities in the contact problem, g h [m/s], for a step h [s]; see also `FINE`."""
    return STANDARD_GRAVITY * (max(step, FINE) if midpoint else step)


@dataclass(frozen=True)
class Units:
    """The units of a batch of contact problems.

    Attributes:
        step: h [s], shape (B or 1,).
        velocity: g h [m/s], shape (B or 1,); see also `FINE`.
        mass: m, the mean over the bodies of a world [kg], shape (B,).
    """

    step: Tensor
    velocity: Tensor
    mass: Tensor

    @classmethod
    def of(cls, step: Tensor, mass: Tensor, *, midpoint: bool) -> Units:
        """Choose the units for steps (B or 1,) [s] of bodies of some masses (B, N) [kg]."""
        return cls(step, STANDARD_GRAVITY * (step.clamp_min(FINE) if midpoint else step), mass.mean(1))

    @property
    def impulse(self) -> Tensor:
        """The unit of impulses, m g h [N s], shape (B,)."""
        return self.mass * self.velocity
