"""Ground and camera that are not level."""

from dataclasses import dataclass
from typing import ClassVar, final

import torch
from torch import Tensor

from physid.physics import Effect, Site, State, StepInputs, quantity
from physid.physics.rotations import exponential, rotate


@final
@dataclass(frozen=True)
class GroundTilt(Effect):
    """g' = R(-(x, y, 0)) g: ground and world frame are turned together by the rotation vector (x, y, 0).

    What leans is the frame in which everything is measured: seen from it the ground stays where it is and gravity leans
    the other way, for bodies in flight as well. This tells a tilt from a wind, which pulls all masses alike.

    Attributes:
        x: About the world's first axis [rad].
        y: About the world's second axis [rad].
    """

    name: ClassVar[str] = "ground_tilt"
    site: ClassVar[Site] = "dynamics"
    x: Tensor = quantity("rad", low=-0.3, high=0.3, typical=0.03)
    y: Tensor = quantity("rad", low=-0.3, high=0.3, typical=0.03)

    def act(self, state: State, inputs: StepInputs) -> StepInputs:
        """Turn gravity."""
        turn = torch.stack([-self.x, -self.y, torch.zeros_like(self.x)], -1)[:, None]
        return inputs.replace(gravity=rotate(exponential(turn), inputs.gravity))
