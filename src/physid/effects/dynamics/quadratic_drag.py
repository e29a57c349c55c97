"""Drag in proportion to speed squared."""

from dataclasses import dataclass
from typing import ClassVar, final

from torch import Tensor

from physid.physics import Effect, Site, State, StepInputs, quantity

SMALLEST = 1e-9  # [m/s] keeps the derivative of the length of a speed finite at zero


@final
@dataclass(frozen=True)
class QuadraticDrag(Effect):
    """F = -c |v| v at the centre of each body (Newton 1687; c is half the density times drag coefficient and area).

    Attributes:
        coefficient: c [kg/m].
    """

    name: ClassVar[str] = "quadratic_drag"
    site: ClassVar[Site] = "dynamics"
    coefficient: Tensor = quantity("kg/m", low=0.0, high=5.0, typical=0.3)

    def act(self, state: State, inputs: StepInputs) -> StepInputs:
        """Add the drag force."""
        speed = state.velocity.square().sum(-1, keepdim=True).clamp_min(SMALLEST**2).sqrt()
        return inputs.add_force(-self.coefficient[:, None, None] * speed * state.velocity)
