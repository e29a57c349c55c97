"""What an earlier call has read into the folder where poses shall be written, and whether it may go on there."""

from __future__ import annotations

import hashlib
from contextlib import suppress
from pathlib import Path
from typing import get_args

from physid.data import DESCRIPTION, RecordingSet, trajectory_path
from physid.data.files import PART, holds_anything
from physid.data.reading import ECHO, FILE, Reading, read_reading
from physid.one_writer import LOCK
from physid.strict import one_line, quoted
from physid.training.runs.run import CHECKPOINT
from physid.training.vision import ChartName

OWN = (LOCK, FILE + PART)
"""What a command leaves that was killed before it had marked the folder with its file."""


def key_of(recordings: RecordingSet, encoder: Path | None, chart: ChartName | None) -> str:
    """Return a checksum of what is asked for, the scene, and names, sizes and times of the files."""
    files = [*recordings.paths, *([] if encoder is None else [encoder / CHECKPOINT])]
    facts = [(path.name, path.stat().st_size, path.stat().st_mtime_ns) for path in files if path.exists()]
    return hashlib.sha256(repr((recordings.scene, str(encoder), chart, facts)).encode()).hexdigest()


def read_before(recordings: RecordingSet, out: Path, encoder: Path | None, chart: ChartName | None) -> Reading | None:
    """Return what was read into a folder before, in the same way from the same films; None where nothing is there.

    Raises:
        FileExistsError: If it holds something else: what is written has the names of any recording set's files.
        ValueError: If the poses there were read otherwise, or from other films.
    """
    before = read_reading(out)
    if before is None:
        others = [each for each in sorted(out.iterdir()) if each.name not in OWN] if out.is_dir() else []
        if others or (holds_anything(out) and not out.is_dir()):
            raise FileExistsError(
                f"{out}: expected a new or an empty folder, or poses that were read into it before, found "
                f"{quoted(others[0].name) if others else 'a file'} and no {FILE}; choose another --out"
            )
        return None
    if before.key == key_of(recordings, encoder, chart):
        require_few(out, len(recordings))
        return before
    earlier = Path(before.reader) if before.reader else None
    for each in (None, *get_args(ChartName)):
        if before.key == key_of(recordings, earlier, each):
            raise ValueError(
                f"{out}: expected poses that were read {_manner(encoder, chart)}, as is asked for now, found some that "
                f"were read from the same films {_manner(earlier, each)}; ask for the same, choose another folder, or "
                "delete it"
            )
    raise ValueError(f"{out} holds poses that were read from other films; choose another folder, or delete it")


def _manner(encoder: Path | None, chart: ChartName | None) -> str:
    """Say how poses are read, in the words of the command line."""
    of_encoder = f"with --encoder {one_line(str(encoder))}" if encoder else "without --encoder"
    return f"{of_encoder} and {f'with --chart {chart}' if chart else 'without --chart'}"


def require_few(out: Path, count: int) -> None:
    """Refuse to go on where more trajectories lie than are asked for: a set is written, and drawn again, as a whole."""
    for folder in (out, out / ECHO):
        there = sum(1 for _ in trajectory_path(folder, 0).parent.glob("*.h5"))
        if there > count:
            raise ValueError(
                f"{folder}: expected at most the {count} trajectories that are asked for, found {there}; read as many "
                "(a larger --limit, or none), choose another folder, or delete it"
            )


def clear(folder: Path, count: int) -> None:
    """Take back what says that poses are read into a folder, unless some trajectories were."""
    if any(trajectory_path(folder, index).exists() for index in range(count)):
        return
    (folder / FILE).unlink(missing_ok=True)
    with suppress(OSError):  # other things lie there
        folder.rmdir()


def complete(folder: Path, count: int) -> bool:
    """Return whether so many trajectories were read."""
    wanted = (trajectory_path(folder, index) for index in range(count))
    return (folder / DESCRIPTION).is_file() and all(path.is_file() for path in wanted)
