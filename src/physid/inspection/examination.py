"""The rules asked of a set: what `check` says, and `fit`, `identifiability` and `diagnose` at the start."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from physid.data import Recording, RecordingSet
from physid.data.observations.trajectories import from_recordings, require_seen
from physid.estimation.measurement import NoiseSettings
from physid.inspection.evidence import Evidence
from physid.inspection.finding import Finding
from physid.inspection.mistakes import MOST_NAMED, mistakes_in, oddities_in
from physid.inspection.origin import Origin
from physid.inspection.usability import Motion, require_usable, shows_motion


def read_posed(
    recordings: RecordingSet, indices: Sequence[int], needed: Collection[int] = ()
) -> tuple[Evidence | None, list[Finding]]:
    """Read trajectories in which every body is seen to move; None without any.

    Args:
        recordings: The set.
        indices: Which trajectories.
        needed: Those of which a damaged file is an error; of others it is a finding.

    Returns:
        What the rules look at, and a finding for each trajectory that could not be read, or has no poses.

    Raises:
        ValueError: If a file that is needed is damaged.
    """
    names = [body.name for body in recordings.scene.bodies]
    read, findings, broken = dict[int, Recording](), list[Finding](), 0
    for index in indices:
        path = recordings.paths[index]
        try:
            one = recordings.read(index, blank=True)
            if not recordings.has_film(index):
                require_seen(one, names)
        except (ValueError, OSError) as error:
            if isinstance(error, ValueError) and not str(error).startswith(str(path)):
                error = ValueError(f"{path}: {error}")
            if index in needed:
                raise error from None
            broken += 1
            if broken <= MOST_NAMED:
                findings.append(Finding.of_file(error))
            continue
        if shows_motion(one):
            read[index] = one
        else:
            what = f"{path.name}: a body, or all, has no poses beyond the first"
            findings.append(Finding(what, "physid track reads films", wrong=False))
    if broken > MOST_NAMED:
        findings.append(Finding(f"{broken - MOST_NAMED} more trajectories cannot be read", "as above"))
    if not read:
        return None, findings
    return Evidence(recordings.scene, list(read.values()), list(read), Origin.of(recordings.folder)), findings


def examine(recordings: RecordingSet, indices: Sequence[int]) -> list[Finding]:
    """Return what looks like a mistake in trajectories of a set, or is odd; films without poses are neither.

    Args:
        recordings: The set.
        indices: Which trajectories.
    """
    seen, findings = read_posed(recordings, indices)
    return [one for one in findings if one.wrong] + ([] if seen is None else mistakes_in(seen))


def require_usable_set(
    recordings: RecordingSet, fitted: Collection[int], beside: Sequence[int] = ()
) -> tuple[Finding, ...]:
    """Refuse trajectories of a set from which no fit can learn, and return what else looks like a mistake, or is odd.

    A fit learns from small motions, too: what moves by more than the least noise that is ever assumed does move. Those
    without poses are left to who reads the films.

    Args:
        recordings: The set.
        fitted: Trajectories that are fitted to.
        beside: Others that are measured by what was fitted.

    Raises:
        ValueError: As `usability.require_usable` does, or if a file that is fitted to is damaged.
    """
    seen, findings = read_posed(recordings, sorted({*fitted, *beside}), fitted)
    findings = [one for one in findings if one.wrong]
    if seen is None:
        return tuple(findings)
    chosen = {index: one for index, one in zip(seen.indices, seen.recordings, strict=True) if index in fitted}
    if chosen:
        scene = recordings.scene
        motion = Motion.of(scene, from_recordings(list(chosen.values()), scene.time_step, list(chosen)))
        findings += require_usable(recordings.folder, motion, least=NoiseSettings().least)
    return (*findings, *oddities_in(seen))
