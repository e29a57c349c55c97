"""A camera whose metre is too long or too short."""

from dataclasses import dataclass
from typing import ClassVar, final

import torch
from torch import Tensor

from physid.physics import Effect, Site, quantity


@final
@dataclass(frozen=True)
class LengthScale(Effect):
    """p' = (1 + k) p for positions p from the world's origin; attitudes are seen as they are.

    Attributes:
        change: k [-].
    """

    name: ClassVar[str] = "length_scale"
    site: ClassVar[Site] = "perception"
    change: Tensor = quantity("-", low=-0.3, high=0.3, typical=0.03)

    def observe(self, pose: Tensor, time: Tensor) -> Tensor:
        """Scale the reported positions."""
        position, quaternion = pose[..., :3], pose[..., 3:]
        return torch.cat([position * (1 + self.change[:, None, None, None]), quaternion], -1)
