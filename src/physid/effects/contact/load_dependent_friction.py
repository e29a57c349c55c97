"""Friction that grows less, or more, than in proportion to the load."""

from dataclasses import dataclass
from typing import ClassVar, final

from torch import Tensor

from physid.effects.touch import normal_load
from physid.physics import Effect, Site, State, StepInputs, quantity


@final
@dataclass(frozen=True)
class LoadDependentFriction(Effect):
    """mu' = mu (N / N0)^e with e = n - 1 and N0 = 10 N, so that the friction force goes as N^n.

    n lies between 2/3 and 1 for elastic asperities (Archard 1957). N is the load of weight and forces on the ground,
    kept above 1 N.

    Attributes:
        exponent: e [-].
    """

    name: ClassVar[str] = "load_dependent_friction"
    site: ClassVar[Site] = "contact"
    reference: ClassVar[float] = 10.0
    least: ClassVar[float] = 1.0
    exponent: Tensor = quantity("-", low=-0.8, high=0.8, typical=0.2)

    def act(self, state: State, inputs: StepInputs) -> StepInputs:
        """Change the friction with the ground by load."""
        load = normal_load(inputs).clamp_min(self.least) / self.reference
        factor = (self.exponent[:, None] * load.log()).exp()
        return inputs.replace(ground_friction=inputs.ground_friction * factor)
