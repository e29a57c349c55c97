"""A tracker that averages poses over time, before and after alike."""

from dataclasses import dataclass
from typing import ClassVar, final

from torch import Tensor

from physid.effects.filtering import filtered, smoothing
from physid.physics import Effect, Site, quantity


@final
@dataclass(frozen=True)
class ObservationSmoothing(Effect):
    """P' = (1 - (s / 8) d^2/dt^2)^-4 P for the pose P: its mean under a symmetric bell of variance s.

    A running mean over w seconds has s = w^2 / 12, a Gaussian bell the square of its standard deviation. A width would
    have no derivative at zero. A filter that looks back only is `observation_lag`.

    Attributes:
        variance: s [s^2].
    """

    name: ClassVar[str] = "observation_smoothing"
    site: ClassVar[Site] = "perception"
    variance: Tensor = quantity("s^2", low=0.0, high=0.01, typical=0.0006)

    def observe(self, pose: Tensor, time: Tensor) -> Tensor:
        """Report smoothed poses."""
        return filtered(pose, lambda values: smoothing(values, time, self.variance))
