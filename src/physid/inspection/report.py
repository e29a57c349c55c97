"""What `physid check` says of a set."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from physid.data.format import RecordingSet
from physid.data.observations.remarks import remarks_on
from physid.data.observations.stamps import rhythm_of
from physid.data.recording import Recording
from physid.inspection import rules, tracking_rules
from physid.inspection.energy import energy, energy_over_time
from physid.inspection.evidence import Evidence, Finding

RULES = (
    rules.lengths, rules.upside, rules.falls, rules.lying, rules.orders, rules.heights, rules.forces,
    tracking_rules.delay, energy, tracking_rules.motion, tracking_rules.turns, tracking_rules.repeats,
    tracking_rules.jumps, tracking_rules.unseen, tracking_rules.set_off,
)  # fmt: skip
MOST_NAMED = 5
TOUCHING = 2e-3  # [m] over the ground up to which a corner touches it
FEW = 3  # trajectories that a fit needs at least
WIDTH = 14


@dataclass(frozen=True)
class Report:
    """What a set is like.

    Attributes:
        facts: Lines of name and value.
        findings: What looks like a mistake, or is odd.
    """

    facts: tuple[tuple[str, str], ...]
    findings: tuple[Finding, ...]

    @property
    def sound(self) -> bool:
        """Whether nothing looks wrong."""
        return not any(one.wrong for one in self.findings)

    def text(self) -> str:
        """Return it as text for a terminal."""
        lines = [f"{name:<{WIDTH}}{value}" for name, value in self.facts]
        for one in sorted(self.findings, key=lambda one: not one.wrong):
            lines += ["", f"{'wrong?' if one.wrong else 'note':<{WIDTH}}{one.what}", f"{'mend':<{WIDTH}}{one.mend}"]
        if not self.findings:
            lines += ["", "Nothing looks wrong."]
        return "\n".join(lines)


def inspect(recordings: RecordingSet, limit: int | None = None) -> Report:
    """Look at a set.

    Args:
        recordings: The set.
        limit: At most so many trajectories, the first ones.
    """
    read: list[Recording] = []
    indices, findings = list[int](), list[Finding]()
    broken = 0
    for index in range(len(recordings))[:limit]:
        try:
            one = recordings.read(index, video=not recordings.has_poses(index))
        except (ValueError, OSError) as error:
            broken += 1
            if broken <= MOST_NAMED:
                what, _, mend = str(error).partition("; ")
                findings.append(Finding(what, mend or "correct the file, or leave it out"))
            continue
        if one.pose is None or not one.seen.any(0).all():
            findings.append(
                Finding(
                    f"{recordings.paths[index].name}: a body, or all, has no poses",
                    "physid track reads films",
                    wrong=False,
                )
            )
            continue
        read.append(one)
        indices.append(index)
    if broken > MOST_NAMED:
        findings.append(Finding(f"{broken - MOST_NAMED} more trajectories cannot be read", "as above"))
    if not read:
        return Report((("set", str(recordings.folder)),), tuple(findings))
    evidence = Evidence(recordings.scene, read, indices)
    findings += [found for rule in RULES if (found := rule(evidence)) is not None]
    scene = recordings.scene
    said = [
        f"trajectory {index}: {remark}"
        for index, one in zip(indices, read, strict=True)
        for remark in remarks_on(one, scene.time_step, scene.sizes)
    ]
    findings += [Finding(remark, "see docs/recordings.md, Time", wrong=False) for remark in said[:MOST_NAMED]]
    if len(said) > MOST_NAMED:
        findings.append(Finding(f"{len(said) - MOST_NAMED} more such remarks", "as above", wrong=False))
    if len(read) < FEW:
        findings.append(
            Finding(
                f"there are {len(read)} trajectories",
                f"record at least {FEW}; 24 of a second each are plenty",
                wrong=False,
            )
        )
    return Report(tuple(_facts(recordings, evidence)), tuple(findings))


def _facts(recordings: RecordingSet, seen: Evidence) -> list[tuple[str, str]]:
    """Return what the set measures of itself."""
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
        touching = np.abs(k.height) < TOUCHING + 3 * seen.noise.position
        facts += [
            ("speed", f"up to {speed.max():.3g} m/s, at rest in {100 * seen.still.mean():.0f} % of the frames"),
            ("energy", energy_over_time(seen)),
            (
                "contact",
                f"lowest corner {1000 * k.height.min():.3g} to {1000 * k.height.max():.3g} mm over the ground, "
                f"touching it in {100 * touching.mean():.0f} %",
            ),
        ]
    return [*facts, ("forces", _forces(seen))]


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
    clocks = [one.wrench_time for one in given if one.wrench_time is not None and len(one.wrench_time) > 1]
    often = (
        f"{1 / np.median(np.concatenate([np.diff(clock) for clock in clocks])):.4g} per second"
        if clocks
        else "with the frames"
    )
    return f"up to {strongest:.3g} N, {often}, in {len(given)} of {len(seen.recordings)} trajectories"


class UnsoundError(RuntimeError):
    """A set in which something looks wrong."""
