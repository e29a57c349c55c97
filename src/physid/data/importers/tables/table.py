"""A log as named columns, whatever it came from."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from physid.data.importers.units import split_header
from physid.strict import nearest

Array = NDArray[np.float64]
MOST_NAMED = 40  # columns that a message lists


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
        frames: What the log says of the frame that columns are in, by how the names of these columns begin.
    """

    path: Path
    columns: dict[str, Array]
    units: dict[str, str]
    words: dict[str, tuple[int, str]]
    line: int
    frames: dict[str, str] = field(default_factory=dict)

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
        if "did you mean" not in close and last >= MOST_NAMED:
            close = f"; there are {self.listed()}"
        if list(self.columns) == [str(number) for number in range(last + 1)]:
            close = (
                f"; no line names them, so that they are numbered from 0 to {last}: use these numbers, "
                "or write a line of names above the rows"
            )
        raise ValueError(f'{self.path}: no column "{wanted}"{close}')

    def components(self, name: object) -> list[str]:
        """Return the columns that one name stands for: several for an array with more than one axis."""
        inside = [each for each in self.columns if each.startswith((f"{name}[", f"{name}/"))]
        return inside if inside and str(name) not in self.columns else [self.find(name)]

    def listed(self) -> str:
        """Name the columns for a message; of many, the first."""
        names = list(self.columns)
        more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
        return ", ".join(names[:MOST_NAMED]) + more
