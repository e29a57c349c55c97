"""Logs as named columns: CSV files and NumPy archives."""

from __future__ import annotations

import csv
import re
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from math import prod
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from physid.data.importers.units import UNITS, canonical, split_header
from physid.strict import nearest

Array = NDArray[np.float64]
DELIMITERS = (",", ";", "\t", " ")
EMPTY = {"", "nan", "none", "null", "na", "n/a", "-", "#n/a"}  # cells that say: nothing was measured
TRUE = {"true": 1.0, "false": 0.0}
PEEK, CHUNK = 50, 1 << 16  # rows
ALIKE = 0.8  # share of lines that a delimiter splits into as many cells as the first
MOST_PACKED = 100  # times the size of an archive that its arrays may have; motion packs two to ten times
LONGEST_LINE = 1 << 20  # characters: a file with longer lines is no table
PLACE = re.compile(r"^(?P<name>.+?)\[(?P<index>[\d,\s]+)\]$")


@dataclass(frozen=True)
class Table:
    """A log.

    Attributes:
        path: The file.
        columns: Values by column, each of shape (T,); NaN where a cell is empty.
        units: The unit that the file itself states for a column.
        words: The first cell of a column that is no number, and its line; such a column cannot be used.
        line: Line of the file (or row of the arrays) at which the first row stands.
    """

    path: Path
    columns: dict[str, Array]
    units: dict[str, str]
    words: dict[str, tuple[int, str]]
    line: int

    def values(self, name: object) -> Array:
        """Return the values of a column, shape (T,).

        Raises:
            ValueError: If there is no such column, or it holds something else than numbers.
        """
        found = self.find(name)
        if found in self.words:
            line, cell = self.words[found]
            raise ValueError(f'{self.path}:{line}: expected a number in column "{found}", found "{cell[:40]}"')
        return self.columns[found]

    def find(self, name: object) -> str:
        """Return the column that a name means: its header, with or without unit; without headers its number.

        Raises:
            ValueError: If there is none; the message names the nearest.
        """
        wanted = str(name).strip()
        if wanted in self.columns:
            return wanted
        bare = [each for each in self.columns if split_header(each)[0] == wanted]
        if len(bare) == 1:
            return bare[0]
        same = [each for each in self.columns if each.lower() == wanted.lower()]
        close = f'; did you mean "{same[0]}"?' if same else nearest(wanted, self.columns)
        last = len(self.columns) - 1
        if list(self.columns) == [str(number) for number in range(last + 1)]:
            close = (
                f"; no line names them, so that they are numbered from 0 to {last}: use these numbers, "
                "or write a line of names above the rows"
            )
        raise ValueError(f'{self.path}: no column "{wanted}"{close}')

    def components(self, name: object) -> list[str]:
        """Return the columns that one name stands for: several for an array with more than one axis."""
        inside = [each for each in self.columns if each.startswith(f"{name}[")]
        return inside if inside and str(name) not in self.columns else [self.find(name)]


def read_table(path: Path, *, header: int | None = None) -> Table:
    """Read a .csv, .tsv, .txt or .npz file.

    Args:
        path: The file.
        header: Line of a text file that names the columns, counted from 1; the first one that is no comment by default.

    Raises:
        FileNotFoundError: If there is no such file.
        ValueError: If it is of another kind, empty, damaged, or a cell is no number.
    """
    if not path.is_file():
        raise FileNotFoundError(f"{path}: expected a log, found no such file")
    if path.stat().st_size == 0:
        raise ValueError(f"{path}: expected rows of numbers, found an empty file")
    if path.suffix.lower() == ".npz":
        return _read_npz(path)
    if path.suffix.lower() not in (".csv", ".tsv", ".txt", ".log", ".dat"):
        raise ValueError(f"{path}: expected a .csv, .tsv, .txt or .npz file, found {path.suffix or 'no suffix'}")
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            return _read_csv(path, file, header)
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: expected text in UTF-8, found byte {error.object[error.start]:#04x}") from None
    except csv.Error as error:
        raise ValueError(f"{path}: expected a table, found none ({error})") from None


def _read_csv(path: Path, file: TextIO, header: int | None) -> Table:
    """Read a text file: head first, then its rows in chunks."""
    head = [line.rstrip("\r\n") for line in islice(_lines(path, file), PEEK)]
    start = (header or 1) - 1
    while (
        header is None and start < len(head) and (not head[start].strip() or head[start].startswith(("#", "%", "//")))
    ):
        start += 1
    if start >= len(head):
        raise ValueError(f"{path}: expected rows of numbers, found {len(head)} lines without any")
    delimiter = _delimiter(head[start:])
    rows = [[cell.strip() for cell in _cells(line, delimiter)] for line in head[start:] if line.strip()]
    comma = delimiter != "," and any(re.fullmatch(r"[+-]?\d+,\d+", cell) for row in rows[1:] for cell in row)
    named = not all(_is_number(cell, comma) for cell in rows[0])
    names = rows[0] if named else [str(index) for index in range(len(rows[0]))]
    if not named and start and head[start - 1].startswith(("#", "%")):  # a header that is written as a comment
        said = [cell.strip() for cell in _cells(head[start - 1].lstrip("#% "), delimiter)]
        names = said if len(said) == len(names) else names
    doubled = next((name for index, name in enumerate(names) if name in names[:index]), None)
    if doubled is not None:
        raise ValueError(f'{path}: expected each column once, found "{doubled}" twice; rename one in line {start + 1}')
    units = {name: unit for name in names if (unit := split_header(name)[1])}
    stated = named and len(rows) > 1 and _is_unit_row(rows[1])
    if stated:
        units |= {name: cell.strip("[]()") for name, cell in zip(names, rows[1], strict=False) if cell.strip("[]()")}
    first = start + int(named) + int(stated)
    file.seek(0)
    words: dict[str, tuple[int, str]] = {}
    reader = _Rows(path, delimiter, names, comma, words)
    values = reader.read(islice(_lines(path, file), first, None), first + 1)
    if not len(values):
        raise ValueError(f"{path}: expected rows of numbers under the header, found none")
    return Table(path, dict(zip(names, values.T, strict=True)), units, words, first + 1)


@dataclass(frozen=True)
class _Rows:
    """How rows are read; first words that are no numbers are noted, as they matter only in columns that are used."""

    path: Path
    delimiter: str
    names: Sequence[str]
    comma: bool
    words: dict[str, tuple[int, str]]

    def read(self, lines: Iterator[str], first: int) -> Array:
        """Read rows of numbers, in C where every cell is one, else cell by cell."""
        parts: list[Array] = []
        delimiter = None if self.delimiter == " " else self.delimiter
        while chunk := list(islice(lines, CHUNK)):
            try:
                if self.comma or chunk[0].isspace():
                    raise ValueError
                part = np.loadtxt(chunk, delimiter=delimiter, ndmin=2, comments=None)
                if part.shape != (len(chunk), len(self.names)):
                    raise ValueError
            except ValueError:
                part = self._read_slowly(chunk, first)
            parts.append(part)
            first += len(chunk)
        return np.concatenate(parts) if parts else np.empty((0, len(self.names)))

    def _read_slowly(self, lines: Sequence[str], first: int) -> Array:
        """Read rows cell by cell."""
        rows = []
        for number, line in enumerate(lines, first):
            if not line.strip() or line.startswith("#"):
                continue
            cells = [cell.strip() for cell in _cells(line.rstrip("\r\n"), self.delimiter)]
            if len(cells) == len(self.names) + 1 and not cells[-1]:
                cells.pop()  # a delimiter at the end of the line
            if len(cells) != len(self.names):
                raise ValueError(
                    f"{self.path}:{number}: expected {len(self.names)} cells as in the header, found {len(cells)}; is "
                    "the last line cut off, or the delimiter another one?"
                )
            rows.append([self._number(number, name, cell) for name, cell in zip(self.names, cells, strict=True)])
        return np.array(rows, dtype=np.float64).reshape(-1, len(self.names))

    def _number(self, line: int, name: str, cell: str) -> float:
        """Return the number in a cell, NaN where there is none."""
        low = cell.lower()
        if low in EMPTY:
            return float("nan")
        try:
            return TRUE[low] if low in TRUE else float(cell.replace(",", ".") if self.comma else cell)
        except ValueError:
            self.words.setdefault(name, (line, cell))
            return float("nan")


def _lines(path: Path, file: TextIO) -> Iterator[str]:
    """Yield lines; one that never ends is refused."""
    while line := file.readline(LONGEST_LINE):
        if len(line) >= LONGEST_LINE:
            raise ValueError(f"{path}: expected lines of text, found one of more than {LONGEST_LINE} characters")
        yield line


def _cells(line: str, delimiter: str) -> list[str]:
    """Split a line into cells."""
    return line.split() if delimiter == " " else next(csv.reader([line], delimiter=delimiter), [])


def _delimiter(lines: Sequence[str]) -> str:
    """Return what splits all lines into the same number of cells, the most."""

    def fits(delimiter: str) -> tuple[bool, bool, int]:
        counts = [len(_cells(line, delimiter)) for line in lines if line.strip()]
        return counts[0] > 1, counts.count(counts[0]) >= ALIKE * len(counts), counts[0]

    # A semicolon goes before the comma: where it is the delimiter, the comma may stand in numbers.
    return max(DELIMITERS, key=lambda one: (*fits(one)[:2], one in ";\t", fits(one)[2]))


def _is_number(cell: str, comma: bool = False) -> bool:
    """Tell whether a cell holds a number, or nothing."""
    try:
        float(cell.replace(",", ".") if comma else cell or "nan")
    except ValueError:
        return False
    return True


def _is_unit_row(row: Sequence[str]) -> bool:
    """Tell whether a row under the header states units."""
    bare = [cell.strip("[]()") for cell in row if cell.strip("[]()")]
    return bool(bare) and all(any(canonical(cell, quantity) for quantity in UNITS) or cell == "-" for cell in bare)


def _read_npz(path: Path) -> Table:
    """Read a NumPy archive: an array (T, a, b) is a*b columns, named `array[i,j]`."""
    try:
        with path.open("rb") as file, zipfile.ZipFile(file) as packed:
            size = sum(entry.file_size for entry in packed.infolist())
            if size > MOST_PACKED * path.stat().st_size + (1 << 20):
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
    columns: dict[str, Any] = {}
    for name, each in numbers.items():
        if each.ndim == 1:
            columns[name] = each.astype(np.float64)
        else:
            for place in np.ndindex(each.shape[1:]):
                columns[f"{name}[{','.join(map(str, place))}]"] = each[(slice(None), *place)].astype(np.float64)
    return Table(path, columns, {}, {}, 0)


def _require_held(packed: zipfile.ZipFile, entry: zipfile.ZipInfo) -> None:
    """Refuse an array whose header declares more than its entry holds, before anything is allocated."""
    with packed.open(entry) as file:
        version = np.lib.format.read_magic(file)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, dtype = read(file)
    if prod(shape) * dtype.itemsize > entry.file_size:
        raise ValueError(f"{entry.filename} declares {shape} of {dtype} in {entry.file_size} bytes")
