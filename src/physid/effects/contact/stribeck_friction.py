"""Friction that is higher at low speed."""

from dataclasses import dataclass
from typing import ClassVar, final

from torch import Tensor

from physid.effects.touch import slip
from physid.physics import Effect, Site, State, StepInputs, quantity


@final
@dataclass(frozen=True)
class StribeckFriction(Effect):
    """mu' = mu (1 + a exp(-(v / v_s)^2)) with v_s = 0.2 m/s, v the speed of slip on the ground (Stribeck 1902).

    Attributes:
        rise: a [-].
    """

    name: ClassVar[str] = "stribeck_friction"
    site: ClassVar[Site] = "contact"
    stribeck_speed: ClassVar[float] = 0.2
    rise: Tensor = quantity("-", low=-0.9, high=3.0, typical=0.5)

    def act(self, state: State, inputs: StepInputs) -> StepInputs:
        """Raise the friction of slow bodies with the ground."""
        square = slip(state, inputs).square().sum(-1) / self.stribeck_speed**2
        factor = 1 + self.rise[:, None] * (-square).exp()
        return inputs.replace(ground_friction=inputs.ground_friction * factor)
