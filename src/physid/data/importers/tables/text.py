"""Text files as named columns: what splits cells, where names and units stand, what is no number."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice, zip_longest
from pathlib import Path
from typing import TextIO

import numpy as np
from numpy.typing import NDArray

from physid.data.importers.tables.table import Table
from physid.data.importers.units import UNITS, canonical, split_header

Array = NDArray[np.float64]
DELIMITERS = (",", ";", "\t", " ")
EMPTY = {"", "nan", "none", "null", "na", "n/a", "-", "#n/a"}  # cells that say: nothing was measured
TRUE = {"true": 1.0, "false": 0.0}
MARKS = (b"\xff\xfe", b"\xfe\xff")  # with which UTF-16 begins
THOUSANDS = {mark: re.compile(rf"[+-]?[1-9]\d{{0,2}}(\{mark}\d{{3}})+") for mark in ",."}
DECIMALS = {mark: re.compile(rf"[+-]?\d*\{mark}\d+") for mark in ",."}
"""What a mark may separate; no thousands begin with a zero."""
GZIP = b"\x1f\x8b"  # with which a packed file begins
PEEK, CHUNK = 50, 1 << 16  # rows
ALIKE = 0.8  # share of lines that a delimiter splits into as many cells as the first
LONGEST_LINE = 1 << 20  # characters: a file with longer lines is no table
csv.field_size_limit(max(csv.field_size_limit(), LONGEST_LINE))  # a line that a delimiter does not split is one cell


def read_text(path: Path, header: int | None) -> Table:
    """Read a text file.

    Args:
        path: The file.
        header: Line that names the columns, counted from 1; the first one that is no comment by default.

    Raises:
        ValueError: If it is no table, or a cell is no number.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            return _read_csv(path, file, header)
    except UnicodeDecodeError as error:
        if _begins(path) == GZIP:
            raise ValueError(f"{path}: expected a table, found one that gzip has packed; unpack it (gunzip)") from None
        code = "UTF-16" if _begins(path) in MARKS else "LATIN1"
        raise ValueError(
            f"{path}: expected text in UTF-8, found byte {error.object[error.start]:#04x}; it seems to be {code}: "
            f"save it as UTF-8, or convert it (iconv -f {code} -t UTF-8 IN > OUT)"
        ) from None
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
    start = _above_numbers(head, start) if header is None else start
    delimiter = _delimiter(head[start:])
    filled = [
        row for row in range(start, len(head)) if head[row].strip() and not (row > start and _is_comment(head[row]))
    ]
    rows = [[cell.strip() for cell in _cells(head[row], delimiter)] for row in filled]
    comma = delimiter != "," and any(re.fullmatch(r"[+-]?\d+,\d+", cell) for row in rows[1:] for cell in row)
    pointed = any(DECIMALS["."].fullmatch(cell) for row in rows[1:] for cell in row)
    named = header is not None or _is_numbering(rows[0]) or not all(_is_number(cell, comma) for cell in rows[0])
    names = rows[0] if named else [str(index) for index in range(len(rows[0]))]
    if not named and start and head[start - 1].startswith(("#", "%")):  # a header that is written as a comment
        said = [cell.strip() for cell in _cells(head[start - 1].lstrip("#% "), delimiter)]
        names = said if len(said) == len(names) else names
    names = _distinguished(names, [_cells(line, delimiter) for line in head[:start]])
    doubled = next((name for name, count in Counter(names).items() if count > 1), None)
    if doubled is not None:
        raise ValueError(f'{path}: expected each column once, found "{doubled}" twice; rename one in line {start + 1}')
    units = {name: unit for name in names if (unit := split_header(name)[1])}
    stated = named and len(rows) > 1 and _is_unit_row(rows[1])
    if stated:
        units |= {name: cell.strip("[]()") for name, cell in zip(names, rows[1], strict=False) if cell.strip("[]()")}
    above = int(named) + int(stated)
    first = filled[above - 1] + 1 if above else start
    file.seek(0)
    words: dict[str, tuple[int, str]] = {}
    skipped: list[int] = []
    # Beside decimals with the one mark, the other before three digits separates thousands: such cells are no numbers.
    marks = [mark for mark, other in ((".", comma), (",", comma and pointed)) if other]
    shown = zip(names, zip_longest(*rows[1:], fillvalue=""), strict=False)
    thousands = {name: _thousands(marks, cells) for name, cells in shown} if marks else {}
    reader = _Rows(path, delimiter, names, comma, words, skipped, thousands)
    values = reader.read(islice(_lines(path, file), first, None), first + 1)
    if not len(values):
        raise ValueError(f"{path}: expected rows of numbers under the header, found none")
    return Table(path, dict(zip(names, values.T, strict=True)), units, words, first + 1, skipped=tuple(skipped))


def _above_numbers(head: Sequence[str], start: int) -> int:
    """Return the line that names columns, where a preamble stands above it: the one above the first rows of numbers.

    Motion capture writes what was taken, when and of which body before the names (Motive, Vicon).
    """

    def numbers(line: str, delimiter: str) -> int:
        cells = _cells(line, delimiter)
        held = all(_is_number(cell) or cell.strip().lower() in EMPTY for cell in cells)
        return len(cells) if sum(bool(cell.strip()) for cell in cells) > 1 and held else 0

    found = start
    for delimiter in (",", ";", "\t"):
        counts = [numbers(line, delimiter) for line in head]
        first = next((row for row in range(start, len(head)) if counts[row]), None)
        if first is None or any(counts[row] != counts[first] for row in range(first, len(head)) if head[row].strip()):
            continue
        above = [row for row in range(start, first) if len(_cells(head[row], delimiter)) == counts[first]]
        while above and _is_unit_row([cell.strip() for cell in _cells(head[above[-1]], delimiter)]):
            above.pop()
        names = [cell for cell in (_cells(head[above[-1]], delimiter) if above else []) if cell.strip()]
        found = above[-1] if names and not any(map(_is_number, names)) else found
    return found


def _distinguished(names: Sequence[str], above: Sequence[Sequence[str]]) -> list[str]:
    """Put what stands above names before those that occur twice: "Position X"; a cell holds for empty ones after it.

    Args:
        names: Names of the columns.
        above: Cells of the lines above, from the top; only lines of as many cells count.
    """
    distinct = list(names)
    for line in reversed([[cell.strip() for cell in cells] for cells in above if len(cells) == len(names)]):
        if len({*distinct}) == len(distinct):
            break
        if not any(line):
            continue
        for column, cell in enumerate(line):
            line[column] = cell or (line[column - 1] if column else "")
        more = [f"{cell} {name}".strip() for cell, name in zip(line, distinct, strict=True)]
        distinct = more if len({*more}) > len({*distinct}) else distinct
    return distinct


@dataclass(frozen=True)
class _Rows:
    """How rows are read.

    First words that are no numbers are noted, as they matter only in columns that are used, and lines without a row.
    """

    path: Path
    delimiter: str
    names: Sequence[str]
    comma: bool
    words: dict[str, tuple[int, str]]
    skipped: list[int]
    thousands: Mapping[str, Sequence[re.Pattern[str]]]

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
            if not line.strip() or _is_comment(line):
                self.skipped.append(number)
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
            # Python lets an underscore stand between digits.
            if "_" in cell or any(one.fullmatch(cell) for one in self.thousands.get(name, ())):
                raise ValueError
            return TRUE[low] if low in TRUE else float(cell.replace(",", ".") if self.comma else cell)
        except ValueError:
            self.words.setdefault(name, (line, cell))
            return float("nan")


def _thousands(marks: Sequence[str], cells: Sequence[str]) -> list[re.Pattern[str]]:
    """Return what numbers with thousands look like in a column: with a mark that no cell of it has for decimals."""
    return [
        THOUSANDS[mark]
        for mark in marks
        if not any(DECIMALS[mark].fullmatch(one) and not THOUSANDS[mark].fullmatch(one) for one in cells)
    ]


def _begins(path: Path) -> bytes:
    """Return the first two bytes of a file."""
    with path.open("rb") as file:
        return file.read(2)


def _lines(path: Path, file: TextIO) -> Iterator[str]:
    """Yield lines; one that never ends is refused."""
    while line := file.readline(LONGEST_LINE):
        if len(line) >= LONGEST_LINE:
            raise ValueError(f"{path}: expected lines of text, found one of more than {LONGEST_LINE} characters")
        yield line


def _is_comment(line: str) -> bool:
    """Return whether a line under the header says nothing of the recording."""
    return line.startswith("#")


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
        float((cell.replace(",", ".") if comma else cell) or "nan")
    except ValueError:
        return False
    return True


def _is_numbering(row: Sequence[str]) -> bool:
    """Return whether a row numbers the columns, as pandas does where they have no names: 0,1,2, with an index ,0,1."""
    counted = row[1:] if row and not row[0] else row
    return len(row) > 2 and list(counted) == [str(number) for number in range(len(counted))]


def _is_unit_row(row: Sequence[str]) -> bool:
    """Tell whether a row under the header states units."""
    bare = [cell.strip("[]()") for cell in row if cell.strip("[]()")]
    named = [any(canonical(cell, quantity) for quantity in UNITS) for cell in bare]
    return any(named) and all(one or cell == "-" for one, cell in zip(named, bare, strict=True))
