"""A lens that magnifies less, or more, towards its rim."""

from dataclasses import dataclass
from typing import ClassVar, final

import torch
from torch import Tensor

from physid.physics import Effect, Site, quantity


@final
@dataclass(frozen=True)
class LensDistortion(Effect):
    """(x, y)' = (x, y) (1 + k1 (x^2 + y^2)) for reported positions (Brown 1966, first radial coefficient).

    The optical axis is taken to be the world's third axis, and radii are measured on the ground instead of in the
    image, so that k1 has a unit.

    Attributes:
        k1: [1/m^2].
    """

    name: ClassVar[str] = "lens_distortion"
    site: ClassVar[Site] = "perception"
    k1: Tensor = quantity("1/m^2", low=-0.2, high=0.2, typical=0.02)

    def observe(self, pose: Tensor, time: Tensor) -> Tensor:
        """Move the reported positions towards or away from the axis."""
        across, rest = pose[..., :2], pose[..., 2:]
        square = across.square().sum(-1, keepdim=True)
        return torch.cat([across * (1 + self.k1[:, None, None, None] * square), rest], -1)
