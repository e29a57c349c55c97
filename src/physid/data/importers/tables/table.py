"""A log as named columns, whatever it came from."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from physid.data.importers.units import UNITS, canonical, split_header
from physid.strict import nearest

Array = NDArray[np.float64]
STAMP = "header/stamp"  # when a message was measured, below its topic
MOST_NAMED, LONGEST_NAME = 40, 100  # columns that a message lists, and letters of each
DATE = re.compile(r"\d{4}-\d\d-\d\d|\d\d?:\d\d:\d\d|\d\d?[./]\d\d?[./]\d{4}")  # how dates and times of day begin
SEPARATED = re.compile(r"[+-]?\d{1,3}([.,]\d{3})+")  # thousands, or a decimal mark before three digits


class MissingColumnError(ValueError):
    """A column that a mapping names and a log does not have.

    Attributes:
        column: Its name.
    """

    def __init__(self, message: str, column: str) -> None:
        super().__init__(message)
        self.column = column


@dataclass(frozen=True)
class Table:
    """A log.

    Attributes:
        path: The file.
        columns: Values by column, each of shape (T,); NaN where a cell is empty.
        units: The unit that the file itself states for a column.
        words: The first cell of a column that is no number, and its line; such a column cannot be used.
        line: Line of the file at which the first row stands; 0 for what has no lines, whose columns may be of several
            lengths, each with a clock of its own.
        topics: What a column is part of, where rows of another one are other moments: the topic of a bag, or a child
            frame of its transforms. Columns without one share their rows.
        frames: The frames that the messages of a topic are in, as far as they say.
        skipped: Lines after that of the first row which hold none, blank ones and comments.
        refused: Why what is below a topic cannot be used, by topic; it has no columns.
        notes: What whoever uses the log should know of it.
    """

    path: Path
    columns: dict[str, Array]
    units: dict[str, str]
    words: dict[str, tuple[int, str]]
    line: int
    topics: dict[str, str] = field(default_factory=dict)
    frames: dict[str, tuple[str, ...]] = field(default_factory=dict)
    skipped: tuple[int, ...] = ()
    refused: dict[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def values(self, name: object) -> Array:
        """Return the values of a column, shape (T,).

        Raises:
            ValueError: If there is no such column, or it holds something else than numbers.
        """
        found = self.find(name)
        if found in self.words:
            line, cell = self.words[found]
            mend = ""
            if DATE.match(cell):
                mend = "; convert dates to seconds before, say by datetime.fromisoformat(CELL).timestamp()"
            elif SEPARATED.fullmatch(cell):
                mend = "; is the mark one of decimals or of thousands? write the log without the latter"
            raise ValueError(f'{self.path}:{line}: expected a number in column "{found}", found "{cell[:40]}"{mend}')
        return self.columns[found]

    def find(self, name: object) -> str:
        """Return the column that a name means: its header, with or without unit; without headers its number.

        Raises:
            MissingColumnError: If there is none; the message names the nearest.
            ValueError: If it is below a topic that cannot be used.
        """
        wanted = str(name).strip()
        if wanted in self.columns:
            return wanted
        self._require_usable(wanted)
        bare = [each for each in self.columns if split_header(each)[0] == wanted]
        if len(bare) == 1:
            return bare[0]
        same = [each for each in self.columns if each.lower() == wanted.lower()]
        close = f'; did you mean "{_cut(same[0])}"?' if same else nearest(wanted, map(_cut, self.columns))
        last = len(self.columns) - 1
        if "did you mean" in close:
            close += f" There are {self.listed()}"
        elif last >= MOST_NAMED:
            close = f"; there are {self.listed()}"
        if "," in wanted:
            listed = ", ".join(part.strip() for part in wanted.split(","))
            close = f"; several columns are a list in brackets: [{listed}]"
        if list(self.columns) == [str(number) for number in range(last + 1)]:
            close = (
                f"; no line names them, so that they are numbered from 0 to {last}: use these numbers, "
                "or write a line of names above the rows"
            )
        raise MissingColumnError(f'{self.path}: no column "{wanted}"{close}', wanted)

    def topic_of(self, name: object) -> str:
        """Return what the columns that a name stands for are part of (see `topics`); nothing where all share rows.

        Raises:
            MissingColumnError: If there is no such column.
        """
        return self.topics.get(self.components(name)[0], "")

    def unit_of(self, column: str) -> str | None:
        """Return the unit that the log states for a column; None where a word in brackets is none of any quantity."""
        said = self.units.get(column)
        return said if said and any(canonical(said, quantity) for quantity in UNITS) else None

    def components(self, name: object) -> list[str]:
        """Return the columns that one name stands for: several for an array with more than one axis."""
        self._require_usable(str(name))
        inside = [each for each in self.columns if each.startswith((f"{name}[", f"{name}/"))]
        return inside if inside and str(name) not in self.columns else [self.find(name)]

    def _require_usable(self, name: str) -> None:
        """Refuse a name that is, or is below, a topic that cannot be used; of several topics the longest counts."""
        above = [topic for topic in (*self.refused, *self.topics.values()) if f"{name}/".startswith(f"{topic}/")]
        reason = self.refused.get(max(above, key=len, default=""))
        if reason:
            raise ValueError(f"{self.path}: {reason}")

    def listed(self) -> str:
        """Name the columns for a message; of many, the first."""
        names = [_cut(name) for name in self.columns]
        more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
        return ", ".join(names[:MOST_NAMED]) + more


def _cut(name: str) -> str:
    """Return a name as a message can list it: an open quote makes one of many lines."""
    return name if len(name) <= LONGEST_NAME else f"{name[:LONGEST_NAME]}..."


def named_once(path: Path, columns: Iterable[tuple[str, Array]]) -> dict[str, Array]:
    """Return columns by name.

    Raises:
        ValueError: If two have one name: either would be taken for the other.
    """
    found: dict[str, Array] = {}
    for name, values in columns:
        if name in found:
            raise ValueError(
                f'{path}: expected each column once, found two that are called "{name}"; rename one of them'
            )
        found[name] = values
    return found
