"""A centre of mass that is not in the middle of the box."""

from dataclasses import dataclass
from typing import ClassVar, final

import torch
from torch import Tensor

from physid.physics import Effect, Site, State, StepInputs, quantity


@final
@dataclass(frozen=True)
class ComOffset(Effect):
    """c' = c + (x, y, z): the centre of mass from the centre of the box, in the body's axes.

    Gravity acts at the centre of mass, the commanded wrench at the centre of the box; the moments of inertia are kept.

    Attributes:
        x: [m].
        y: [m].
        z: [m].
    """

    name: ClassVar[str] = "com_offset"
    site: ClassVar[Site] = "dynamics"
    x: Tensor = quantity("m", low=-0.05, high=0.05, typical=0.01)
    y: Tensor = quantity("m", low=-0.05, high=0.05, typical=0.01)
    z: Tensor = quantity("m", low=-0.05, high=0.05, typical=0.01)

    def act(self, state: State, inputs: StepInputs) -> StepInputs:
        """Move the centre of mass."""
        offset = torch.stack([self.x, self.y, self.z], -1)[:, None]
        return inputs.replace(centre_of_mass=inputs.centre_of_mass + offset)
