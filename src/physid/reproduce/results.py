"""What a cell measures: figures beside the paper's, kept as JSON, shown as a table."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from statistics import fmean, stdev
from typing import Any, ClassVar

from physid.data.files import write_text
from physid.typed_files import CLOSED, read_json_as

RESULTS = "results.json"
"""Where the results of a cell, of one of its seeds or of all cells are kept, in the folder of each."""

HEADER = ("cell", "metric", "value", "unit", "paper", "target")


@dataclass(frozen=True)
class Result:
    """One figure of a cell.

    Attributes:
        cell: Where it was measured, say sysid/push_mass.
        metric: What was measured.
        value: The figure; None if there is none, as for the deviation of a parameter that cannot be observed.
        unit: Its unit.
        paper: The paper's figure in the same unit, if it has one.
        target: The largest value that is good enough, if there is one.
        spread: Standard deviation over runs with other seeds, if there are several; the value is their mean then.
    """

    __pydantic_config__: ClassVar[Any] = CLOSED
    cell: str
    metric: str
    value: float | None
    unit: str
    paper: float | None = None
    target: float | None = None
    spread: float | None = None

    def __post_init__(self) -> None:
        if self.value is not None and not math.isfinite(self.value):
            object.__setattr__(self, "value", None)

    @property
    def misses(self) -> bool:
        """Whether the value is above its target."""
        return self.target is not None and (self.value is None or self.value > self.target)

    def row(self) -> tuple[str, ...]:
        """Return the cells of the table, a missed target marked by a cross."""
        texts = [
            "none" if self.value is None else f"{self.value:.4g}" + (f" ± {self.spread:.2g}" if self.spread else ""),
            self.unit,
            *("" if x is None else f"{x:g}" for x in (self.paper, self.target)),
        ]
        mark = " x" if self.misses else ""
        return (self.cell, self.metric, texts[0] + mark, *texts[1:])


def over_seeds(runs: Sequence[Sequence[Result]]) -> list[Result]:
    """Return mean and standard deviation of each figure over runs of one cell; of one run the figures as they are."""
    if len(runs) == 1:
        return list(runs[0])
    merged = []
    for same in zip(*runs, strict=True):
        values = [result.value for result in same if result.value is not None]
        whole = len(values) == len(same)
        merged.append(replace(same[0], value=fmean(values) if whole else None, spread=stdev(values) if whole else None))
    return merged


def write_results(path: Path, results: Sequence[Result]) -> None:
    """Write results as a JSON list of {cell, metric, value, unit, paper, target, spread}."""
    write_text(path, json.dumps([asdict(result) for result in results], indent=2) + "\n")


def read_results(path: Path) -> list[Result]:
    """Read what `write_results` wrote.

    Raises:
        OSError: If it cannot be read.
        ValueError: If it is damaged, or holds something else; names the file.
    """
    return read_json_as(list[Result], path)


def table(results: Sequence[Result]) -> str:
    """Lay results out in columns for a terminal."""
    rows = [HEADER, *(result.row() for result in results)]
    widths = [max(len(row[k]) for row in rows) for k in range(len(HEADER))]
    numeric = {2, 4, 5}
    lines, last = [], ""
    for index, row in enumerate(rows):
        shown = ("" if row[0] == last else row[0], *row[1:])
        last = row[0]
        cells = [
            text.rjust(width) if k in numeric else text.ljust(width)
            for k, (text, width) in enumerate(zip(shown, widths, strict=True))
        ]
        lines.append("  ".join(cells).rstrip())
        if index == 0:
            lines.append("  ".join("-" * width for width in widths))
    return "\n".join(lines)


def markdown(results: Sequence[Result]) -> str:
    """Lay results out as a Markdown table."""
    lines = ["| " + " | ".join(HEADER) + " |", "|---|---|---:|---|---:|---:|"]
    return "\n".join([*lines, *("| " + " | ".join(result.row()) + " |" for result in results)]) + "\n"
