"""Data sets of LeRobot, and tables of Parquet, as named columns, read by pyarrow, which is an extra."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from physid.data.files import read_json
from physid.data.hdf5 import most_unpacked
from physid.data.importers.tables.packed import TooTightlyPackedError
from physid.data.importers.tables.table import Table, named_once

if TYPE_CHECKING:
    import pyarrow
    import pyarrow.parquet as parquet

Array = NDArray[np.float64]
INFO = Path("meta/info.json")
VERSIONS = ("v2.0", "v2.1", "v3.0")
"""Of LeRobot's format: one file for each episode, or, since v3.0, files of many episodes; columns are the same."""
EPISODE = "episode_index"
OF_EPISODE = (EPISODE, "length")
LENGTHS = ("meta/episodes.jsonl", "meta/episodes/chunk-*/*.parquet")
"""Where a data set says how many rows each episode has, before and since v3.0."""
AGAIN = "download the data set again"
BYTES, ROWS = 8, 1 << 12  # of a number as it is read, and what is read at once


def read_episodes(path: Path) -> Table:
    """Read the folder of a LeRobot data set, all episodes after one another, or one .parquet file.

    A column of numbers keeps its name; one of lists of n numbers becomes n columns, `observation.state/NAME` by the
    names that `meta/info.json` gives its components, else `observation.state[i]`. Films lie in files of their own and
    are not read.

    Raises:
        ValueError: If pyarrow is not installed, the data set is of another version or incomplete, or a file is damaged.
    """
    try:
        import pyarrow.parquet  # noqa: F401
    except ImportError:
        raise ValueError(
            f"{path}: data sets of LeRobot need pyarrow, which is not installed: pip install 'physid[lerobot]'"
        ) from None
    files, info = ([path], {}) if path.is_file() else _described(path)
    held = sum(file.stat().st_size for file in files)
    _Room(path, held).take(sum(map(_declared, files)))
    names = _names(info)
    parts = list[dict[str, Array]]()
    room = _Room(path, held)
    for file in files:
        read = _read(file, room)
        parts.append(named_once(file, _columns(read, names)))
        if set(parts[-1]) != set(parts[0]):
            raise ValueError(f"{file}: expected the columns of {files[0].name}, found {', '.join(parts[-1])}")
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    if not columns:
        raise ValueError(f"{path}: expected columns of numbers, found none")
    notes = _require_whole(path, info, columns, len(files), room)
    return Table(path, columns, {}, {}, 0, notes=notes)


@contextmanager
def _opened(file: Path) -> Iterator[parquet.ParquetFile]:
    """Open a table, of which its description alone is read at first, and name it where pyarrow cannot read it."""
    from pyarrow import ArrowException, parquet

    try:
        with parquet.ParquetFile(file) as table:
            yield table
    except (PermissionError, MemoryError, TooTightlyPackedError):
        raise
    except (OSError, ValueError, ArrowException) as error:
        raise ValueError(
            f"{file}: expected a table of Parquet, found what cannot be read ({' '.join(str(error).split())[:200]})"
        ) from None


class _Room:
    """What the tables of a data set may still take in memory; no more than their size on the disk promises."""

    def __init__(self, path: Path, held: int) -> None:
        self._path, self._most, self._taken = path, most_unpacked(held), 0

    def take(self, size: int) -> None:
        """Take so many bytes.

        Raises:
            TooTightlyPackedError: If there are not as many.
        """
        self._taken += size
        if self._taken > self._most:
            raise TooTightlyPackedError(
                f"{self._path}: expected numbers of {self._most} bytes at most, as its size on the disk promises, found"
                f" {self._taken} or more; leave out rows or columns that are not used"
            )


def _declared(file: Path, names: Sequence[str] | None = None) -> int:
    """Return how many bytes the numbers of a table take at least, by its rows and columns.

    What it says of the single columns is not asked for: pyarrow ends the process where that is damaged.
    """
    with _opened(file) as table:
        return BYTES * int(table.metadata.num_rows) * len(names or _wanted(table.schema_arrow))


def _read(file: Path, room: _Room, names: Sequence[str] | None = None) -> pyarrow.Table:
    """Read the columns of numbers of a table, or those of some names, and measure them: lists may be of any length."""
    import pyarrow

    with _opened(file) as table:
        wanted, batches = _wanted(table.schema_arrow), list[pyarrow.RecordBatch]()
        wanted = [name for name in wanted if names is None or name in names]
        for batch in table.iter_batches(batch_size=ROWS, columns=wanted):
            room.take(batch.nbytes)
            batches.append(batch)
        if not batches:
            return table.schema_arrow.empty_table().select(wanted)
        return pyarrow.Table.from_batches(batches)


def _wanted(schema: pyarrow.Schema) -> list[str]:
    """Return the columns that hold numbers."""
    return [field.name for field in schema if _holds_numbers(field.type)]


def _holds_numbers(kind: pyarrow.DataType) -> bool:
    """Return whether the cells of a column are numbers, or lists of numbers."""
    from pyarrow import types

    if types.is_dictionary(kind) or types.is_list(kind) or types.is_large_list(kind) or types.is_fixed_size_list(kind):
        kind = kind.value_type
    return bool(types.is_integer(kind) or types.is_floating(kind) or types.is_boolean(kind))


def _described(folder: Path) -> tuple[list[Path], dict[str, Any]]:
    """Return the tables of a data set in the order of episodes, and what it says of itself."""
    info: Any = read_json(folder / INFO, "the description of a data set", AGAIN)
    version = info.get("codebase_version") if isinstance(info, dict) else None
    if version not in VERSIONS:
        raise ValueError(
            f"{folder / INFO}: expected a data set of version {' or '.join(VERSIONS)}, found {version!r}; LeRobot "
            "converts older ones"
        )
    files = sorted((folder / "data").glob("chunk-*/*.parquet"))
    if not files:
        raise ValueError(
            f"{folder}: expected the tables data/chunk-*/*.parquet that {INFO} promises, found none; {AGAIN}"
        )
    return files, info


def _require_whole(
    path: Path, info: Mapping[str, Any], columns: Mapping[str, Array], files: int, room: _Room
) -> tuple[str, ...]:
    """Refuse a data set of which some rows are missing; whole episodes may be, and a note says so."""
    found = {"total_frames": len(next(iter(columns.values())))}
    episodes, counts = np.unique(columns.get(EPISODE, []), return_counts=True)
    if EPISODE in columns:
        found["total_episodes"] = len(episodes)
    elif info.get("codebase_version") != VERSIONS[-1]:
        found["total_episodes"] = files
    off = {name: info[name] for name in found if isinstance(info.get(name), int) and info[name] != found[name]}
    if not off:
        return ()
    lengths = _lengths(path, room) if EPISODE in columns else {}
    known = {"total_frames": sum(lengths.values()), "total_episodes": len(lengths)}
    if any(isinstance(info.get(name), int) and info[name] != count for name, count in known.items()):
        name = next(iter(off))
        raise ValueError(
            f"{path}: expected {off[name]} {name}, which {INFO} promises, found {found[name]}; {AGAIN}, or, of a part "
            f"of it, with {' or '.join(LENGTHS)}, which say how long each of all episodes is"
        )
    for episode, count in zip(episodes, counts, strict=True):
        if lengths.get(episode) != count:
            raise ValueError(
                f"{path}: expected {lengths.get(episode, 'no')} rows of episode {episode:g}, as its description in "
                f"meta/ promises, found {count}; {AGAIN}"
            )
    return (f"{path}: {len(episodes)} of {len(lengths)} episodes are there, each of them whole",)


def _lengths(folder: Path, room: _Room) -> dict[int, int]:
    """Return the number of rows of each episode, as far as a data set says it."""
    lines = folder / LENGTHS[0]
    found: list[Any] = read_json(lines, "the lengths of episodes", AGAIN, lines=True) if lines.is_file() else []
    for file in sorted(folder.glob(LENGTHS[1])):
        room.take(_declared(file, OF_EPISODE))
        found += _read(file, room, OF_EPISODE).to_pylist()
    pairs = [[one.get(name) for name in OF_EPISODE] for one in found if isinstance(one, dict)]
    return {index: rows for index, rows in pairs if isinstance(index, int) and isinstance(rows, int)}


def _names(info: Mapping[str, Any]) -> dict[str, list[str]]:
    """Return the names of components by column, as far as a data set says them."""
    features, names = info.get("features"), {}
    for name, feature in features.items() if isinstance(features, dict) else ():
        given = feature.get("names") if isinstance(feature, dict) else None
        if isinstance(given, dict) and len(given) == 1:  # {"motors": [...]}
            given = next(iter(given.values()))
        if isinstance(given, list) and all(isinstance(one, str) for one in given):
            names[name] = given
    return names


def _columns(read: pyarrow.Table, names: dict[str, list[str]]) -> Iterator[tuple[str, Array]]:
    """Yield the columns of numbers of a table, lists of one length taken apart."""
    for index, name in enumerate(read.column_names):
        values = read.column(index).to_numpy()
        if values.dtype.kind in "fiub":
            yield name, values.astype(np.float64)
        elif all(map(_is_row, values)) and len({len(one) for one in values}) == 1:
            stacked = np.stack(list(values)).astype(np.float64)
            yield from zip(_named(name, names.get(name, ()), stacked.shape[1]), stacked.T, strict=True)


def _is_row(value: Any) -> bool:
    """Return whether a cell is a list of numbers."""
    return isinstance(value, np.ndarray) and value.dtype.kind in "fiub" and value.ndim == 1


def _named(name: str, components: Sequence[str], count: int) -> list[str]:
    """Name the components of a column."""
    if count > 1 and len(components) == count and len(set(components)) == count:
        return [f"{name}/{one}" for one in components]
    return [name] if count == 1 else [f"{name}[{index}]" for index in range(count)]
