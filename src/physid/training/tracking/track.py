"""Films in, a recording set with poses out: `physid track`."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Callable, Sequence
from pathlib import Path

import torch
from torch import Tensor

from physid.data import DESCRIPTION, RecordingSet, trajectory_path, write_scene, write_sums, write_trajectory
from physid.data.batches.video import check_video
from physid.data.reading import ECHO, Reading, read_reading, write_reading
from physid.scenes import Scene
from physid.training.runs.run import CHECKPOINT, restore
from physid.training.tracking.films import Drawn, Filmed, Footage, Recorded
from physid.training.tracking.first_frames import first_frames_of
from physid.training.tracking.light import SteadyLight
from physid.training.tracking.tracker import Reader
from physid.training.tracking.tracking_error import TrackingStudy, colour_noise, hard_edged
from physid.training.vision import ChartName

AT_ONCE = 32
"""Films that are read side by side."""


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
        ValueError: If a film cannot be read (the message names it), or the folder holds something else.
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
    steady = SteadyLight(Recorded(recordings))
    begun = first_frames_of(scene, steady, known, chart, encoder and restore(encoder, films))
    reader, first, filmed = begun.reader, begun.pose, begun.footage
    stretch, deviation = (float(one) for one in (reader.calibration.stretch, reader.calibration.deviation))
    write_reading(out, Reading(str(films.resolve()), str(encoder or ""), reader.name, stretch, deviation, key))
    # Both readings take equally long: one count for both.
    found = _read_into(
        out, scene, reader, filmed, known, first, lambda done, total: say("reading the films", done, 2 * total)
    )
    _echo(
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


def _complete(folder: Path, count: int) -> bool:
    """Return whether so many trajectories were read."""
    wanted = (trajectory_path(folder, index) for index in range(count))
    return (folder / DESCRIPTION).is_file() and all(path.is_file() for path in wanted)


def _read_into(
    folder: Path,
    scene: Scene,
    reader: Reader,
    footage: Footage,
    known: Sequence[Filmed],
    first: Tensor,
    say: Callable[[int, int], None],
    become: Callable[[int, Tensor], Tensor] = lambda _, pose: pose,
) -> RecordingSet:
    """Write a set with the poses that a reader sees; what is there is kept.

    Args:
        folder: Where.
        scene: Of the set.
        reader: Reads.
        footage: The films.
        known: All but the poses.
        first: About the initial poses, shape (R, N, 7).
        say: Told how many frames of how many were read.
        become: What is written of poses (T, N, 7) of a trajectory.
    """
    missing = [index for index in range(len(known)) if not trajectory_path(folder, index).exists()]
    total = sum(one.length for one in known)
    done = total - sum(known[index].length for index in missing)

    def count(frames: int) -> None:
        nonlocal done
        done += frames
        say(done, total)

    count(0)
    for start in range(0, len(missing), AT_ONCE):
        part = missing[start : start + AT_ONCE]
        lengths = [known[index].length for index in part]
        for index, pose in zip(part, reader.read(footage, part, lengths, first[part], count), strict=True):
            made = known[index].with_poses(become(index, pose).numpy())
            write_trajectory(trajectory_path(folder, index), made)
    write_scene(folder, scene)
    write_sums(folder)
    return RecordingSet(folder)


def _echo(
    folder: Path,
    read: RecordingSet,
    reader: Reader,
    filmed: Footage,
    known: Sequence[Filmed],
    say: Callable[[int, int], None],
) -> None:
    """Let PyBullet draw motions like those that were read, and read these films from the beginning."""
    camera = read.scene.camera
    assert camera is not None
    rehearsal = TrackingStudy(reader.chart, camera.width, [torch.from_numpy(one.pose) for one in read])
    sights = [filmed.first(index) for index in range(len(known))]
    faces = (255 * hard_edged(reader.decoder.patches[0])).round().byte().movedim(2, -1).cpu().numpy()
    poses, backgrounds = [pose.numpy() for pose in rehearsal.poses], [background for _, _, background in sights]
    with Drawn(read.scene, faces, poses, backgrounds, colour_noise(sights)) as drawn:
        first = torch.stack([pose[0] for pose in rehearsal.poses])
        again = Reader.of_first_frames(read.scene, reader.name, drawn, first)
        _read_into(folder, read.scene, again, drawn, known, first, say, rehearsal.echo)
