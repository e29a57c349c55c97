"""HDF5 files from strangers: whatever a file declares, reading it costs no more than what it holds."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from math import prod
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

FILTERS = {1: "gzip", 2: "shuffle", 3: "fletcher32", 32000: "lzf"}  # by their numbers in HDF5; others run foreign code
MOST_COMPRESSION = 1032
"""Bytes that one byte of deflate can stand for (zlib's technical notes); LZF reaches less."""
MOST_PACKED, FREE = 100, 1 << 26
"""The same of floating-point numbers, as in logs of any kind, and bytes that are free: forces that stay the same pack
better, motion packs two to ten times."""
LONGEST_TEXT = 4096  # bytes of a text attribute
Index = int | slice | tuple[()]


class FormatError(ValueError):
    """What is wrong with an open file; `opened` adds the file's name."""


def most_unpacked(held: int) -> int:
    """Return how many bytes of numbers so many bytes of a file may stand for."""
    return max(MOST_PACKED * held, FREE)


@contextmanager
def opened(path: Path) -> Iterator[h5py.File]:
    """Open a file for reading; whatever HDF5 stumbles over while it is open becomes one error.

    Raises:
        ValueError: If it is no HDF5 file, or a damaged one.
        FileNotFoundError: If there is no such file.
        PermissionError: If it may not be read.
    """
    if not path.is_file():
        raise FileNotFoundError(f"{path}: expected a trajectory, found no such file")
    with path.open("rb"):
        pass  # what the system refuses is told in its own words
    try:
        file = h5py.File(path, "r", locking="best-effort")
    except (OSError, RuntimeError, ValueError) as error:
        raise ValueError(f"{path}: expected an HDF5 file, found one that cannot be opened ({error})") from None
    try:
        with file:
            yield file
    except FormatError as error:
        raise ValueError(f"{path}: {error}") from None
    except (OSError, RuntimeError, KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise ValueError(
            f"{path}: expected a sound HDF5 file, found a damaged one ({error}); restore it, or convert it again"
        ) from None


def names_in(file: h5py.File) -> list[str]:
    """Return the names of all datasets.

    Raises:
        ValueError: If something is no dataset of this very file: a group, or a link to elsewhere.
    """
    names = list(file)
    for name in names:
        if not isinstance(file.get(name, getlink=True), h5py.HardLink) or not isinstance(file[name], h5py.Dataset):
            raise FormatError(f"{name}: expected a dataset of this file, found a group or a link")
    return names


def declared(file: h5py.File, name: str) -> tuple[np.dtype[Any], tuple[int, ...]]:
    """Return type and shape that a dataset declares, once the file is known to hold as much.

    Raises:
        ValueError: If it declares more than is there, or its numbers lie elsewhere or in an unknown compression.
    """
    dataset = file[name]
    if dataset.is_virtual or dataset.external:
        raise FormatError(f"{name}: expected numbers in this file, found some that lie in another; copy them into it")
    settings = dataset.id.get_create_plist()
    filters = [int(settings.get_filter(index)[0]) for index in range(settings.get_nfilters())]
    strange = [one for one in filters if one not in FILTERS]
    if strange:
        raise FormatError(f"{name}: expected gzip, lzf or no compression, found HDF5 filter {strange[0]}")
    shape, dtype = dataset.shape, dataset.dtype
    if shape is None or dtype.hasobject:
        raise FormatError(f"{name}: expected an array of numbers, found {dtype}")
    size, held = prod(shape) * dtype.itemsize, int(dataset.id.get_storage_size())
    packed = any(FILTERS[one] in ("gzip", "lzf") for one in filters)
    most = held * (MOST_COMPRESSION if packed else 1)
    if packed and dtype.kind == "f":
        most = min(most, most_unpacked(held))
    if size > most or held > Path(file.filename).stat().st_size:
        raise FormatError(f"{name}: expected the {size} bytes of shape {shape}, found {held} in the file")
    if dataset.chunks is not None:
        chunks = prod(-(-have // want) for have, want in zip(shape, dataset.chunks, strict=True))
        if dataset.id.get_num_chunks() != chunks or prod(dataset.chunks) * dtype.itemsize > max(2 * size, 1 << 20):
            raise FormatError(f"{name}: expected {chunks} chunks of {dataset.chunks}, found others or too large ones")
    return dtype, shape


def read_dataset(file: h5py.File, name: str, index: Index = ()) -> NDArray[Any]:
    """Read a dataset, or a part of it, and let HDF5 verify its checksum.

    Raises:
        ValueError: If the checksum does not fit, or the file does not hold what it declares.
    """
    declared(file, name)
    try:
        return np.asarray(file[name][index])
    except (OSError, RuntimeError) as error:
        raise FormatError(
            f"{name}: expected data that fit their checksum, found damaged ones ({error}); restore or regenerate the "
            "file"
        ) from None


def read_text(file: h5py.File, name: str) -> str | None:
    """Return a text attribute, or None where there is none.

    Raises:
        ValueError: If it is no text, or a very long one.
    """
    if name not in file.attrs:
        return None
    attribute = file.attrs.get_id(name)
    value = file.attrs[name] if attribute.shape in ((), None) and attribute.dtype.itemsize <= LONGEST_TEXT else None
    if isinstance(value, h5py.Empty):
        return None
    value = value.decode(errors="replace") if isinstance(value, bytes) else value
    if not isinstance(value, str) or len(value) > LONGEST_TEXT:
        raise FormatError(f"{name}: expected a text of at most {LONGEST_TEXT} characters, found another attribute")
    return str(value)
