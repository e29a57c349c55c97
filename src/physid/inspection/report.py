"""What `physid check` says of a set."""

from __future__ import annotations

from dataclasses import dataclass, replace

from physid.data import Recording, RecordingSet
from physid.data.observations.remarks import remarks_on
from physid.inspection.evidence import Evidence
from physid.inspection.facts import facts_of
from physid.inspection.finding import Finding
from physid.inspection.mistakes import mistakes_in
from physid.inspection.origin import Origin
from physid.inspection.usability import shows_motion, too_few

MOST_NAMED = 5
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
            one = recordings.read(index, blank=True)
        except (ValueError, OSError) as error:
            broken += 1
            if broken <= MOST_NAMED:
                findings.append(Finding.of_file(error))
            continue
        if not shows_motion(one):
            findings.append(
                Finding(
                    f"{recordings.paths[index].name}: a body, or all, has no poses beyond the first",
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
    evidence = Evidence(recordings.scene, read, indices, Origin.of(recordings.folder))
    findings += mistakes_in(evidence)
    scene = recordings.scene
    said = [
        f"trajectory {index}: {remark}"
        for index, one in zip(indices, read, strict=True)
        for remark in remarks_on(one, scene.time_step, scene.sizes)
    ]
    findings += [Finding(remark, "see docs/recordings.md, Time", wrong=False) for remark in said[:MOST_NAMED]]
    if len(said) > MOST_NAMED:
        findings.append(Finding(f"{len(said) - MOST_NAMED} more such remarks", "as above", wrong=False))
    few = too_few(len(read), max(one.length for one in read))
    findings += [] if few is None else [replace(few, wrong=False)]
    return Report(tuple(facts_of(recordings, evidence)), tuple(findings))


class UnsoundError(RuntimeError):
    """A set in which something looks wrong."""
