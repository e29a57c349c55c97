"""Which columns hold forces and torques, of which body, in a log of poses or in one beside it."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from physid.data.importers.finding import logs_beside
from physid.data.importers.guessing.clocks import clock_of, rises, units_of_stamps
from physid.data.importers.guessing.grouping import (
    OF_EITHER,
    ZERO,
    Groups,
    columns_of,
    filled,
    first_of,
    first_there,
    force_beside,
    groups_of,
    owner_of,
    pairs_of,
    vectors_of,
    without,
)
from physid.data.importers.guessing.lines import Lines, bare, frame_of, listed, quoted
from physid.data.importers.tables.files import read_table
from physid.data.importers.tables.table import Table

FORCE, TORQUE = (
    ("f", "force", "ft_f", "wrench.force", "forces"),
    ("torque", "tau", "moment", "wrench.torque", "torques", "m"),
)

MOST_BESIDE = 3  # logs that a line names


@dataclass(frozen=True)
class FoundForces:
    """Columns of forces and torques in one log.

    Attributes:
        table: The log.
        force, torque: Three columns for each body, or none.
        pattern: The name of a log beside that of the poses, with {stem} in it; nothing where it is that of the poses.
        unowned: Which of "force" and "torque" no name says of which of several bodies they are; the first gets them.
        searched: Names of the logs beside that were searched, where none has forces.
    """

    table: Table
    force: list[list[str]]
    torque: list[list[str]]
    pattern: str = ""
    unowned: tuple[str, ...] = ()
    searched: tuple[str, ...] = ()

    @property
    def columns(self) -> list[str]:
        """The first columns that there are; none where there are none."""
        first = next((each for each in (*self.force, *self.torque) if each), [])
        return [one for one in first if one != ZERO]

    def say_of(self, index: int, said: Lines, before: str = "") -> None:
        """Write the forces and torques of a body; `before` goes before each line."""
        for name, columns in (("force", self.force[index]), ("torque", self.torque[index])):
            if columns:
                absent = [letter for letter, one in zip("xyz", columns, strict=True) if one == ZERO]
                doubts = (
                    f"no column of {' and '.join(absent)}: zero?" if absent else "",
                    "on which body? no name says so." if name in self.unowned else "",
                    frame_of(self.table, [one for one in columns if one != ZERO], "the centre of the body"),
                    "commanded, or measured with the other sign? physid check says which",
                )
                said.say(f"{before}{name}: {listed(self.table, columns)}", " ".join(one for one in doubts if one))


def find_forces(
    path: Path, table: Table, groups: Groups, prefixes: Sequence[str], places: Sequence[Sequence[str]]
) -> FoundForces:
    """Find the forces on each body: in the log of its poses, else in one that is named like it.

    Args:
        path: The log of poses.
        table: What it holds.
        groups: Its columns, grouped.
        prefixes: What the names of the columns of each body begin with.
        places: The columns that are positions.
    """
    own = _forces_of(table, filled(groups, TORQUE), prefixes, places)
    if any(own.force):
        return own
    searched: list[tuple[Table, Groups, Sequence[Sequence[str]], str]] = [(table, groups, places, "")]
    for other, pattern in logs_beside(path):
        beside = read_table(other)
        there = groups_of(beside)
        if not pairs_of(beside, there):
            searched.append((beside, there, [], pattern))
    # Of forces in a plane a log has two columns, and one of the torque about its normal; whole ones come first.
    for words in (TORQUE, (*FORCE, *TORQUE, OF_EITHER)):
        for log, there, taken, pattern in searched:
            found = _forces_of(log, filled(there, words), prefixes, taken, pattern)
            if any(found.force) or (words != TORQUE and log is not table and found.columns):
                return found
    names = tuple(log.path.name for log, *_ in searched[1:])
    none = _forces_of(table, filled(groups, (*FORCE, *TORQUE, OF_EITHER)), prefixes, places)
    return replace(none, searched=names)


def _forces_of(
    table: Table, groups: Groups, prefixes: Sequence[str], places: Sequence[Sequence[str]], pattern: str = ""
) -> FoundForces:
    """Find the forces on each body in one log: by the names of bodies, else those of the first."""
    free = {
        stem: one
        for stem, one in groups.items()
        if set("xyz") <= set(one) and columns_of(one, "xyz") not in map(list, places)
    }
    forces, torques = vectors_of(table, free, "force"), vectors_of(table, free, "torque")
    owners = [owner_of(prefix) for prefix in prefixes]
    force, torque = _owned(forces, owners, FORCE), _owned(torques, owners, TORQUE)
    unowned = []
    if not any(force) and (one := first_of(forces, FORCE, "xyz") or _named_last(table, forces)):
        force[0] = one
        unowned.append("force")
    torque = [each or _beside(torques, free, force[index]) for index, each in enumerate(torque)]
    for index, either in enumerate(_owned(torques, owners, (OF_EITHER,))):
        stated = either and table.unit_of(bare(next(each for each in either if each != ZERO)))
        if either and not torque[index] and (force[index] or stated):
            torque[index] = either
    if not any(torque) and (one := first_of(torques, TORQUE, "xyz")):
        torque[0] = one
        unowned.append("torque")
    return FoundForces(table, force, torque, pattern, tuple(unowned) if len(prefixes) > 1 else ())


def _owned(groups: Groups, owners: Sequence[str], words: Sequence[str]) -> list[list[str]]:
    """Return the columns that each body has: its name, then one of the words; each group is of one body alone."""
    free, found = dict(groups), []
    for owner in owners:
        begins = {stem: without(stem, words) for stem in free}
        own = next((stem for stem, begin in begins.items() if begin != stem and owner_of(begin) == owner), None)
        found.append([] if own is None else columns_of(free.pop(own), "xyz"))
    return found


def _named_last(table: Table, forces: Groups) -> list[str]:
    """Return the first columns whose names end with a word for forces, or whose headers say a unit of them."""
    return next(
        (
            columns_of(one, "xyz")
            for stem, one in forces.items()
            if without(stem, FORCE) != stem or table.unit_of(first_there(one))
        ),
        [],
    )


def _beside(torques: Groups, groups: Groups, force: list[str]) -> list[str]:
    """Return the columns that are called as those of forces, but with t for f."""
    for stem, one in torques.items():
        if force and (twin := force_beside(groups, stem)) and columns_of(twin, "xyz") == force:
            return columns_of(one, "xyz")
    return []


def say_source(found: FoundForces, clock: str, said: Lines) -> None:
    """Write in which log forces are and on which clock, where it is not that of the poses, or that there are none.

    Args:
        found: The forces.
        clock: The column of stamps of the poses.
        said: The lines so far, with the columns of forces.
    """
    table = found.table
    if not found.pattern:
        if not any(found.force):
            nor = "".join(f", nor in {name}" for name in found.searched[:MOST_BESIDE])
            missing = f"no columns of forces here{nor}; in another file: forces: {{file: ..., time: ...}}"
            said.say("# force: [fx, fy, fz]", missing)
        own = clock_of(table, found.columns) if found.columns else ""
        if own and own != clock and not table.line:
            said.say(f"forces: {{time: {quoted(own)}}}")
        return
    own = clock_of(table, []) or next((name for name, each in table.columns.items() if rises(each)), "")
    said.say(f"forces: {{file: {json.dumps(found.pattern)}{f', time: {quoted(own)}' if own else ''}}}")
    if own and not table.unit_of(own):
        unit = next(iter(units_of_stamps(table.columns[own])), "FILL_IN")
        if unit != said.units.get("time"):
            said.units["forces_time"] = unit
            said.doubt(f"units.forces_time: {unit}, since the stamps of {table.path.name} rise like that")
    said.name_left_out(table)
