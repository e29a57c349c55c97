"""The commands that say whether recordings can be trusted."""

from __future__ import annotations

from pathlib import Path

from physid.progress.bar import progress_bar


def check(recordings: Path, *, limit: int | None = None) -> None:
    """Check whether recordings can be trusted, and say what to correct.

    Says rates, gaps, noise, ranges, contact and forces, and what looks like a mistake: units, axes, the order of
    quaternions, forces of the wrong sign or of another clock, heights, jumps, frames that were never logged; and files
    that do not fit SHA256SUMS.
    Exits with 1 where something looks wrong. `fit`, `identifiability` and `diagnose` ask the same rules (but for the
    checksums) at their start, and warn.

    Examples:
      physid check data/mine

    Args:
        recordings: Folder of the recording set.
        limit: Use the first LIMIT trajectories only.
    """
    from physid.data import RecordingSet
    from physid.inspection.report import UnsoundError, inspect

    known = RecordingSet(recordings)
    files = len(known.paths[:limit]) + 1
    with progress_bar(quiet=False, desc="comparing checksums", total=files, unit="file", leave=False) as bar:
        found = inspect(known, limit, lambda path: bar.update())
    print(found.text())
    wrong = sum(one.wrong for one in found.findings)
    if wrong:
        raise UnsoundError(f"{recordings}: {wrong} thing{'s' * (wrong > 1)} to mend, or to look at with physid show")


def show(recordings: Path, *, out: Path | None = None, limit: int = 12) -> None:
    """Draw recordings on a page: boxes, ground, axes and forces, to turn and to play.

    A wrong axis, size or order of a quaternion is seen at once. The page needs no network and can be sent as one file.

    Examples:
      physid show data/mine
      physid show data/mine --out page.html --limit 3

    Args:
        recordings: Folder of the recording set.
        out: The HTML file to write; runs/show/NAME.html by default.
        limit: Use the first LIMIT trajectories only.
    """
    from physid.data import RecordingSet
    from physid.inspection.page import write_page

    known = RecordingSet(recordings)
    target = out or Path("runs/show") / f"{recordings.resolve().name}.html"
    count = write_page(known, range(len(known))[:limit], target)
    print(f"{target}: {count} of {len(known)} trajectories, {target.stat().st_size / 1e6:.2f} MB")
