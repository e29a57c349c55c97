"""An actuator that swallows the first newtons of a command."""

from dataclasses import dataclass
from typing import ClassVar, final

import torch
from torch import Tensor

from physid.physics import Effect, Site, quantity

SMALLEST = 1e-9  # [N] keeps the derivative of the length of a force finite at zero


@final
@dataclass(frozen=True)
class ForceDeadZone(Effect):
    """f' = f max(0, 1 - d / |f|) for the commanded force f; torques pass.

    The direction is kept and the magnitude is d smaller (Tao and Kokotovic 1994, unit slopes). At d = 0 the derivative
    is -f / |f|, so a small dead zone shows at every push.

    Attributes:
        width: d [N].
    """

    name: ClassVar[str] = "force_dead_zone"
    site: ClassVar[Site] = "actuation"
    width: Tensor = quantity("N", low=0.0, high=5.0, typical=1.0)

    def actuate(self, wrench: Tensor, time: Tensor) -> Tensor:
        """Shorten the commanded forces."""
        torque, force = wrench[..., :3], wrench[..., 3:]
        length = force.square().sum(-1, keepdim=True).clamp_min(SMALLEST**2).sqrt()
        passed = (1 - self.width[:, None, None, None] / length).clamp_min(0)
        return torch.cat([torque, passed * force], -1)
