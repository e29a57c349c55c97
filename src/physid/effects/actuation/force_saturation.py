"""An actuator that cannot push as hard as it is told."""

from dataclasses import dataclass
from typing import ClassVar, final

import torch
from torch import Tensor

from physid.physics import Effect, Site, quantity


@final
@dataclass(frozen=True)
class ForceSaturation(Effect):
    """f' = f (1 + c (|f| / F)^4)^(-1/4) with F = 10 N for the commanded force f; torques pass.

    A smooth limiter: small forces pass, large ones tend to F c^(-1/4) (see `limit`). A limit itself has no finite null
    value, and a hard one, min(|f|, limit), no derivative there; c has both: it is 0 for an actuator without limit, and
    the derivative there, -f (|f| / F)^4 / 4, shows at the largest forces.

    Attributes:
        compression: c [-].
    """

    name: ClassVar[str] = "force_saturation"
    site: ClassVar[Site] = "actuation"
    reference: ClassVar[float] = 10.0
    compression: Tensor = quantity("-", low=0.0, high=250.0, typical=4.0)

    @property
    def limit(self) -> Tensor:
        """Compute the force that a large command tends to, F c^(-1/4) [N]."""
        return self.reference * self.compression**-0.25

    def actuate(self, wrench: Tensor, time: Tensor) -> Tensor:
        """Compress the commanded forces."""
        torque, force = wrench[..., :3], wrench[..., 3:]
        square = (force / self.reference).square().sum(-1, keepdim=True)
        passed = (1 + self.compression[:, None, None, None] * square**2) ** -0.25
        return torch.cat([torque, passed * force], -1)
