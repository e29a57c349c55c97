"""Bodies that bounce off each other more, or less, than believed."""

from dataclasses import dataclass
from typing import ClassVar, final

from torch import Tensor

from physid.physics import Effect, Site, State, StepInputs, quantity


@final
@dataclass(frozen=True)
class ObjectRestitution(Effect):
    """e' = e + k, at least 0, for the restitution between bodies (Newton 1687).

    Attributes:
        change: k [-].
    """

    name: ClassVar[str] = "object_restitution"
    site: ClassVar[Site] = "contact"
    change: Tensor = quantity("-", low=-0.9, high=0.9, typical=0.3)

    def act(self, state: State, inputs: StepInputs) -> StepInputs:
        """Add to the restitution between bodies."""
        return inputs.replace(body_restitution=inputs.body_restitution + self.change)
