"""A camera that does not stand where it is believed to."""

from dataclasses import dataclass
from typing import ClassVar, final

import torch
from torch import Tensor

from physid.physics import Effect, Site, quantity


@final
@dataclass(frozen=True)
class CameraOffset(Effect):
    """p' = p + (x, y, z) for reported positions, world frame.

    Attributes:
        x: [m].
        y: [m].
        z: [m].
    """

    name: ClassVar[str] = "camera_offset"
    site: ClassVar[Site] = "perception"
    x: Tensor = quantity("m", low=-0.5, high=0.5, typical=0.02)
    y: Tensor = quantity("m", low=-0.5, high=0.5, typical=0.02)
    z: Tensor = quantity("m", low=-0.5, high=0.5, typical=0.02)

    def observe(self, pose: Tensor, time: Tensor) -> Tensor:
        """Shift the reported positions."""
        offset = torch.stack([self.x, self.y, self.z], -1)[:, None, None]
        position, quaternion = pose[..., :3], pose[..., 3:]
        return torch.cat([position + offset, quaternion], -1)
