"""Films in, a recording set with poses out: `physid track`."""

from __future__ import annotations

import dataclasses
import hashlib
import logging
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from physid.data import DESCRIPTION, RecordingSet, trajectory_path
from physid.data.batches.video import check_video
from physid.data.reading import ECHO, FILE, HiddenFrames, Reading, read_reading, write_reading
from physid.training.runs.run import CHECKPOINT, restore
from physid.training.tracking.films import Filmed
from physid.training.tracking.first_frames import first_frames_of
from physid.training.tracking.read_set import read_drawn, read_into
from physid.training.vision import ChartName

logger = logging.getLogger("physid")
SAME_SCALE = 0.1  # of its standard deviation, which rounding does not reach


def track(
    films: Path,
    out: Path,
    *,
    encoder: Path | None = None,
    chart: ChartName | None = None,
    limit: int | None = None,
    say: Callable[[str, int, int], None] = lambda *_: None,
) -> RecordingSet:
    """Read poses from films, and how far they can be trusted, into a recording set; goes on where it was interrupted.

    Of recorded poses only the first ones are looked at (see `first_frames_of`).

    Args:
        films: Recording set with films.
        out: Folder of the set to write: the same trajectories with poses instead of films, and the set `echo`.
        encoder: Run of a trained encoder, which finds the bodies in the first frames; None to do without.
        chart: Which poses there are; None to judge by the first ones.
        limit: At most so many trajectories, the first ones.
        say: Called with what is being done, how many frames of how many: those of the films, and as many drawn ones.

    Returns:
        The set.

    Raises:
        ValueError: If a film cannot be read (the message names it), or the folder holds something else. Trajectories
            that were complete before stay; if there are none, nothing is left.
    """
    recordings = RecordingSet(films)
    count = len(range(len(recordings))[:limit])
    key = _key(recordings, encoder, chart)
    before = read_reading(out)
    if before is not None and before.key != key:
        raise ValueError(f"{out} holds poses that were read from other films; choose another folder, or delete it")
    if before is not None and all(_complete(folder, count) for folder in (out, out / ECHO)):
        return RecordingSet(out)
    check_video(recordings, range(count))
    scene = dataclasses.replace(recordings.scene, source=f"read by physid from the films of {films.name}")
    known = [Filmed.of(recordings, index) for index in range(count)]
    begun = first_frames_of(scene, recordings, known, chart, encoder and restore(encoder, films))
    reader, first, filmed = begun.reader, begun.pose, begun.footage
    stretch, deviation = (float(one) for one in (reader.calibration.stretch, reader.calibration.deviation))
    if before is not None and abs(before.stretch - stretch) > SAME_SCALE * deviation:
        logger.warning(
            "%s: the scale is %+.4f %% by all %d films and was %+.4f %% by those that were read before, whose poses "
            "stay; to read all with one scale, delete the folder first",
            out, 100 * stretch, count, 100 * before.stretch,
        )  # fmt: skip
    hidden = {one.trajectory: one for one in (before.hidden if before else ())}
    reading = Reading(str(films.resolve()), str(encoder or ""), reader.name, stretch, deviation, key)

    def keep(*found: HiddenFrames) -> None:
        """Keep what is known of the reading, with what was found; a warning says it at once."""
        for one in found:
            hidden[one.trajectory] = one
            logger.warning("%s; poses there are unsure, cut the film there or film again", one)
        write_reading(out, dataclasses.replace(reading, hidden=tuple(hidden[key] for key in sorted(hidden))))

    keep()
    # Both readings take equally long: one count for both.
    try:
        found = read_into(
            out, scene, reader, filmed, known, first,
            lambda done, total: say("reading the films", done, 2 * total), doubt=keep,
        )  # fmt: skip
    except ValueError:
        _clear(out, count)
        raise
    read_drawn(
        out / ECHO,
        found,
        reader,
        filmed,
        known,
        lambda done, total: say("reading drawn films", total + done, 2 * total),
    )
    return found


def _key(recordings: RecordingSet, encoder: Path | None, chart: ChartName | None) -> str:
    """Return a checksum of what is asked for, the scene, and names, sizes and times of the files."""
    files = [*recordings.paths, *([] if encoder is None else [encoder / CHECKPOINT])]
    facts = [(path.name, path.stat().st_size, path.stat().st_mtime_ns) for path in files if path.exists()]
    return hashlib.sha256(repr((recordings.scene, str(encoder), chart, facts)).encode()).hexdigest()


def _clear(folder: Path, count: int) -> None:
    """Take back what says that poses are read into a folder, unless some trajectories were."""
    if any(trajectory_path(folder, index).exists() for index in range(count)):
        return
    (folder / FILE).unlink(missing_ok=True)
    with suppress(OSError):  # other things lie there
        folder.rmdir()


def _complete(folder: Path, count: int) -> bool:
    """Return whether so many trajectories were read."""
    wanted = (trajectory_path(folder, index) for index in range(count))
    return (folder / DESCRIPTION).is_file() and all(path.is_file() for path in wanted)
