"""A sole that resists turning on the spot more than its corners do."""

from dataclasses import dataclass
from typing import ClassVar, final

from torch import Tensor

from physid.effects.touch import normal_load, touching
from physid.physics import Effect, Site, State, StepInputs, quantity


@final
@dataclass(frozen=True)
class TorsionalFriction(Effect):
    """tau = -r mu N tanh(w_n / w_s) n with w_s = 0.2 rad/s, where a body touches the ground with normal n and load N.

    w_n is the spin about n. The smooth sign tanh lets the torque vanish at rest, where friction would otherwise
    chatter.

    Attributes:
        radius: r, lever of the friction about the normal [m].
    """

    name: ClassVar[str] = "torsional_friction"
    site: ClassVar[Site] = "contact"
    slow_spin: ClassVar[float] = 0.2
    radius: Tensor = quantity("m", low=0.0, high=0.2, typical=0.03)

    def act(self, state: State, inputs: StepInputs) -> StepInputs:
        """Add the torque about the normal."""
        spin = (state.angular_velocity * inputs.ground_normal).sum(-1)
        friction = inputs.friction * inputs.ground_friction * normal_load(inputs) * touching(state, inputs)
        torque = -self.radius[:, None] * friction * (spin / self.slow_spin).tanh()
        return inputs.add_torque(torque[..., None] * inputs.ground_normal)
