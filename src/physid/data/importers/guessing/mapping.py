"""A mapping that names and values of a log suggest, with what is not sure in it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from physid.data.importers.guessing.clocks import clock_of, say_time
from physid.data.importers.guessing.forces import FoundForces, find_forces, say_source
from physid.data.importers.guessing.grouping import (
    Groups,
    Pair,
    columns_of,
    doubt_of_place,
    groups_of,
    names_of,
    pairs_of,
    place_of,
)
from physid.data.importers.guessing.lines import Lines, bare, frame_of, listed, quoted
from physid.data.importers.guessing.trajectories import say_trajectory
from physid.data.importers.guessing.turns import say_quaternion, say_turn
from physid.data.importers.tables.files import read_table
from physid.data.importers.tables.table import Table

LARGE = 5.0  # [m] spread of positions beyond which they are rather millimetres
OF_BODY = (
    (
        "size: [FILL_IN, FILL_IN, FILL_IN]",
        "full edges [m] along the body's own axes in this log; no log holds them",
    ),
    ("mass: FILL_IN", "[kg]; a first guess where it is in unknown"),
)


def guess_mapping(path: Path) -> str:
    """Propose a mapping of a log, as YAML; what is not sure says so behind a #.

    Args:
        path: A log, of any kind that `read_table` reads.

    Raises:
        FileNotFoundError: If there is no such file.
        ValueError: If it is no table.
    """
    table = read_table(path)
    for each in table.columns.values():
        each[~np.isfinite(each)] = np.nan
    groups = groups_of(table)
    said = Lines([f"# Proposed by physid import --guess for {path.name}: look at every line, and fill in FILL_IN."])
    pairs = pairs_of(table, groups)
    places = [columns_of(place, "xyz") for place, _ in pairs.values()]
    place = places[0] if places else place_of(table, groups)
    clock = say_time(table, place, said)
    clocks = [_own_clock(table, each, clock) for each in places[1:]]
    if not any(clocks):
        say_trajectory(table, clock, said)
    _say_length(table, [each for each in places or [place] if each], said)
    forces = find_forces(path, table, groups, list(pairs) or [""], places or [place])
    names = names_of(list(pairs)) if len(pairs) > 1 else ["block"]
    if len(pairs) > 1:
        _say_bodies(table, groups, list(zip(names, pairs.values(), strict=True)), ["", *clocks], forces, said)
    else:
        turn = columns_of(next(iter(pairs.values()))[1], "xyzw") if pairs else []
        _say_place(table, groups, place, said)
        say_turn(table, groups, turn, place, said)
        forces.say_of(0, said)
    say_source(forces, clock, said)
    if said.units:
        said.say(f"units: {{{', '.join(f'{name}: {unit}' for name, unit in said.units.items())}}}")
    _say_axes(table, place, said)
    if len(pairs) < 2:
        for line, doubt in OF_BODY:
            said.say(line, doubt)
    said.say(f"unknown: [{', '.join(f'{name}.friction' for name in names)}]", "what shall be identified")
    said.name_left_out(table)
    return said.text()


def _own_clock(table: Table, place: Sequence[str], clock: str) -> str:
    """Return the column of stamps that a further body has of its own; nothing where it shares the first one's."""
    own = clock_of(table, place)
    return own if own and own != clock and len(table.columns[own]) == len(table.columns[bare(place[0])]) else ""


def _say_bodies(
    table: Table,
    groups: Groups,
    bodies: Sequence[tuple[str, Pair]],
    clocks: Sequence[str],
    forces: FoundForces,
    said: Lines,
) -> None:
    """Write what is known of several bodies."""
    said.say("bodies:", f"{len(bodies)} things have poses: leave out what is no body")
    for index, (name, (place, turn)) in enumerate(bodies):
        said.say(f"  - name: {name}")
        _say_place(table, groups, columns_of(place, "xyz"), said, "    ")
        say_quaternion(table, columns_of(turn, "xyzw"), said, "    ")
        if clocks[index]:
            said.say(f"    clock: {quoted(clocks[index])}")
        for line, doubt in OF_BODY:
            said.say(f"    {line}", "" if index else doubt)
        forces.say_of(index, said, "    ")


def _say_place(table: Table, groups: Groups, place: list[str], said: Lines, before: str = "") -> None:
    """Write the position and its unit, or that there is none; `before` goes before each line."""
    if not place:
        said.say(
            "position: [FILL_IN, FILL_IN, FILL_IN]",
            f"no three columns that end in x, y, z; there are {table.listed()}",
        )
        return
    doubts = (doubt_of_place(table, groups, place), frame_of(table, place))
    said.say(f"{before}position: {listed(table, place)}", "; ".join(one for one in doubts if one))


def _say_length(table: Table, places: Sequence[Sequence[str]], said: Lines) -> None:
    """Find the unit of positions: as headers say, or by the largest spread of those of a body."""
    silent = [bare(name) for place in places for name in place if not table.unit_of(bare(place[0]))]
    seen = [values[np.isfinite(values)] for values in map(table.values, silent)]
    spread = max((float(np.ptp(values)) for values in seen if len(values)), default=None)
    if spread is None:
        return
    said.units["position"] = "mm" if spread > LARGE else "m"
    said.doubt(f"units.position: {said.units['position']}, since positions spread over {spread:.4g}")


def _say_axes(table: Table, place: list[str], said: Lines) -> None:
    """Guess which way is up: a body on a table moves least along it."""
    if not place:
        return
    seen = [values[np.isfinite(values)] for values in (table.values(bare(name)) for name in place)]
    least = int(np.argmin([values.std() if len(values) else np.inf for values in seen]))
    name = ("x-up", "y-up", "z-up")[least]
    said.say(
        f"axes: {name}",
        f"bodies move least along {'xyz'[least]}; thrown ones do not. z-up, y-up, left-handed-y-up, ...",
    )
