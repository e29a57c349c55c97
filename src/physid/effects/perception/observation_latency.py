"""A camera that reports what was."""

from dataclasses import dataclass
from typing import ClassVar, final

from torch import Tensor

from physid.effects.resampling import at_times
from physid.physics import Effect, Site, quantity


@final
@dataclass(frozen=True)
class ObservationLatency(Effect):
    """P'(t) = P(t - d) for the pose P, between frames at constant acceleration.

    At d = 0 the derivative is minus the velocity at the end of the last step.

    Attributes:
        latency: d [s].
    """

    name: ClassVar[str] = "observation_latency"
    site: ClassVar[Site] = "perception"
    latency: Tensor = quantity("s", low=0.0, high=0.1, typical=0.02)

    def elapse(self, time: Tensor) -> Tensor:
        """Return the earlier times."""
        return time - self.latency[:, None]

    def observe(self, pose: Tensor, time: Tensor) -> Tensor:
        """Report earlier poses."""
        return at_times(pose, time, self.elapse(time))
