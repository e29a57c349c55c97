"""Data sets of LeRobot, and tables of Parquet, as named columns, read by pyarrow, which is an extra."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from physid.data.files import read_json
from physid.data.importers.tables.table import Table

if TYPE_CHECKING:
    import pyarrow

Array = NDArray[np.float64]
INFO = Path("meta/info.json")
VERSIONS = ("v2.0", "v2.1", "v3.0")
"""Of LeRobot's format: one file for each episode, or, since v3.0, files of many episodes; columns are the same."""
STAMP, EPISODE = "timestamp", "episode_index"


def read_episodes(path: Path) -> Table:
    """Read the folder of a LeRobot data set, all episodes after one another, or one .parquet file.

    A column of numbers keeps its name; one of lists of n numbers becomes n columns, `observation.state/NAME` by the
    names that `meta/info.json` gives its components, else `observation.state[i]`. Films lie in files of their own and
    are not read.

    Raises:
        ValueError: If pyarrow is not installed, the data set is of another version or incomplete, or a file is damaged.
    """
    try:
        import pyarrow.parquet as parquet
    except ImportError:
        raise ValueError(
            f"{path}: data sets of LeRobot need pyarrow, which is not installed: pip install 'physid[lerobot]'"
        ) from None
    files, names = ([path], {}) if path.is_file() else _described(path)
    parts = list[dict[str, Array]]()
    for file in files:
        try:
            read = parquet.read_table(file)
        except PermissionError:
            raise
        except (OSError, ValueError) as error:  # pyarrow's errors are such
            raise ValueError(
                f"{file}: expected a table of Parquet, found what cannot be read ({' '.join(str(error).split())[:200]})"
            ) from None
        parts.append(dict(_columns(read, names)))
        if set(parts[-1]) != set(parts[0]):
            raise ValueError(f"{file}: expected the columns of {files[0].name}, found {', '.join(parts[-1])}")
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    if not columns:
        raise ValueError(f"{path}: expected columns of numbers, found none")
    return Table(path, columns, {}, {}, 0)


def _described(folder: Path) -> tuple[list[Path], dict[str, list[str]]]:
    """Return the tables of a data set in the order of episodes, and the names of components by column."""
    info = read_json(folder / INFO, "the description of a data set")
    version = info.get("codebase_version") if isinstance(info, dict) else None
    if version not in VERSIONS:
        raise ValueError(
            f"{folder / INFO}: expected a data set of version {' or '.join(VERSIONS)}, found {version!r}; LeRobot "
            "converts older ones"
        )
    files = sorted((folder / "data").glob("chunk-*/*.parquet"))
    promised = info.get("total_episodes")
    if not files or (version != "v3.0" and isinstance(promised, int) and promised != len(files)):
        raise ValueError(
            f"{folder}: expected {promised if version != 'v3.0' else 'the'} tables data/chunk-*/*.parquet that "
            f"{INFO} promises, found {len(files)}; download the data set again"
        )
    features = info.get("features")
    names = {}
    for name, feature in features.items() if isinstance(features, dict) else ():
        given = feature.get("names") if isinstance(feature, dict) else None
        if isinstance(given, dict) and len(given) == 1:  # {"motors": [...]}
            given = next(iter(given.values()))
        if isinstance(given, list) and all(isinstance(one, str) for one in given):
            names[name] = given
    return files, names


def _columns(read: pyarrow.Table, names: dict[str, list[str]]) -> Iterator[tuple[str, Array]]:
    """Yield the columns of numbers of a table, lists of one length taken apart."""
    for name in read.column_names:
        values = read.column(name).to_numpy()
        if values.dtype.kind in "fiub":
            yield name, values.astype(np.float64)
        elif all(map(_is_row, values)) and len({len(one) for one in values}) == 1:
            stacked = np.stack(list(values)).astype(np.float64)
            yield from zip(_named(name, names.get(name, ()), stacked.shape[1]), stacked.T, strict=True)


def _is_row(value: Any) -> bool:
    """Tell whether a cell is a list of numbers."""
    return isinstance(value, np.ndarray) and value.dtype.kind in "fiub" and value.ndim == 1


def _named(name: str, components: Sequence[str], count: int) -> list[str]:
    """Name the components of a column."""
    if count > 1 and len(components) == count and len(set(components)) == count:
        return [f"{name}/{one}" for one in components]
    return [name] if count == 1 else [f"{name}[{index}]" for index in range(count)]
