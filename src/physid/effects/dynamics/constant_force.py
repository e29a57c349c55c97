"""A force that is always there, such as a steady wind."""

from dataclasses import dataclass
from typing import ClassVar, final

import torch
from torch import Tensor

from physid.physics import Effect, Site, State, StepInputs, quantity


@final
@dataclass(frozen=True)
class ConstantForce(Effect):
    """F = (x, y, 0) at the centre of each body, world frame.

    Attributes:
        x: [N].
        y: [N].
    """

    name: ClassVar[str] = "constant_force"
    site: ClassVar[Site] = "dynamics"
    x: Tensor = quantity("N", low=-5.0, high=5.0, typical=0.5)
    y: Tensor = quantity("N", low=-5.0, high=5.0, typical=0.5)

    def act(self, state: State, inputs: StepInputs) -> StepInputs:
        """Add the force."""
        force = torch.stack([self.x, self.y, torch.zeros_like(self.x)], -1)[:, None]
        return inputs.add_force(force.expand_as(state.velocity))
