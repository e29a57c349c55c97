"""Which column holds stamps, and in which unit."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from physid.data.importers.guessing.lines import Lines, bare, quoted
from physid.data.importers.tables.table import Table
from physid.data.importers.units import split_header

Array = NDArray[np.float64]
TIME = (
    "t",
    "time",
    "stamp",
    "timestamp",
    "times",
    "timestamps",
    "seconds",
    "sec",
    "elapsed",
    "clock",
    "header.stamp",
    "received",
)
RATES = (10.0, 2000.0)  # [1/s] that loggers have


def say_time(table: Table, place: Sequence[str], said: Lines) -> str:
    """Find the column of stamps and its unit; return it, or nothing."""
    rising = (name for name, each in table.columns.items() if rises(each) and not _counts(each) and name not in place)
    named = clock_of(table, place) or clock_of(table, [])
    found = named or next(rising, "")
    if not found:
        said.say("rate: FILL_IN", "no column that rises as time does; frames per second of the tracker")
        return ""
    said.say(f"time: {quoted(found)}", "" if named else "it is the first column that rises")
    unit = table.unit_of(found)
    if unit is None:
        fitting = units_of_stamps(table.columns[found])
        said.units["time"] = fitting[0] if fitting else "FILL_IN"
        if fitting != ["s"]:
            step = _step_of(table.columns[found])
            said.doubt(f"units.time: {said.units['time']}, since stamps are {step:.4g} apart")
    return found


def clock_of(table: Table, columns: Sequence[str]) -> str:
    """Return the column of stamps that goes with columns, by its name; of several the one with most of it in common."""
    length = len(table.columns[bare(columns[0])]) if columns else None
    topic = table.topics.get(bare(columns[0])) if columns else None
    named = [
        name
        for name, each in table.columns.items()
        if re.split(r"[_\s\[(]", split_header(name)[0].lower().rpartition("/")[2])[0] in TIME
        and length in (None, len(each))
        and topic in (None, table.topics.get(name))
    ]
    rising = [name for name in named if rises(table.columns[name])]
    start = bare(columns[0]) if columns else ""
    # A stamp goes before when a message was received, which is the last of TIME.
    return max(rising or named, key=lambda one: _in_common(one, start), default="")


def _in_common(one: str, other: str) -> int:
    """Count the letters with which both begin."""
    return next((at for at, (a, b) in enumerate(zip(one, other, strict=False)) if a != b), min(len(one), len(other)))


def rises(values: Array) -> bool:
    """Return whether values grow from row to row, but for empty ones."""
    known = values[np.isfinite(values)]
    return len(known) > 1 and bool((np.diff(known) > 0).all())


def _counts(values: Array) -> bool:
    """Return whether values count rows, one after another: the number of a frame is no time."""
    return len(values) > 1 and bool((np.diff(values) == 1).all())


def _step_of(stamps: Array) -> float:
    """Return the typical distance of stamps."""
    known = stamps[np.isfinite(stamps)]
    return float(np.median(np.diff(known))) if len(known) > 1 else 0.0


def units_of_stamps(stamps: Array) -> list[str]:
    """List the units in which stamps are as far apart as loggers write rows."""
    step = _step_of(stamps)
    return [
        one
        for one, factor in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9))
        if step > 0 and RATES[0] <= 1 / (step * factor) <= RATES[1]
    ]
