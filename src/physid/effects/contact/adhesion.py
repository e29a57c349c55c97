"""A ground that holds what touches it."""

from dataclasses import dataclass
from typing import ClassVar, final

from torch import Tensor

from physid.effects.touch import touching
from physid.physics import Effect, Site, State, StepInputs, quantity


@final
@dataclass(frozen=True)
class Adhesion(Effect):
    """F = -A n while a body touches the ground with normal n.

    A is the force that it takes to pull the body off (Johnson, Kendall and Roberts 1971).

    Attributes:
        force: A [N].
    """

    name: ClassVar[str] = "adhesion"
    site: ClassVar[Site] = "contact"
    force: Tensor = quantity("N", low=0.0, high=20.0, typical=2.0)

    def act(self, state: State, inputs: StepInputs) -> StepInputs:
        """Pull bodies that touch to the ground."""
        pull = -self.force[:, None] * touching(state, inputs)
        return inputs.add_force(pull[..., None] * inputs.ground_normal)
