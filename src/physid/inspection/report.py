"""What `physid check` says of a set."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from physid.data import RecordingSet
from physid.data.format import DESCRIPTION, SUMS
from physid.inspection.examination import read_posed
from physid.inspection.facts import facts_of
from physid.inspection.finding import Finding, ordered
from physid.inspection.mistakes import MOST_NAMED, mistakes_in
from physid.inspection.usability import too_few
from physid.strict import one_line

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
        return "\n".join(map(one_line, lines))


def inspect(
    recordings: RecordingSet, limit: int | None = None, compared: Callable[[Path], object] = lambda path: None
) -> Report:
    """Look at a set.

    Args:
        recordings: The set.
        limit: At most so many trajectories, the first ones; of the others the checksums are not compared either.
        compared: Called with each file that has been compared with its checksum.
    """
    seen, findings = read_posed(recordings, range(len(recordings))[:limit])
    findings += _differing(recordings, limit, compared)
    if seen is None:
        return Report((("set", str(recordings.folder)),), tuple(findings))
    findings += mistakes_in(seen)
    few = too_few(len(seen.recordings), max(one.length for one in seen.recordings))
    findings += [] if few is None else [replace(few, wrong=False)]
    return Report(tuple(facts_of(recordings, seen)), tuple(findings))


def _differing(recordings: RecordingSet, limit: int | None, compared: Callable[[Path], object]) -> list[Finding]:
    """Return what differs from the checksums of a set that has them; recording.yaml is corrected by hand, too."""
    if not (recordings.folder / SUMS).is_file():
        return []
    try:
        left = () if limit is None else recordings.paths[limit:]
        found = [path for path, *_ in recordings.changed(left, compared)]
    except (ValueError, OSError) as error:
        return [Finding.of_file(error)]
    scene = recordings.folder / DESCRIPTION
    files = [path for path in found if path != scene]
    said = []
    if files:
        named = ", ".join(one_line(path.name) for path in files[:MOST_NAMED])
        more = f" and {len(files) - MOST_NAMED} more" if len(files) > MOST_NAMED else ""
        what = f"{named}{more}: missing, or not as written: the content does not fit {SUMS}"
        said.append(Finding(what, f"restore what was damaged; delete {SUMS} if you changed the set yourself"))
    if scene in found:
        what = f"{scene.name} is not as written: it does not fit {SUMS}"
        said.append(
            Finding(what, f"nothing, if you corrected it yourself (then delete {SUMS}); else restore it", False)
        )
    return said


class UnsoundError(RuntimeError):
    """A set in which something looks wrong."""
