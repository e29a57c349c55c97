"""The command that brings recordings from elsewhere."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from physid.data.importers import Imported

KINDS = ("csv", "npz", "mcap", "rosbag", "lerobot", "mp4", "cube-tosses")


def import_(
    kind: Literal["csv", "npz", "mcap", "rosbag", "lerobot", "mp4", "cube-tosses"] | str,
    sources: list[Path] | None = None,
    *,
    out: Path | None = None,
    mapping: Path | None = None,
    map: list[str] | None = None,
    guess: bool = False,
) -> None:
    """Convert logs of poses and forces, or films, to a recording set.

    A mapping says which columns are what: a YAML file, or key=value on the command line, or both. It names positions,
    orientations, forces, their units and axes, the clock, and the body with its size (docs/importing.md has all keys).
    Nothing is estimated, smoothed or resampled. Each log becomes a trajectory of the set.

    csv: text with one row per frame; npz: NumPy arrays with time as first axis; mcap, rosbag: bags of ROS 1 or 2, a
    column being TOPIC/field, say /block/pose/pose/position (needs physid[mcap]); lerobot: a data set of LeRobot, of
    which each episode becomes a trajectory (needs physid[lerobot]); mp4: films or folders of images, with a camera
    file, from which physid track reads poses; cube-tosses: the real tosses that were published with ContactNets (a
    folder with files N.pt, 148 Hz).

    Examples:
      physid import csv log.csv --guess > mapping.yaml
      physid import csv logs/run_*.csv --mapping mapping.yaml --out data/mine
      physid import csv log.csv time=t position=[x,y,z] quaternion=[qw,qx,qy,qz] units.position=mm axes=y-up
        size=[0.1,0.1,0.05] mass=0.4 force=[fx,fy,fz] forces.file=forces.csv forces.time=t
      physid import run.mcap --guess > mapping.yaml
      physid import mp4 films camera=camera.yaml size=[0.12,0.08,0.06] mass=0.5 force=[fx,fy,fz]
        forces.file={stem}_forces.csv forces.time=t --out data/films
      physid import cube-tosses FOLDER --out data/cube

    Args:
        kind: csv, npz, mcap, rosbag, lerobot, mp4 or cube-tosses; may be left out before a file whose ending says it.
        sources: Files, folders or patterns.
        out: Folder of the recording set; data/NAME of the first source by default.
        mapping: YAML file that says what the columns are.
        map: One more key=value of the mapping; may be repeated, and the word --map be left out.
        guess: Print a mapping that names and values suggest, and which parts are uncertain, instead.
    """
    from physid.data.importers import find_logs, guess_mapping, import_logs, read_mapping, with_episodes

    kind, places = _sorted(kind, sources or [])
    if guess and kind in ("mp4", "cube-tosses"):
        raise ValueError(f"--guess belongs to logs, got it with {kind}; docs/films.md lists the keys of a film")
    if kind == "cube-tosses" and (mapping or map or len(places) > 1):
        raise ValueError("cube-tosses: expected one folder and no mapping, for its files say what they hold")
    if kind == "mp4":
        _say(_import_films(places, read_mapping(mapping, map or []), out or Path("data") / _name(places)))
        return
    target = out or Path("data") / (kind if kind == "cube-tosses" else _name(places))
    if kind == "cube-tosses":
        from physid.data.importers import import_cube_tosses
        from physid.one_writer import one_writer

        with one_writer(target):
            count = import_cube_tosses(places[0], target)
        print(f"{target}: {count} trajectories")
        return
    values = read_mapping(mapping, map or [])
    if kind == "lerobot":
        values = with_episodes(values)
    forces = values.get("forces")
    pattern = forces.get("file") if isinstance(forces, dict) else None
    files = find_logs(places, kind, pattern if isinstance(pattern, str) else None)
    if guess:
        print(guess_mapping(files[0]), end="")
        return
    _say(import_logs(files, values, target))


def _name(places: list[Path]) -> str:
    """Return what a set is called after the first of its sources."""
    return places[0].resolve().stem.strip("*?[]_ ")


def _say(done: Imported) -> None:
    """Say what was imported, and what was taken for granted."""
    from physid.commands.terminal.screen import say

    many = f"{done.trajectories} trajector{'y' if done.trajectories == 1 else 'ies'}"
    say(*done.notes, f"{done.folder}: {many}")


def _sorted(kind: str, sources: list[Path]) -> tuple[str, list[Path]]:
    """Return what the logs are, and where.

    Raises:
        ValueError: If it is no kind of log, or nothing is named.
    """
    from physid.data.importers import kind_of
    from physid.strict import nearest

    if kind not in KINDS:
        found = kind_of(kind)
        if found is None:
            raise ValueError(f'import: unknown kind "{kind}"{nearest(kind, (*KINDS, "a .csv or .npz file"))}')
        return found, [Path(kind), *sources]
    if not sources:
        raise ValueError(f"import: expected files or a folder after {kind}, found none")
    return kind, sources


def _import_films(places: list[Path], values: dict[str, Any], out: Path) -> Imported:
    """Convert films, or folders of images (see `physid import mp4`)."""
    from physid.commands.terminal.screen import frame_bar
    from physid.data.importers.video.convert import import_films as run
    from physid.data.importers.video.films import find_films

    films = find_films(places)
    with frame_bar(quiet=False) as say:
        return run(films, values, out, say)
