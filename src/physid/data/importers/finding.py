"""Which files are logs, and which log of forces belongs to which log of poses."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from physid.data.importers.tables.files import BAG, EPISODES, read_table
from physid.data.importers.tables.table import MissingColumnError

SUFFIXES = {
    "csv": (".csv", ".tsv", ".txt"),
    "npz": (".npz",),
    "mcap": (".mcap",),
    "rosbag": (".bag", ".db3"),
    "lerobot": (".parquet",),
    "mp4": (".mp4", ".mov", ".avi", ".mkv", ".webm", ".m4v"),
}
MAGIC = "*?["
WHOLE = {"mcap": BAG, "rosbag": BAG, "lerobot": EPISODES}
"""The file by which a folder is recognised as one log, by kind."""


def kind_of(place: str) -> str | None:
    """Return which kind of log a file or folder is, from its ending or what lies in it; None if nothing does."""
    found = next((kind for kind, suffixes in SUFFIXES.items() if place.lower().endswith(suffixes)), None)
    return found or next((kind for kind, mark in WHOLE.items() if (Path(place) / mark).is_file()), None)


def natural(path: Path) -> list[tuple[bool, int, str]]:
    """Return a key that sorts run_2 before run_10."""
    parts = re.split(r"(\d+)", path.name)
    return [(part.isdigit(), int(part) if part.isdigit() else 0, part) for part in parts]


def find_logs(sources: Sequence[Path], kind: str, forces: str | None = None) -> list[Path]:
    """Return the logs of poses that files, folders and patterns mean.

    Args:
        sources: Files, folders, or patterns such as logs/run_*.csv.
        kind: A key of `SUFFIXES`: what counts in a folder.
        forces: Pattern of the logs of forces, which are left out.

    Raises:
        FileNotFoundError: If one of them means nothing.
    """
    found: list[Path] = []
    for source in sources:
        if source.is_dir():
            here = [source] if _is_whole(source, kind) else [one for one in source.iterdir() if _is_log(one, kind)]
            what = f"no {' or '.join(SUFFIXES[kind])} file in it" + (f", and no {WHOLE[kind]}" if kind in WHOLE else "")
        elif any(sign in source.name for sign in MAGIC) and not source.exists():
            here, what = list(source.parent.glob(source.name)), "nothing like it"
        else:
            here, what = ([source] if source.is_file() else []), "no such file or folder"
        if not here:
            raise FileNotFoundError(f"{source}: expected logs to import, found {what}")
        found += sorted(here, key=natural)
    others = re.sub(r"\{stem\}", "*", Path(forces).name) if forces else None
    return [one for one in found if not (others and one.match(others))] or found


def logs_beside(path: Path) -> list[tuple[Path, str]]:
    """Return files of the same kind whose names hold that of a log, and their names with {stem} in its place."""
    whole = re.compile(rf"(?<![0-9A-Za-z]){re.escape(path.stem)}(?![0-9A-Za-z])")
    here = sorted(path.parent.glob(f"*{path.suffix}"), key=natural) if path.is_file() else []
    return [
        (one, whole.sub("{stem}", one.stem, 1) + one.suffix)
        for one in here
        if one != path and one.is_file() and whole.search(one.stem)
    ]


@contextmanager
def explained(file: Path, files: Sequence[Path]) -> Iterator[None]:
    """Say of a column that a log does not have which log beside it has it.

    Args:
        file: The log that is read.
        files: All logs of poses.

    Raises:
        ValueError: In place of that of a missing column, with where it is.
    """
    try:
        yield
    except MissingColumnError as error:
        raise ValueError(f"{error}{_elsewhere(error.column.removeprefix('-'), file, files)}") from None


def _elsewhere(column: str, file: Path, files: Sequence[Path]) -> str:
    """Return where a column is that a log does not have, and what to do; nothing where no log beside it has it."""
    for other, pattern in logs_beside(file):
        if _has(other, column):
            return f"; {other.name} beside it has it: forces.file={pattern} (and forces.time, its column of stamps)"
    for other in files:
        pattern = next((found for one, found in logs_beside(other) if one == file), "")
        if pattern and _has(other, column):
            return (
                f"; it looks like a log of something else beside {other.name}, which has it: name it forces.file="
                f"{pattern} if it holds forces, or name the logs of poses alone"
            )
    return ""


def _has(file: Path, column: str) -> bool:
    """Return whether a log has a column."""
    try:
        read_table(file).find(column)
    except (ValueError, OSError):
        return False
    return True


def _is_log(path: Path, kind: str) -> bool:
    """Tell whether a file is a log of a kind, or a folder one log."""
    return (path.suffix.lower() in SUFFIXES[kind] and path.is_file()) or _is_whole(path, kind)


def _is_whole(path: Path, kind: str) -> bool:
    """Tell whether a folder is one log: a bag, a data set."""
    return kind in WHOLE and (path / WHOLE[kind]).is_file()


def force_logs(files: Sequence[Path], pattern: str | None) -> list[Path | None]:
    """Return the log of forces that belongs to each log of poses; None where they share one.

    Args:
        files: Logs of poses.
        pattern: Name of the logs of forces beside them; {stem} stands for the name of the log of poses.

    Raises:
        ValueError: If there are not as many.
        FileNotFoundError: If there is none.
    """
    if pattern is None:
        return [None] * len(files)
    if "{stem}" in pattern:
        return [_beside(file, pattern.replace("{stem}", file.stem)) for file in files]
    if not any(sign in pattern for sign in MAGIC):
        found = [_beside(files[0], pattern)]
    else:
        place = Path(pattern)
        bases = [files[0].parent / place.parent, place.parent]
        listed = [[one for one in base.glob(place.name) if one not in files] for base in bases if base.is_dir()]
        found = sorted(next((each for each in listed if each), []), key=natural)
    if not found:
        raise FileNotFoundError(f"forces.file: expected logs of forces like {pattern} beside {files[0]}, found none")
    if len(found) != len(files):
        raise ValueError(
            f"forces.file: expected one log of forces for each of {len(files)} logs of poses, found {len(found)} like "
            f"{pattern}; use {{stem}} for the name of the log of poses, say {{stem}}_forces.csv"
        )
    return list(found)


def _beside(file: Path, name: str) -> Path:
    """Return a file by its path, beside another one or in the working folder."""
    for place in (file.parent / name, Path(name)):
        if place.is_file():
            return place
    raise FileNotFoundError(f"{file.parent / name}: expected a log of forces (forces.file), found no such file")
