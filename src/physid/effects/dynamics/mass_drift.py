"""A body that fills or empties."""

from dataclasses import dataclass
from typing import ClassVar, final

from torch import Tensor

from physid.physics import Effect, Site, State, StepInputs, quantity


@final
@dataclass(frozen=True)
class MassDrift(Effect):
    """m' = m (1 + a t), and the moments of inertia alike, kept above 5 %; what comes or goes moves with the body.

    Attributes:
        rate: a [1/s].
    """

    name: ClassVar[str] = "mass_drift"
    site: ClassVar[Site] = "dynamics"
    rate: Tensor = quantity("1/s", low=-0.5, high=2.0, typical=0.2)

    def act(self, state: State, inputs: StepInputs) -> StepInputs:
        """Scale mass and moments of inertia."""
        share = (1 + self.rate * inputs.time).clamp_min(0.05)[:, None]
        return inputs.replace(mass=inputs.mass * share, inertia=inputs.inertia * share[..., None])
