"""Bodies that rub on each other more, or less, than believed."""

from dataclasses import dataclass
from typing import ClassVar, final

from torch import Tensor

from physid.physics import Effect, Site, State, StepInputs, quantity


@final
@dataclass(frozen=True)
class ObjectFriction(Effect):
    """mu' = (1 + k) mu for the friction between bodies, the product of their coefficients.

    Attributes:
        change: k [-].
    """

    name: ClassVar[str] = "object_friction"
    site: ClassVar[Site] = "contact"
    change: Tensor = quantity("-", low=-0.9, high=30.0, typical=5.0)

    def act(self, state: State, inputs: StepInputs) -> StepInputs:
        """Scale the friction between bodies."""
        return inputs.replace(body_friction=inputs.body_friction * (1 + self.change))
