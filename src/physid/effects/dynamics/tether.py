"""A spring that pulls towards the middle of the workspace, such as a cable."""

from dataclasses import dataclass
from typing import ClassVar, final

from torch import Tensor

from physid.physics import Effect, Site, State, StepInputs, quantity


@final
@dataclass(frozen=True)
class Tether(Effect):
    """F = -k x at the centre of each body, x its position from the world's origin (Hooke 1678).

    An anchor elsewhere, -k (x - x0), is this effect together with `constant_force` k x0: x0 alone would have no
    derivative at k = 0.

    Attributes:
        stiffness: k [N/m].
    """

    name: ClassVar[str] = "tether"
    site: ClassVar[Site] = "dynamics"
    stiffness: Tensor = quantity("N/m", low=0.0, high=50.0, typical=1.0)

    def act(self, state: State, inputs: StepInputs) -> StepInputs:
        """Add the pull of the spring."""
        return inputs.add_force(-self.stiffness[:, None, None] * state.position)
