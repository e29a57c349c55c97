"""Histories: the columns of a CSV file as curves, thinned to what a page can show."""

from __future__ import annotations

import csv
import io
import math
import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from physid.strict import quoted
from physid.yaml_files import read_text

MOST_POINTS = 600
MOST_NAMED = 3  # figures that a note names
AXES = ("epoch", "step", "evaluations")
SCHEDULE = re.compile(r"(^|[/_-])(lr|learning_rate|rate|blur|kernel|sigma|horizon|alpha|phase|temperature)([/_-]|$)")


@dataclass(frozen=True)
class Curve:
    """A figure over epochs or steps.

    Attributes:
        name: Name of the figure.
        axis: epoch or step.
        x: Where it was measured.
        y: What was measured.
    """

    name: str
    axis: str
    x: tuple[float, ...]
    y: tuple[float, ...]

    @property
    def group(self) -> str:
        """What kind of figure it is: parameter, schedule, loss, error or other."""
        if self.name.startswith("params/"):
            return "parameter"
        if SCHEDULE.search(self.name):
            return "schedule"
        if "loss" in self.name or self.name.startswith("train/"):
            return "loss"
        return "error" if self.name.startswith(("val/", "test/")) else "other"

    def to_mapping(self) -> dict[str, Any]:
        """Return the curve in plain types."""
        return {"name": self.name, "group": self.group, "axis": self.axis, "x": self.x, "y": self.y}


def numbers_of(content: Mapping[str, Any]) -> tuple[dict[str, float], str]:
    """Return the finite numbers among figures, and a note that says which others are left out, or nothing."""
    found, other = dict[str, float](), list[str]()
    for name, value in content.items():
        whole = isinstance(value, int) and not isinstance(value, bool) and abs(value) <= sys.float_info.max
        if whole or (isinstance(value, float) and math.isfinite(value)):
            found[name] = float(value)
        else:
            other.append(quoted(name))
    more = f" and {len(other) - MOST_NAMED} more" if len(other) > MOST_NAMED else ""
    named = ", ".join(other[:MOST_NAMED]) + more
    return found, f"expected finite numbers, found other values for {named}; they are left out" if other else ""


def read_curves(path: Path, within: Path | None = None) -> list[Curve]:
    """Read every column of a history whose rows may leave cells empty.

    A column is drawn over the epochs if it has at most one value in each, else over the steps. A last line that a
    running fit has written half is left out.

    Args:
        path: A CSV file with a column epoch and perhaps step.
        within: The folder in which it must lie, whatever links lead to it; None for anywhere.

    Returns:
        The curves, in the order of the columns.

    Raises:
        OSError: If it cannot be read, is no regular file, or lies elsewhere.
        ValueError: If it is no history.
    """
    try:
        lines = io.StringIO(read_text(path, most=None, within=within), newline="")
        rows = [row for row in csv.DictReader(lines) if None not in row.values() and None not in row]
    except csv.Error as error:
        raise ValueError(f"{path}: expected a history in CSV, found a damaged file ({error})") from None
    names = [name for name in (rows[0] if rows else {}) if name not in AXES]
    return [curve for name in names if (curve := _curve(name, rows)).x]


def _curve(name: str, rows: list[dict[str, str]]) -> Curve:
    """Return one column as a curve; cells that are empty or no finite number are left out."""
    mine = [row for row in rows if _number(row[name]) is not None]
    epochs = [row.get("epoch") or "" for row in mine]
    axis = "epoch" if all(epochs) and len(set(epochs)) == len(epochs) else "step"
    points = [(x, float(row[name])) for row in mine if (x := _number(row.get(axis) or "")) is not None]
    kept = thin(points)
    return Curve(name, axis, tuple(x for x, _ in kept), tuple(y for _, y in kept))


def thin(points: list[tuple[float, float]], most: int = MOST_POINTS) -> list[tuple[float, float]]:
    """Return at most `most` points of a curve that look the same: first, last, and the extremes of equal parts.

    Args:
        points: The whole curve.
        most: How many may be kept, at least 4.

    Returns:
        The points kept, in order.
    """
    if len(points) <= most:
        return points
    parts = (most - 2) // 2
    inner = range(1, len(points) - 1)
    kept = {0, len(points) - 1}
    for part in range(parts):
        part_of_it = inner[part * len(inner) // parts : (part + 1) * len(inner) // parts]
        if part_of_it:
            kept |= {min(part_of_it, key=lambda i: points[i][1]), max(part_of_it, key=lambda i: points[i][1])}
    return [points[index] for index in sorted(kept)]


def _number(text: str) -> float | None:
    """Return the finite number that a cell holds, if any."""
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None
