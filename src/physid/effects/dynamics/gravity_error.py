"""Gravity that is stronger or weaker than believed."""

from dataclasses import dataclass
from typing import ClassVar, final

from torch import Tensor

from physid.physics import Effect, Site, State, StepInputs, quantity


@final
@dataclass(frozen=True)
class GravityError(Effect):
    """g' = (1 + k) g.

    Attributes:
        change: k [-].
    """

    name: ClassVar[str] = "gravity_error"
    site: ClassVar[Site] = "dynamics"
    change: Tensor = quantity("-", low=-0.5, high=0.5, typical=0.05)

    def act(self, state: State, inputs: StepInputs) -> StepInputs:
        """Scale gravity."""
        return inputs.replace(gravity=inputs.gravity * (1 + self.change[:, None, None]))
