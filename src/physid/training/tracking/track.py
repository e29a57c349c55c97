"""Films in, a recording set with poses out: `physid track`."""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Callable
from pathlib import Path

from physid.data import RecordingSet
from physid.data.reading import ECHO, HiddenFrames, Reading, checksum_of_files, write_reading
from physid.training.runs.run import restore
from physid.training.tracking.earlier import clear, complete, key_of, read_before, require_few
from physid.training.tracking.films import filmed_of
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
        FileExistsError: If the folder holds anything but what this command has read there before; nothing is written.
        ValueError: If a film cannot be read (the message names it), or the poses there were read otherwise.
            Trajectories that were complete before stay; if there are none, nothing is left.
    """
    recordings = RecordingSet(films)
    count = len(range(len(recordings))[:limit])
    key = key_of(recordings, encoder, chart)
    before = read_before(recordings, out, encoder, chart)
    if before is not None and all(complete(folder, count) for folder in (out, out / ECHO)):
        _note_films(out, before, films)
        return RecordingSet(out)
    if before is not None:
        require_few(out, count)
    scene = dataclasses.replace(recordings.scene, source=f"read by physid from the films of {films.name}")
    known = filmed_of(recordings, count)
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
    seen = checksum_of_files(films)
    reading = Reading(str(films.resolve()), str(encoder or ""), reader.name, stretch, deviation, key, seen=seen)

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
        clear(out, count)
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


def _note_films(out: Path, before: Reading, films: Path) -> None:
    """Note where the films lie now, and by what they are known again; earlier versions did not note the latter.

    Args:
        out: Folder of the poses.
        before: How they were read.
        films: The same films, by the key.
    """
    known = dataclasses.replace(before, films=str(films.resolve()), seen=checksum_of_files(films))
    if known != before:
        write_reading(out, known)
