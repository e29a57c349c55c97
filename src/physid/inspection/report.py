"""What `physid check` says of a set."""

from __future__ import annotations

from dataclasses import dataclass, replace

from physid.data import RecordingSet
from physid.inspection.examination import read_posed
from physid.inspection.facts import facts_of
from physid.inspection.finding import Finding, ordered
from physid.inspection.mistakes import mistakes_in
from physid.inspection.usability import too_few

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
        for one in ordered(self.findings):
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
    seen, findings = read_posed(recordings, range(len(recordings))[:limit])
    if seen is None:
        return Report((("set", str(recordings.folder)),), tuple(findings))
    findings += mistakes_in(seen)
    few = too_few(len(seen.recordings), max(one.length for one in seen.recordings))
    findings += [] if few is None else [replace(few, wrong=False)]
    return Report(tuple(facts_of(recordings, seen)), tuple(findings))


class UnsoundError(RuntimeError):
    """A set in which something looks wrong."""
