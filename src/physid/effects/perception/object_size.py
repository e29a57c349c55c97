"""Bodies that are larger, or smaller, than they were measured."""

from dataclasses import dataclass
from typing import ClassVar, final

from torch import Tensor

from physid.physics import Effect, Site, State, StepInputs, quantity


@final
@dataclass(frozen=True)
class ObjectSize(Effect):
    """s' = (1 + k) s for the edge lengths, I' = (1 + k)^2 I for the moments that were computed from them.

    What was measured wrong decides when bodies touch, so this effect of perception acts at the step.

    Attributes:
        change: k [-].
    """

    name: ClassVar[str] = "object_size"
    site: ClassVar[Site] = "perception"
    change: Tensor = quantity("-", low=-0.3, high=0.3, typical=0.05)

    def act(self, state: State, inputs: StepInputs) -> StepInputs:
        """Scale sizes and moments of inertia."""
        ratio = 1 + self.change[:, None, None]
        return inputs.replace(size=inputs.size * ratio, inertia=inputs.inertia * ratio**2)
