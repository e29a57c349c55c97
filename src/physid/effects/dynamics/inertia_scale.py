"""Mass that lies further out, or closer in, than in a uniform box."""

from dataclasses import dataclass
from typing import ClassVar, final

from torch import Tensor

from physid.physics import Effect, Site, State, StepInputs, quantity


@final
@dataclass(frozen=True)
class InertiaScale(Effect):
    """I' = (1 + k) I for all principal moments, at the same mass.

    No box turns harder than with all its mass in its corners, m (b^2 + c^2) / 4 instead of m (b^2 + c^2) / 12: k <= 2.
    With all of it in its faces, k is at most 2/3 for a cube; k = -1 is a point.

    Attributes:
        change: k [-].
    """

    name: ClassVar[str] = "inertia_scale"
    site: ClassVar[Site] = "dynamics"
    change: Tensor = quantity("-", low=-0.8, high=2.0, typical=0.3)

    def act(self, state: State, inputs: StepInputs) -> StepInputs:
        """Scale the moments of inertia."""
        return inputs.replace(inertia=inputs.inertia * (1 + self.change[:, None, None]))
