"""Which column numbers the trajectories of a log that holds several."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from physid.data.importers.guessing.clocks import rises
from physid.data.importers.guessing.lines import Lines, quoted
from physid.data.importers.tables.table import Table
from physid.data.importers.units import split_header

Array = NDArray[np.float64]
NUMBERED = re.compile(
    r"(episode|trajectory|traj|trial|run|take|push|segment|sequence|experiment|test|rep|repetition|attempt|recording)"
    r"[\s_.#-]*(index|idx|id|number|num|nr|no)?",
    re.IGNORECASE,
)
"""What such a column is called."""
LONG = 10  # rows that a trajectory has at least, in the middle of all of them


def say_trajectory(table: Table, clock: str, said: Lines) -> None:
    """Write which column numbers trajectories, if one does; ask for one where stamps run back."""
    stamps = table.columns.get(clock)
    named = {
        name: values
        for name, values in table.columns.items()
        if NUMBERED.fullmatch(split_header(name)[0].rpartition("/")[2].strip()) and name != clock
        if stamps is None or (len(values) == len(stamps) and table.topics.get(name) == table.topics.get(clock))
    }
    if stamps is not None and not rises(stamps) and len(stamps) > 1:
        back = [name for name, values in named.items() if _rises_within(stamps, values)]
        if back:
            said.say(f"trajectory: {quoted(back[0])}", _doubt_of_empty(table.columns[back[0]]))
        else:
            said.say("# trajectory: FILL_IN", f"{clock} runs back: is there a column that numbers trajectories?")
        return
    fitting = {name: len(np.unique(values)) for name, values in named.items() if _numbers(values)}
    if fitting:
        found = max(fitting, key=lambda name: fitting[name])
        others = [quoted(name) for name in fitting if name != found]
        said.say(f"trajectory: {quoted(found)}", _doubt(table.columns[found], others))


def _rises_within(stamps: Array, numbers: Array) -> bool:
    """Return whether stamps grow among the rows of each of several numbers."""
    known = np.unique(numbers[~np.isnan(numbers)])
    return len(known) > 1 and all((np.diff(stamps[numbers == one]) > 0).all() for one in known)


def _numbers(values: Array) -> bool:
    """Return whether whole numbers each stand in one long run of rows; one may stand between the others."""
    given = values[~np.isnan(values)]
    if (given != np.round(given)).any():
        return False
    lengths, again = _runs(values)
    return len(lengths) - again > 1 and again <= 1 and float(np.median(list(lengths.values()))) >= LONG


def _runs(values: Array) -> tuple[dict[float, int], int]:
    """Return the rows of each number that is not empty, and how many of these numbers come back after others."""
    given = values[~np.isnan(values)]
    begins = np.r_[True, given[1:] != given[:-1]][: len(given)]
    numbers, rows = np.unique(given, return_counts=True)
    again = int((np.unique(given[begins], return_counts=True)[1] > 1).sum())
    return dict(zip(numbers.tolist(), rows.tolist(), strict=True)), again


def _doubt(values: Array, others: list[str]) -> str:
    """Say why a column may number something else, or not every row; nothing where it is plain."""
    lengths, again = _runs(values)
    doubts = [
        (
            set(lengths) == {0, 1},
            "it is 0 or 1: does it say whether something happens, rather than which trajectory?",
        ),
        (bool(again), "one number comes back after others: leave out its rows if they belong to no trajectory"),
        (bool(others), f"or is it {' or '.join(others)}?"),
    ]
    return "; ".join(why for why in (*(why for applies, why in doubts if applies), _doubt_of_empty(values)) if why)


def _doubt_of_empty(values: Array) -> str:
    """Say that some rows hold no number; nothing where all do."""
    empty = int(np.isnan(values).sum())
    return f"{empty} rows hold no number, and are left out" if empty else ""
