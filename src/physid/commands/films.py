"""The commands that lead from films to poses."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from physid.commands.terminal.screen import frame_bar, resumable

if TYPE_CHECKING:
    from physid.data import RecordingSet


def calibrate(
    film: Path, *, corners: str = "9x6", square: float = 0.025, ground: str = "", out: Path = Path("camera.yaml")
) -> None:
    """Measure a camera's lens from a film of a checkerboard, and write its camera file.

    The board is turned about in front of the camera, which has the focus and zoom of the recordings. Where the camera
    is follows from four or more points of the ground, given here or written into the file later: column, row, x, y.
    Needs OpenCV: pip install 'physid[camera]'.

    Examples:
      physid calibrate board.mp4 --corners 9x6 --square 0.025
      physid calibrate board.mp4 --ground "[[83,401,0,0],[559,386,0.6,0],[523,97,0.6,0.4],[102,111,0,0.4]]"

    Args:
        film: Film, or folder of images.
        corners: Inner corners of the board along its sides; 9x6 for one of ten by seven squares.
        square: Side of a square [m].
        ground: Points of the ground, rows of column, row [px], x, y (and z) [m]; whole numbers are centres of pixels.
            z points up: seen from above, y is a quarter turn counterclockwise from x.
        out: The camera file to write; camera.yaml by default. Where it is there, the place of the camera is kept.
    """
    from physid.data.files import YAML, require_ending
    from physid.data.importers.video.calibrate import calibrate as run
    from physid.data.importers.video.calibrate import corners_of
    from physid.data.importers.video.cameras import POINTS_OFF

    require_ending(out, *YAML)
    found = run(film, corners_of(corners, square), square, out, ground)
    middle = found.matrix[:2, 2] + 0.5 - [found.width / 2, found.height / 2]
    print(f"focal length {found.matrix[0, 0]:.1f} and {found.matrix[1, 1]:.1f} px")
    print(f"principal point {middle[0]:+.1f} and {middle[1]:+.1f} px off the middle of the image")
    print(f"distortion {', '.join(f'{one:.4g}' for one in found.distortion)}")
    print(f"corners within {found.error:.2g} px (rms) in {found.boards} views")
    if "points" in found.place:
        print(f"points of the ground within {found.ground_error:.2g} px ({POINTS_OFF:g} px is much)")
    if found.place and not ground:
        print(f"{out}: the lens is measured anew, the place of the camera is kept ({', '.join(found.place)})")
    else:
        print(f"{out}" + ("" if ground else ": add points of the ground, or the place of the camera (docs/films.md)"))


def track(
    films: Path,
    *,
    out: Path | None = None,
    encoder: Path | None = None,
    chart: Literal["planar", "hovering", "spatial"] | None = None,
    limit: int | None = None,
    quiet: bool = False,
) -> None:
    """Track poses in films and write them as a recording set, which fit, predict and diagnose use as any other.

    The bodies are cut out of the first frames by masks and initial poses, or found there by their outlines, and
    tracked from frame to frame by drawing them; nothing is trained. Similar motions are then drawn by PyBullet and
    tracked, too: the set `echo` in the folder, from which a diagnosis takes the tracking error. An interrupted run
    resumes where it stopped.

    Examples:
      physid track data/films --out data/read
      physid diagnose data/read

    Args:
        films: Folder of a recording set with films.
        out: Folder of the set to write; data/NAME_read by default.
        encoder: Run of a fit from video, whose encoder finds the bodies in the first frames.
        chart: Which poses there are: of bodies that lie on the ground (planar), are parallel to it (hovering) or free
            (spatial); by default what the initial poses say.
        limit: Use the first LIMIT trajectories only.
        quiet: Hide the progress bar.
    """
    from physid.data.reading import read_reading
    from physid.one_writer import one_writer
    from physid.training.tracking.track import track as run

    folder = out or Path("data") / f"{films.resolve().name}_read"
    with resumable(), one_writer(folder), frame_bar(quiet) as say:
        found = run(films, folder, encoder=encoder, chart=chart, limit=limit, say=say)
    reading = read_reading(folder)
    assert reading is not None
    print(f"{folder}: {len(found)} trajectories, {reading.chart}, scale moved by {reading.stretch:.2%} "
          f"+- {reading.stretch_deviation:.2%}")  # fmt: skip


def open_with_poses(
    folders: Mapping[str, Path], into: Path, *, from_video: bool, encoder: Path | None, limit: int | None, quiet: bool
) -> dict[str, RecordingSet]:
    """Open recording sets; the poses of all are read from their films first if they shall be, or if one has none.

    Args:
        folders: The sets, by the names of the folders that get their poses.
        into: Where these folders are made.
        from_video: Whether poses are read even where all are recorded.
        encoder: As for `track`; where one is given, poses are read.
        limit: As for `track`.
        quiet: As for `track`.
    """
    from physid.data import RecordingSet
    from physid.one_writer import refuse_links

    sets = {name: RecordingSet(folder) for name, folder in folders.items()}
    if not (from_video or encoder) and all(each.any_poses() for each in sets.values()):
        return sets
    refuse_links(into)
    return {name: _read_poses(each.folder, into / name, encoder, limit, quiet) for name, each in sets.items()}


def _read_poses(films: Path, into: Path, encoder: Path | None, limit: int | None, quiet: bool) -> RecordingSet:
    """Read poses from films, once, and return the set that has them (see `track`)."""
    from physid.data import RecordingSet
    from physid.one_writer import one_writer
    from physid.training.tracking.track import track as run

    if not quiet:
        print(f"Poses are read from the films of {films} into {into}", flush=True)
    with resumable(), one_writer(into), frame_bar(quiet) as say:
        run(films, into, encoder=encoder, limit=limit, say=say)
    return RecordingSet(into)
