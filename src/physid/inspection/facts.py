"""What a set measures of itself: rates, noise, ranges, contact, forces."""

from __future__ import annotations

import numpy as np

from physid.data import RecordingSet
from physid.data.observations.stamps import rhythm_of
from physid.inspection.evidence import Evidence
from physid.inspection.rules.energy import energy_over_time
from physid.inspection.rules.shown import shown


def facts_of(recordings: RecordingSet, seen: Evidence) -> list[tuple[str, str]]:
    """Return lines of name and value."""
    scene, read = seen.scene, seen.recordings
    lengths = [one.length for one in read]
    place = np.concatenate([one.pose[..., :3][one.seen] for one in read if one.pose is not None])
    k = seen.kinematics
    facts = [
        (
            "set",
            f"{recordings.folder}: {len(recordings)} trajectories of {_between(min(lengths), max(lengths))} frames",
        ),
        (
            "bodies",
            ", ".join(
                f"{body.name} {' x '.join(f'{edge:g}' for edge in body.size)} m, {body.mass:g} kg"
                for body in scene.bodies
            ),
        ),
        ("unknown", ", ".join(scene.unknown) or "nothing"),
        ("time", _time(seen)),
        ("seen", f"{100 * np.concatenate([one.seen.ravel() for one in read]).mean():.1f} % of the poses"),
        (
            "range",
            " x ".join(f"{low:.3g} to {high:.3g}" for low, high in zip(place.min(0), place.max(0), strict=True)) + " m",
        ),
        ("noise", seen.describe_noise()),
    ]
    if len(k.frame):
        speed = np.linalg.norm(k.velocity, axis=1)
        facts += [
            ("speed", f"up to {speed.max():.3g} m/s, at rest in {100 * seen.still.mean():.0f} % of the frames"),
            ("energy", energy_over_time(seen)),
            (
                "contact",
                f"lowest corner {1000 * k.height.min():.3g} to {1000 * k.height.max():.3g} mm over the ground, "
                f"touching it in {100 * seen.touching.mean():.0f} %",
            ),
        ]
    facts.append(("forces", _forces(seen)))
    return [*facts, ("shown", f"{shown(seen)}; how well, says physid identifiability")] if seen.scene.unknown else facts


def _between(least: int, most: int) -> str:
    """Write a range, or its one number."""
    return f"{least}" if least == most else f"{least} to {most}"


def _time(seen: Evidence) -> str:
    """Say how stamps follow each other."""
    step = seen.scene.time_step
    stamped = [one.time for one in seen.recordings if one.time is not None and len(one.time) > 2]
    nominal = f"{1 / step:.5g} frames per second"
    if not stamped:
        return f"{nominal}, no stamps"
    rhythms = [rhythm_of(time) for time in stamped]
    jitter, missing = np.median([one.jitter for one in rhythms]), sum(one.missing for one in rhythms)
    frames = sum(len(time) for time in stamped)
    gaps = f"{100 * missing / (frames + missing):.1f} % of the frames missing"
    return f"{nominal}, jitter {1000 * jitter:.2g} ms ({100 * jitter / step:.0f} %), {gaps}"


def _forces(seen: Evidence) -> str:
    """Say how strong forces are, and how often they come."""
    given = [one for one in seen.recordings if one.wrench is not None and one.wrench.any()]
    if not given:
        return "none"
    strongest = max(
        float(np.linalg.norm(one.wrench[..., 3:], axis=-1).max()) for one in given if one.wrench is not None
    )
    often = f"{1 / seen.force_step:.4g} per second" if seen.force_step else "with the frames"
    return f"up to {strongest:.3g} N, {often}, in {len(given)} of {len(seen.recordings)} trajectories"
