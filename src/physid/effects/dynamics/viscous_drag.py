"""Drag in proportion to speed."""

from dataclasses import dataclass
from typing import ClassVar, final

from torch import Tensor

from physid.physics import Effect, Site, State, StepInputs, quantity


@final
@dataclass(frozen=True)
class ViscousDrag(Effect):
    """F = -c v at the centre of each body (Stokes 1851).

    Attributes:
        coefficient: c [N s/m].
    """

    name: ClassVar[str] = "viscous_drag"
    site: ClassVar[Site] = "dynamics"
    coefficient: Tensor = quantity("N s/m", low=0.0, high=5.0, typical=0.3)

    def act(self, state: State, inputs: StepInputs) -> StepInputs:
        """Add the drag force."""
        return inputs.add_force(-self.coefficient[:, None, None] * state.velocity)
