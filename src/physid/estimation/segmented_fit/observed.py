"""What a fit to segments is made from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from torch import Tensor

from physid.estimation.measurement import NoiseSettings, TrackingError, outlier_poses
from physid.estimation.prediction import Timeline


class Recorded(Protocol):
    """R trajectories of T frames as they were recorded; see `Observed` for what each part is."""

    @property
    def pose(self) -> Tensor:
        """Shape (R, T, N, 7)."""

    @property
    def present(self) -> Tensor:
        """Shape (R, T, N)."""

    @property
    def timeline(self) -> Timeline:
        """Of the frames."""

    @property
    def fitted(self) -> Tensor:
        """Shape (R,)."""

    @property
    def error(self) -> TrackingError | None:
        """Of poses that were read from films."""


@dataclass(frozen=True)
class Observed:
    """R trajectories of T frames.

    Attributes:
        pose: Observed poses, shape (R, T, N, 7).
        present: 1 where a body was seen (trajectories may differ in length, and miss frames), shape (R, T, N).
        timeline: When poses were recorded, and the commanded wrenches in between, in the longest steps that there are.
        fitted: Trajectories that determine parameters (the others only have their initial states fitted), shape (R,).
        error: How far poses that were read from films can be trusted; None for a sensor of poses.
    """

    pose: Tensor
    present: Tensor
    timeline: Timeline
    fitted: Tensor
    error: TrackingError | None = None

    @property
    def common(self) -> Tensor | None:
        """What one standard deviation of an error that all poses share does to them, (R, T, N, 6); None without one."""
        return None if self.error is None else self.error.common


def without_outliers(recorded: Recorded, settings: NoiseSettings) -> Observed:
    """Return recordings in which poses that no motion explains are not present (see `outlier_poses`)."""
    wild = outlier_poses(recorded.pose, recorded.present, recorded.timeline.time, settings)
    present = recorded.present * ~wild
    return Observed(recorded.pose, present, recorded.timeline, recorded.fitted, recorded.error)
