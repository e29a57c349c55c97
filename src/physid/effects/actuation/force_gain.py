"""An actuator that gives more, or less, than was commanded."""

from dataclasses import dataclass
from typing import ClassVar, final

from torch import Tensor

from physid.physics import Effect, Site, quantity


@final
@dataclass(frozen=True)
class ForceGain(Effect):
    """w' = (1 + k) w for the commanded wrench w.

    Attributes:
        gain: k [-].
    """

    name: ClassVar[str] = "force_gain"
    site: ClassVar[Site] = "actuation"
    gain: Tensor = quantity("-", low=-0.9, high=2.0, typical=0.15)

    def actuate(self, wrench: Tensor, time: Tensor) -> Tensor:
        """Scale the commanded wrenches."""
        return wrench * (1 + self.gain[:, None, None, None])
