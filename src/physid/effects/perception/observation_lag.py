"""A tracker whose filter of poses looks back only."""

from dataclasses import dataclass
from typing import ClassVar, final

from torch import Tensor

from physid.effects.filtering import filtered, lag
from physid.physics import Effect, Site, quantity


@final
@dataclass(frozen=True)
class ObservationLag(Effect):
    """P'_k = P'_{k-1} + h / (h + tau) (P_k - P'_{k-1}) for the pose P of frame k, h after the one before.

    Exponential smoothing of poses, after which a steady motion is reported tau late; a weight a of the newest pose is
    tau = h (1 - a) / a. A filter that also looks ahead is `observation_smoothing`.

    Attributes:
        time_constant: tau [s].
    """

    name: ClassVar[str] = "observation_lag"
    site: ClassVar[Site] = "perception"
    time_constant: Tensor = quantity("s", low=0.0, high=0.2, typical=0.02)

    def observe(self, pose: Tensor, time: Tensor) -> Tensor:
        """Report poses that lag."""
        return filtered(pose, lambda values: lag(values, time, self.time_constant))
