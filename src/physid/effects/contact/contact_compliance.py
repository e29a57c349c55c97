"""A ground that gives way under load."""

from dataclasses import dataclass
from typing import ClassVar, final

from torch import Tensor

from physid.physics import Effect, Site, State, StepInputs, quantity


@final
@dataclass(frozen=True)
class ContactCompliance(Effect):
    """C' = C + k: each contact with the ground sinks in by C times its force, as a spring of stiffness 1 / C.

    A body of mass m on four corners is damped critically: by a damper of sqrt(C m) / C beside each spring. What bounces
    does so as off a rigid ground, but where recordings are PyBullet's, whose spring takes up the blow
    (docs/decisions/0065-a-ground-that-yields.md).

    Attributes:
        compliance: k [m/N].
    """

    name: ClassVar[str] = "contact_compliance"
    site: ClassVar[Site] = "contact"
    compliance: Tensor = quantity("m/N", low=0.0, high=1e-3, typical=1e-4)

    def act(self, state: State, inputs: StepInputs) -> StepInputs:
        """Soften the contacts with the ground."""
        return inputs.replace(compliance=inputs.compliance + self.compliance[:, None])
