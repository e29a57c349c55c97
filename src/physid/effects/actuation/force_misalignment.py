"""A pusher that is mounted at an angle."""

from dataclasses import dataclass
from typing import ClassVar, final

import torch
from torch import Tensor

from physid.physics import Effect, Site, quantity


@final
@dataclass(frozen=True)
class ForceMisalignment(Effect):
    """w' = R_z(a) w: the commanded force and torque, turned about the world's vertical.

    Attributes:
        angle: a [rad], counter-clockwise seen from above.
    """

    name: ClassVar[str] = "force_misalignment"
    site: ClassVar[Site] = "actuation"
    angle: Tensor = quantity("rad", low=-0.8, high=0.8, typical=0.1)

    def actuate(self, wrench: Tensor, time: Tensor) -> Tensor:
        """Turn the commanded wrenches."""
        cosine, sine = self.angle.cos()[:, None, None, None], self.angle.sin()[:, None, None, None]
        x, y, z = wrench.reshape(*wrench.shape[:-1], 2, 3).unbind(-1)
        return torch.stack([cosine * x - sine * y, sine * x + cosine * y, z], -1).flatten(-2)
