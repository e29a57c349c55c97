"""A ground that gets rougher in one direction."""

from dataclasses import dataclass
from typing import ClassVar, final

from torch import Tensor

from physid.physics import Effect, Site, State, StepInputs, quantity


@final
@dataclass(frozen=True)
class FrictionGradient(Effect):
    """mu' = mu (1 + g . p), at least 0, p the horizontal position of the body from the world's origin.

    Attributes:
        x: First component of g [1/m].
        y: Second component of g [1/m].
    """

    name: ClassVar[str] = "friction_gradient"
    site: ClassVar[Site] = "contact"
    x: Tensor = quantity("1/m", low=-1.0, high=1.0, typical=0.2)
    y: Tensor = quantity("1/m", low=-1.0, high=1.0, typical=0.2)

    def act(self, state: State, inputs: StepInputs) -> StepInputs:
        """Change the friction with the ground by place."""
        x, y, _ = state.position.unbind(-1)
        factor = (1 + self.x[:, None] * x + self.y[:, None] * y).clamp_min(0)
        return inputs.replace(ground_friction=inputs.ground_friction * factor)
