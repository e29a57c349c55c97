"""A camera that is turned about the vertical."""

from dataclasses import dataclass
from typing import ClassVar, final

import torch
from torch import Tensor

from physid.physics import Effect, Site, quantity
from physid.physics.rotations import exponential, multiply, rotate


@final
@dataclass(frozen=True)
class CameraYaw(Effect):
    """p' = R_z(a) p and q' = q_z(a) q: all that is seen, turned about the world's third axis.

    Attributes:
        angle: a [rad], counter-clockwise seen from above.
    """

    name: ClassVar[str] = "camera_yaw"
    site: ClassVar[Site] = "perception"
    angle: Tensor = quantity("rad", low=-0.5, high=0.5, typical=0.05)

    def observe(self, pose: Tensor, time: Tensor) -> Tensor:
        """Turn the reported poses."""
        zero = torch.zeros_like(self.angle)
        turn = exponential(torch.stack([zero, zero, self.angle], -1))[:, None, None]
        position, quaternion = pose[..., :3], pose[..., 3:]
        return torch.cat([rotate(turn, position), multiply(turn, quaternion)], -1)
