"""A ground off which bodies bounce higher, or lower, than believed."""

from dataclasses import dataclass
from typing import ClassVar, final

from torch import Tensor

from physid.physics import Effect, Site, State, StepInputs, quantity


@final
@dataclass(frozen=True)
class GroundRestitution(Effect):
    """e' = e + k, at least 0, for the restitution of each body with the ground (Newton 1687).

    Attributes:
        change: k [-].
    """

    name: ClassVar[str] = "ground_restitution"
    site: ClassVar[Site] = "contact"
    change: Tensor = quantity("-", low=-0.9, high=0.9, typical=0.2)

    def act(self, state: State, inputs: StepInputs) -> StepInputs:
        """Add to the restitution with the ground."""
        return inputs.replace(ground_restitution=inputs.ground_restitution + self.change[:, None])
