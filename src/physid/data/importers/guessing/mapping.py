"""A mapping that names and values of a log suggest, with what is not sure in it."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from physid.data.importers.finding import logs_beside
from physid.data.importers.guessing.grouping import (
    ANGLES,
    FORCE,
    NUMBERED,
    PLACE,
    TORQUE,
    TURN,
    Pair,
    bare,
    beside_turn,
    clock_of,
    columns_of,
    counts,
    first_of,
    frame_of,
    groups_of,
    listed,
    named,
    not_read,
    pairs_of,
    printable,
    quoted,
    rises,
    step_of,
    torque_beside,
    unit_columns,
    units_of_stamps,
)
from physid.data.importers.tables.files import read_table
from physid.data.importers.tables.table import Table
from physid.data.importers.units import split_header

Array = NDArray[np.float64]
LARGE = 5.0  # [m] spread of positions beyond which they are rather millimetres
OF_BODY = (
    (
        "size: [FILL_IN, FILL_IN, FILL_IN]",
        "full edges [m] along the body's own axes in this log; no log holds them",
    ),
    ("mass: FILL_IN", "[kg]; a first guess where it is in unknown"),
)
SURE = 0.95  # of a component that stays w of a body that hardly turns


@dataclass
class _Guess:
    """Lines of the mapping, each perhaps with a doubt."""

    lines: list[str] = field(default_factory=list)
    doubts: list[str] = field(default_factory=list)

    def say(self, line: str, doubt: str = "") -> None:
        """Write a line; a doubt goes behind it, and is listed at the end."""
        self.lines.append(f"{line:<52}  # not sure: {doubt}" if doubt else line)
        if doubt:
            self.doubt(f"{line.strip('# ').partition(':')[0]}: {doubt}")

    def doubt(self, doubt: str) -> None:
        """List a doubt at the end, once."""
        if doubt not in self.doubts:
            self.doubts.append(doubt)


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
    said = _Guess([f"# Proposed by physid import --guess for {path.name}: look at every line, and fill in FILL_IN."])
    units: dict[str, str] = {}
    pairs = pairs_of(groups)
    place = columns_of(next(iter(pairs.values()))[0], "xyz") if pairs else []
    place = place or first_of(groups, PLACE, "xyz") or beside_turn(table)
    clock = _guess_time(table, place, units, said)
    forces = _forces(table, groups, place)
    if len(pairs) > 1:
        _say_bodies(table, pairs, clock, units, forces, said)
    else:
        _guess_place(table, place, units, said)
        _guess_turn(table, groups, place, units, said)
        for line, doubt in forces.items():
            said.say(line, doubt)
    if (found := first_of(groups, FORCE, "xyz")) or not _guess_forces_beside(path, units, said):
        _guess_force_clock(table, found, clock, said)
    if units:
        said.say(f"units: {{{', '.join(f'{name}: {unit}' for name, unit in units.items())}}}")
    _guess_axes(table, place, said)
    if len(pairs) < 2:
        for line, doubt in OF_BODY:
            said.say(line, doubt)
    body = named(next(iter(pairs))) if len(pairs) > 1 else "block"
    said.say(f"unknown: [{body}.friction]", "what shall be identified")
    said.lines += not_read(table, said.lines)
    doubts = "".join(f"#   {doubt}\n" for doubt in said.doubts)
    return printable("\n".join(said.lines) + f"\n# {len(said.doubts)} lines are not sure:\n{doubts}")


def _say_bodies(
    table: Table,
    pairs: Mapping[str, Pair],
    clock: str,
    units: dict[str, str],
    forces: Mapping[str, str],
    said: _Guess,
) -> None:
    """Write what is known of several bodies."""
    said.say("bodies:", f"{len(pairs)} things have poses: leave out what is no body")
    for index, (prefix, (place, turn)) in enumerate(pairs.items()):
        columns, four = columns_of(place, "xyz"), columns_of(turn, "xyzw")
        said.say(f"  - name: {named(prefix)}")
        said.say(f"    position: {listed(table, columns)}", frame_of(table, columns))
        _guess_length(table, columns, units, said)
        said.say(f"    quaternion: {listed(table, four)}")
        order, why = _order_of(table, four)
        if order:
            said.say(f"    order: {order}", why)
        own = clock_of(table, columns)
        if index and own and own != clock and len(table.columns[own]) == len(table.columns[bare(columns[0])]):
            said.say(f"    clock: {quoted(own)}")
        for line, doubt in (*OF_BODY, *({} if index else forces).items()):
            said.say(f"    {line}", doubt if not index else "")


def _guess_place(table: Table, place: list[str], units: dict[str, str], said: _Guess) -> None:
    """Write the position, or that there is none."""
    if place:
        said.say(f"position: {listed(table, place)}", frame_of(table, place))
        _guess_length(table, place, units, said)
        return
    said.say(
        "position: [FILL_IN, FILL_IN, FILL_IN]",
        f"no three columns that end in x, y, z; there are {table.listed()}",
    )


def _forces(table: Table, groups: dict[str, dict[str, str]], place: list[str]) -> dict[str, str]:
    """Return lines of forces and torques, each with its doubt."""
    lines, force = {}, first_of(groups, FORCE, "xyz")
    for name, columns in (
        ("force", force),
        ("torque", first_of(groups, TORQUE, "xyz") or torque_beside(groups, force)),
    ):
        if columns and columns != place:
            frame = frame_of(table, columns, "the centre of the body")
            side = "commanded, or measured with the other sign? physid check tells"
            lines[f"{name}: {listed(table, columns)}"] = f"{frame} {side}".strip()
    return lines


def _guess_forces_beside(path: Path, units: dict[str, str], said: _Guess) -> bool:
    """Write forces that a log named like this one holds; return whether there is one."""
    for other, pattern in logs_beside(path):
        table = read_table(other)
        groups = groups_of(table)
        lines = _forces(table, groups, [])
        if not lines or pairs_of(groups):
            continue
        for line, doubt in lines.items():
            said.say(line, doubt)
        clock = clock_of(table, []) or next((name for name, each in table.columns.items() if rises(each)), "")
        said.say(f"forces: {{file: {json.dumps(pattern)}{f', time: {quoted(clock)}' if clock else ''}}}")
        if clock and not table.units.get(clock):
            unit = next(iter(units_of_stamps(table.columns[clock])), "FILL_IN")
            if unit != units.get("time"):
                units["forces_time"] = unit
                said.doubt(f"units.forces_time: {unit}, since the stamps of {other.name} rise like that")
        said.lines += not_read(table, said.lines)
        return True
    return False


def _guess_force_clock(table: Table, found: list[str], clock: str, said: _Guess) -> None:
    """Write the clock of the forces where it is another one, or that there are no forces."""
    if not found:
        said.say("# force: [fx, fy, fz]", "no columns of forces here; in another file: forces: {file: ..., time: ...}")
        return
    own = clock_of(table, found)
    if own and own != clock and not table.line:
        said.say(f"forces: {{time: {quoted(own)}}}")


def _guess_time(table: Table, place: list[str], units: dict[str, str], said: _Guess) -> str:
    """Find the column of stamps and its unit; return it, or nothing."""
    rising = [name for name, each in table.columns.items() if rises(each) and not counts(each) and name not in place]
    named = clock_of(table, place) or clock_of(table, [])
    found = named or next(iter(rising), "")
    if not found:
        said.say("rate: FILL_IN", "no column that rises as time does; frames per second of the tracker")
        return ""
    said.say(f"time: {quoted(found)}", "" if named else "it is the first column that rises")
    unit = table.units.get(found)
    if unit is None:
        fitting = units_of_stamps(table.columns[found])
        units["time"] = fitting[0] if fitting else "FILL_IN"
        if fitting != ["s"]:
            said.doubt(f"units.time: {units['time']}, since stamps are {step_of(table.columns[found]):.4g} apart")
    if found not in rising:
        numbers = next((one for one in table.columns if one.lower() in NUMBERED), "")
        if numbers:
            said.say(f"trajectory: {numbers}")
        else:
            said.say("# trajectory: FILL_IN", f"{found} runs back: is there a column that numbers trajectories?")
    return found


def _guess_length(table: Table, place: list[str], units: dict[str, str], said: _Guess) -> None:
    """Find the unit of positions: as headers say, or by their spread."""
    values = np.stack([table.values(bare(name)) for name in place], 1)
    spread = float(np.nanmax(np.nanmax(values, 0) - np.nanmin(values, 0)))
    if table.units.get(bare(place[0])):
        return
    units["position"] = "mm" if spread > LARGE else "m"
    said.doubt(f"units.position: {units['position']}, since positions spread over {spread:.4g}")


def _guess_turn(
    table: Table, groups: dict[str, dict[str, str]], place: list[str], units: dict[str, str], said: _Guess
) -> None:
    """Find the orientation: named columns, or four that are a unit quaternion."""
    found = first_of(groups, TURN, "xyzw")
    pair = next(iter(pairs_of(groups).values()), None)
    if pair is not None:
        found = columns_of(pair[1], "xyzw")
    if found:
        said.say(f"quaternion: {listed(table, found)}")
        order, why = _order_of(table, found)
        if order:
            said.say(f"order: {order}", why)
        return
    low = {split_header(name)[0].lower(): name for name in table.columns}
    for angles in ANGLES:
        if set(angles) <= set(low):
            said.say(f"euler: [{', '.join(quoted(low[one]) for one in angles)}]")
            said.say(
                "euler_order: xyz", "about the fixed axes x, y, z one after another; ZYX with yaw first is the same"
            )
            largest = max(float(np.nanmax(np.abs(table.columns[low[one]]))) for one in angles)
            if not table.units.get(low[angles[0]]):
                units["angle"] = "deg" if largest > 2 * np.pi else "rad"
                said.doubt(f"units.angle: {units['angle']}, since angles reach {largest:.4g}")
            return
    others = [name for name in table.columns if name not in [bare(one) for one in place]]
    four = unit_columns(table, others)
    if four:
        order, why = _order_by_value(table, four)
        said.say(f"quaternion: [{', '.join(map(quoted, four))}]", "by their length, which is 1")
        said.say(f"order: {order}", why)
        return
    said.say("orientation: none", "no quaternion, no angles: does the body not turn?")


def _order_of(table: Table, found: list[str]) -> tuple[str, str]:
    """Return the order of a quaternion and why, where the names do not tell it; else nothing."""
    names = [bare(name) for name in found]
    return _order_by_value(table, names) if any(re.search(r"\[\d\]$", name) for name in names) else ("", "")


def _order_by_value(table: Table, four: list[str]) -> tuple[str, str]:
    """Guess the order of a quaternion: w is near 1 where a body has hardly turned."""
    start = [abs(float(table.columns[name][0])) for name in four]
    order = "wxyz" if start[0] > start[3] else "xyzw"
    return order, f"the first row is {', '.join(f'{one:.3g}' for one in start)}" + (
        "" if max(start[0], start[3]) > SURE else ", which does not tell"
    )


def _guess_axes(table: Table, place: list[str], said: _Guess) -> None:
    """Guess which way is up: a body on a table moves least along it."""
    if not place:
        return
    values = np.stack([table.values(bare(name)) for name in place], 1)
    least = int(np.argmin(np.nanstd(values, 0)))
    name = ("x-up", "y-up", "z-up")[least]
    said.say(
        f"axes: {name}",
        f"bodies move least along {'xyz'[least]}; thrown ones do not. z-up, y-up, left-handed-y-up, ...",
    )
