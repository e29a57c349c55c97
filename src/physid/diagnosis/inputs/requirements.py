"""Recordings that nothing can be concluded from are refused, with what is wrong and what would be needed."""

from __future__ import annotations

from dataclasses import replace

from physid.diagnosis.inputs.observations import Observations
from physid.estimation.measurement import NoiseSettings
from physid.inspection import usability
from physid.inspection.examination import read_posed
from physid.inspection.finding import Finding, warn_of
from physid.inspection.mistakes import oddities_in
from physid.inspection.usability import Motion, RequirementSettings, too_few

Mistakes = tuple[Finding, ...]


def require_usable(observations: Observations, settings: RequirementSettings, noise: NoiseSettings) -> Mistakes:
    """Refuse observations that cannot be diagnosed, too few or of no use to anyone, and warn of what else looks wrong.

    Trajectories of a second set are counted on from the first by the rules of what is useless, and have their own
    numbers, behind the name of their set, in all others.

    Args:
        observations: What was recorded.
        settings: What is required.
        noise: What an outlier is.

    Returns:
        What looks like a mistake, or is odd, by the rules of `physid check`; what was recorded may still be so.

    Raises:
        ValueError: If there are too few trajectories or frames, or as `inspection.usability.require_usable` says.
    """
    few = too_few(int(observations.fitted.sum()), observations.pose.shape[1], settings)
    if few is not None:
        raise ValueError(f"{observations.folder}: {few.what}; {few.mend}")
    forced = (observations.timeline.grid.wrench != 0).flatten(1).any(1)
    time, indices = observations.timeline.time, observations.indices
    motion = Motion(observations.scene, observations.pose, observations.present, time, forced, indices)
    found = usability.require_usable(observations.folder, motion, settings, noise)
    sets = dict.fromkeys(recordings for recordings, _ in observations.sources)
    for number, recordings in enumerate(sets):
        seen, _ = read_posed(recordings, [index for source, index in observations.sources if source is recordings])
        odd = [] if seen is None else oddities_in(seen)
        found += [replace(one, what=f"{recordings.folder}: {one.what}") for one in odd] if number else odd
    warn_of(found, observations.folder)
    return tuple(found)
