"""Which reader a log wants, by its ending or by what lies in a folder."""

from __future__ import annotations

from pathlib import Path

from physid.data.importers.tables.arrays import read_arrays
from physid.data.importers.tables.table import Table
from physid.data.importers.tables.text import read_text
from physid.data.refusals import NoRoomError

TEXT, ARRAYS, ROWS, BAGS = (".csv", ".tsv", ".txt", ".log", ".dat"), (".npz",), (".parquet",), (".mcap", ".bag", ".db3")
BAG, EPISODES = "metadata.yaml", "meta/info.json"
"""What a folder that is one log holds: a bag of ROS 2, a data set of LeRobot."""


def read_table(path: Path, *, header: int | None = None) -> Table:
    """Read a log: text, a NumPy archive, a bag of ROS, or a table or data set of LeRobot.

    Args:
        path: The file, or the folder of a bag or of a data set.
        header: Line of a text file that names the columns, counted from 1; the first one that is no comment by default.

    Raises:
        FileNotFoundError: If there is no such file.
        ValueError: If it is of another kind, empty, damaged, a cell is no number, or its reader is not installed.
        NoRoomError: If the memory is too small for it.
    """
    try:
        return _read(path, header)
    except MemoryError:
        raise NoRoomError(
            f"{path}: expected room in memory for all of it, found none; split it, or leave out rows and columns that "
            "are not used"
        ) from None


def _read(path: Path, header: int | None) -> Table:
    """Read a log by its kind."""
    kind = path.suffix.lower()
    if (path / EPISODES).is_file() or (kind in ROWS and path.is_file()):
        from physid.data.importers.tables.episodes import read_episodes

        return read_episodes(path)
    if (path / BAG).is_file() or (kind in BAGS and path.is_file() and path.stat().st_size):
        from physid.data.importers.tables.bags import read_bag

        return read_bag(path)
    if not path.is_file():
        raise FileNotFoundError(f"{path}: expected a log, found no such file")
    if path.stat().st_size == 0:
        raise ValueError(f"{path}: expected rows of numbers, found an empty file")
    if kind in ARRAYS:
        return read_arrays(path)
    if kind not in TEXT:
        raise ValueError(f"{path}: expected a .csv, .tsv, .txt or .npz file, found {path.suffix or 'no suffix'}")
    return read_text(path, header)
