"""Writing what is read from films: a set of poses, and one of films that are drawn to see how well these are read."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import torch
from torch import Tensor

from physid.data import RecordingSet, trajectory_path, write_scene, write_sums, write_trajectory
from physid.data.reading import HiddenFrames
from physid.scenes import Scene
from physid.training.tracking.films import Drawn, Filmed, Footage
from physid.training.tracking.tracker import Reader
from physid.training.tracking.tracking_error import TrackingStudy, colour_noise, hard_edged

AT_ONCE = 32
"""Films that are read side by side."""


def read_into(
    folder: Path,
    scene: Scene,
    reader: Reader,
    footage: Footage,
    known: Sequence[Filmed],
    first: Tensor,
    say: Callable[[int, int], None],
    become: Callable[[int, Tensor], Tensor] = lambda _, pose: pose,
    doubt: Callable[[HiddenFrames], object] = lambda _: None,
) -> RecordingSet:
    """Write a set with the poses that a reader sees; what is there is kept.

    Args:
        folder: Where.
        scene: Of the set.
        reader: Reads.
        footage: The films.
        known: All but the poses.
        first: About the initial poses, shape (R, N, 7).
        say: Called with how many frames of how many were read.
        become: What is written of poses (T, N, 7) of a trajectory.
        doubt: Called with frames in which something hides the bodies, before poses of theirs are written.
    """
    missing = {index for index in range(len(known)) if not trajectory_path(folder, index).exists()}
    # Poses depend, by rounding, on what is read beside them: films are read in the same company by every call.
    parts = [range(start, min(start + AT_ONCE, len(known))) for start in range(0, len(known), AT_ONCE)]
    unread = [part for part in parts if missing.intersection(part)]
    total = sum(one.length for one in known)
    done = total - sum(known[index].length for part in unread for index in part)

    def count(frames: int) -> None:
        nonlocal done
        done += frames
        say(done, total)

    count(0)
    for part in unread:
        lengths, near = [known[index].length for index in part], first[part.start : part.stop]
        for index, pose in zip(part, reader.read(footage, part, lengths, near, count, doubt), strict=True):
            if index in missing:
                made = known[index].with_poses(become(index, pose).numpy())
                write_trajectory(trajectory_path(folder, index), made)
    write_scene(folder, scene)
    write_sums(folder)
    return RecordingSet(folder)


def read_drawn(
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
    shadow = reader.decoder.shadow
    with Drawn(read.scene, faces, poses, backgrounds, colour_noise(sights), shadow) as drawn:
        first = torch.stack([pose[0] for pose in rehearsal.poses])
        again = Reader.of_first_frames(read.scene, reader.name, drawn, first, shadow)
        read_into(folder, read.scene, again, drawn, known, first, say, rehearsal.echo)
