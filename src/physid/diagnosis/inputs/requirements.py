"""Recordings that nothing can be concluded from are refused, with what is wrong and what would be needed."""

from __future__ import annotations

from physid.diagnosis.inputs.observations import Observations
from physid.estimation.measurement import NoiseSettings
from physid.inspection import usability
from physid.inspection.usability import Motion, RequirementSettings, too_few


def require_usable(observations: Observations, settings: RequirementSettings, noise: NoiseSettings) -> None:
    """Refuse observations that cannot be diagnosed: too few, or of no use to anyone.

    Args:
        observations: What was recorded.
        settings: What is required.
        noise: What an outlier is.

    Raises:
        ValueError: If there are too few trajectories or frames, or as `inspection.usability.require_usable` says.
    """
    few = too_few(int(observations.fitted.sum()), observations.pose.shape[1], settings)
    if few is not None:
        raise ValueError(f"{observations.folder}: {few.what}; {few.mend}")
    forced = (observations.timeline.grid.wrench != 0).flatten(1).any(1)
    time, indices = observations.timeline.time, observations.indices
    motion = Motion(observations.scene, observations.pose, observations.present, time, forced, indices)
    usability.require_usable(observations.folder, motion, settings, noise)
