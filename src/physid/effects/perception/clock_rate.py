"""A camera whose clock runs slow or fast."""

from dataclasses import dataclass
from typing import ClassVar, final

from torch import Tensor

from physid.effects.resampling import at_times
from physid.physics import Effect, Site, quantity


@final
@dataclass(frozen=True)
class ClockRate(Effect):
    """P'(t) = P((1 + k) t) for the pose P, between frames at constant acceleration.

    For k > 0 the camera sees more time pass than its clock says; the last poses continue at constant velocity.

    Attributes:
        change: k [-].
    """

    name: ClassVar[str] = "clock_rate"
    site: ClassVar[Site] = "perception"
    change: Tensor = quantity("-", low=-0.2, high=0.2, typical=0.02)

    def elapse(self, time: Tensor) -> Tensor:
        """Return the times that have passed."""
        return time + (time - time[:, :1]) * self.change[:, None]

    def observe(self, pose: Tensor, time: Tensor) -> Tensor:
        """Report the poses of other times."""
        return at_times(pose, time, self.elapse(time))
