"""A tracker whose filter of poses looks back only."""

from dataclasses import dataclass
from typing import ClassVar, final

from torch import Tensor

from physid.effects.filtering import filtered, lag
from physid.physics import Effect, Site, quantity


@final
@dataclass(frozen=True)
class ObservationLag(Effect):
    """tau dP'/dt = P - P' for the pose P, which went on before the first frame as in the first step.

    Poses are linear from frame to frame: P' is tau late where a body moves steadily. A filter that also looks ahead is
    `observation_smoothing`.

    Attributes:
        time_constant: tau [s].
    """

    name: ClassVar[str] = "observation_lag"
    site: ClassVar[Site] = "perception"
    time_constant: Tensor = quantity("s", low=0.0, high=0.2, typical=0.02)

    def observe(self, pose: Tensor, time: Tensor) -> Tensor:
        """Report poses that lag."""
        return filtered(pose, lambda values: lag(values, time, self.time_constant))
