"""A ground that changes with time, for instance as it wears or dries."""

from dataclasses import dataclass
from typing import ClassVar, final

from torch import Tensor

from physid.physics import Effect, Site, State, StepInputs, quantity


@final
@dataclass(frozen=True)
class FrictionDrift(Effect):
    """mu' = mu (1 + a t), at least 0, t the time since the first frame.

    Attributes:
        rate: a [1/s].
    """

    name: ClassVar[str] = "friction_drift"
    site: ClassVar[Site] = "contact"
    rate: Tensor = quantity("1/s", low=-0.5, high=3.0, typical=0.3)

    def act(self, state: State, inputs: StepInputs) -> StepInputs:
        """Change the friction with the ground by time."""
        factor = (1 + self.rate * inputs.time).clamp_min(0)[:, None]
        return inputs.replace(ground_friction=inputs.ground_friction * factor)
