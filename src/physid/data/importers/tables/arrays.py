"""NumPy archives as named columns."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Iterator, Mapping
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physid.data.hdf5 import most_unpacked
from physid.data.importers.tables.table import Table, named_once

MOST_COLUMNS = 10_000


def read_arrays(path: Path) -> Table:
    """Read a NumPy archive: an array (T, a, b) is a*b columns, named `array[i,j]`.

    Raises:
        ValueError: If it is damaged, or holds no arrays of numbers.
    """
    try:
        with path.open("rb") as file, zipfile.ZipFile(file) as packed:
            size = sum(entry.file_size for entry in packed.infolist())
            if size > most_unpacked(path.stat().st_size):
                raise ValueError(f"{size} bytes packed into {path.stat().st_size}")
            for entry in packed.infolist():
                _require_held(packed, entry)
            file.seek(0)
            with np.load(file, allow_pickle=False) as archive:
                arrays = {name: np.asarray(archive[name]) for name in archive.files}
    except PermissionError:
        raise
    except (ValueError, OSError, KeyError, EOFError, RuntimeError, zlib.error, zipfile.BadZipFile) as error:
        raise ValueError(f"{path}: expected a NumPy archive of numbers, found what cannot be read ({error})") from None
    numbers = {name: each for name, each in arrays.items() if each.dtype.kind in "fiub" and each.ndim}
    if not numbers:
        raise ValueError(
            f"{path}: expected arrays of numbers with time as first axis, found {', '.join(arrays) or 'none'}"
        )
    if (count := sum(prod(each.shape[1:]) for each in numbers.values())) > MOST_COLUMNS:
        raise ValueError(
            f"{path}: expected arrays with time as first axis, {MOST_COLUMNS} columns at most, found {count}; turn or "
            "thin them"
        )
    return Table(path, named_once(path, _columns(numbers)), {}, {}, 0)


def _columns(arrays: Mapping[str, NDArray[Any]]) -> Iterator[tuple[str, NDArray[np.float64]]]:
    """Yield the columns of arrays, those of several axes taken apart."""
    for name, each in arrays.items():
        if each.ndim == 1:
            yield name, each.astype(np.float64)
        else:
            for place in np.ndindex(each.shape[1:]):
                yield f"{name}[{','.join(map(str, place))}]", each[(slice(None), *place)].astype(np.float64)


def _require_held(packed: zipfile.ZipFile, entry: zipfile.ZipInfo) -> None:
    """Refuse an array whose header declares more than its entry holds, before anything is allocated."""
    with packed.open(entry) as file:
        version = np.lib.format.read_magic(file)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, dtype = read(file)
    if prod(shape) * dtype.itemsize > entry.file_size:
        raise ValueError(f"{entry.filename} declares {shape} of {dtype} in {entry.file_size} bytes")
