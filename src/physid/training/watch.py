"""Films in, a recording set with poses out: `physid watch`."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from physid.data.format import DESCRIPTION, RecordingSet, trajectory_path, write_scene, write_sums
from physid.data.reading import ECHO, Reading, read_reading, write_reading
from physid.data.recording import Recording
from physid.data.trajectory import write_trajectory
from physid.data.video import check_video
from physid.physics.rotations import to_matrix
from physid.scenes.scene import Scene
from physid.training.echo import Rehearsal, colour_noise, hard_edged
from physid.training.footage import Drawn, Footage, Recorded
from physid.training.reader import Reader
from physid.training.video_model import ChartName

AT_ONCE = 32
"""Films that are read side by side."""
UPRIGHT, LYING = 0.02, 0.01
"""[rad] and share of the height by which a body may be off that counts as upright, and as lying on the ground."""


def watch(
    films: Path,
    out: Path,
    *,
    chart: ChartName | None = None,
    limit: int | None = None,
    say: Callable[[str, int, int], None] = lambda *_: None,
) -> RecordingSet:
    """Read poses from films, and how far they can be trusted, into a recording set; goes on where it was interrupted.

    Of recorded poses only the first ones are looked at: they tell what the bodies look like.

    Args:
        films: Recording set with films.
        out: Folder of the set to write: the same trajectories with poses instead of films, and the set `echo`.
        chart: Which poses there are; None to judge by the first ones.
        limit: At most so many trajectories, the first ones.
        say: Told what is being done, how many frames of how many.

    Returns:
        The set.

    Raises:
        ValueError: If a film cannot be read (the message names it), or the folder holds something else.
    """
    recordings = RecordingSet(films)
    known = [recordings.read(index) for index in range(len(recordings))[:limit]]
    first = _first_poses(recordings, known)
    scene = dataclasses.replace(recordings.scene, source=f"read by physid from the films of {films.name}")
    chart = chart or chart_for(scene, first)
    key = _key(recordings, chart)
    before = read_reading(out)
    if before is not None and before.key != key:
        raise ValueError(f"{out} holds poses that were read from other films; choose another folder, or delete it")
    if before is not None and all(_complete(folder, known) for folder in (out, out / ECHO)):
        return RecordingSet(out)
    check_video(recordings, range(len(known)))
    filmed = Recorded(recordings)
    reader = Reader.of_first_frames(scene, chart, filmed, first)
    stretch, deviation = (float(one) for one in (reader.calibration.stretch, reader.calibration.deviation))
    write_reading(out, Reading(str(films.resolve()), "following", chart, stretch, deviation, key))
    found = _read_into(out, scene, reader, filmed, known, first, partial(say, "reading the films"))
    _echo(out / ECHO, found, reader, filmed, partial(say, "reading drawn films"))
    return found


def chart_for(scene: Scene, pose: Tensor) -> ChartName:
    """Judge by first poses (R, N, 7) which poses there are: of bodies that lie, stand upright, or are free."""
    normal = pose.new_tensor(scene.ground.normal)
    tilt = torch.linalg.cross(to_matrix(pose[..., 3:])[..., 2], normal.expand_as(pose[..., :3])).norm(dim=-1)
    half = pose.new_tensor(scene.sizes[:, 2]) / 2
    above = (pose[..., :3] @ normal - scene.ground.offset - half).abs() / half
    if float(tilt.max()) > UPRIGHT:
        return "spatial"
    return "planar" if float(above.max()) < LYING else "hovering"


def _first_poses(recordings: RecordingSet, known: Sequence[Recording]) -> Tensor:
    """Return the first poses (R, N, 7).

    Raises:
        ValueError: If a trajectory has none.
    """
    poses = [one.pose[0] for one in known if one.pose is not None]
    if len(poses) < len(known):
        path = next(path for path, one in zip(recordings.paths, known, strict=False) if one.pose is None)
        raise ValueError(f"{path}: pose: expected at least that of the first frame, which tells what the bodies look "
                         "like, found none")  # fmt: skip
    return torch.from_numpy(np.stack(poses))


def _key(recordings: RecordingSet, chart: ChartName) -> str:
    """Return a checksum of the scene, the chart, and names, sizes and times of the files."""
    facts = [(path.name, path.stat().st_size, path.stat().st_mtime_ns) for path in recordings.paths]
    return hashlib.sha256(repr((recordings.scene, chart, facts)).encode()).hexdigest()


def _complete(folder: Path, known: Sequence[Recording]) -> bool:
    """Tell whether so many trajectories were read."""
    wanted = (trajectory_path(folder, index) for index in range(len(known)))
    return (folder / DESCRIPTION).is_file() and all(path.is_file() for path in wanted)


def _read_into(
    folder: Path,
    scene: Scene,
    reader: Reader,
    footage: Footage,
    known: Sequence[Recording],
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
        first: About the first poses, shape (R, N, 7).
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
            one, found = known[index], become(index, pose).numpy()
            made = Recording(found, one.wrench, one.time, split=one.split, protocol=one.protocol)
            write_trajectory(trajectory_path(folder, index), made)
    write_scene(folder, scene)
    write_sums(folder)
    return RecordingSet(folder)


def _echo(
    folder: Path, read: RecordingSet, reader: Reader, filmed: Footage, say: Callable[[int, int], None]
) -> RecordingSet:
    """Let PyBullet draw motions like those that were read, and read these films from the beginning."""
    known = list(read)
    rehearsal = Rehearsal(reader.chart, _width(read.scene), [torch.from_numpy(one.pose) for one in known])
    sights = [filmed.first(index) for index in range(len(known))]
    faces = (255 * hard_edged(reader.decoder.patches[0])).round().byte().movedim(2, -1).cpu().numpy()
    poses, backgrounds = [pose.numpy() for pose in rehearsal.poses], [background for _, _, background in sights]
    with Drawn(read.scene, faces, poses, backgrounds, colour_noise(sights)) as drawn:
        first = torch.stack([pose[0] for pose in rehearsal.poses])
        again = Reader.of_first_frames(read.scene, reader.name, drawn, first)
        return _read_into(folder, read.scene, again, drawn, known, first, say, rehearsal.echo)


def _width(scene: Scene) -> int:
    assert scene.camera is not None
    return scene.camera.width
