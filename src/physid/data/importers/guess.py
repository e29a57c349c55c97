"""A mapping that names and values of a log suggest, with what is not sure in it."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from physid.data.importers.tables import Table, read_table
from physid.data.importers.units import split_header

Array = NDArray[np.float64]
TIME = ("t", "time", "stamp", "timestamp", "times", "timestamps", "seconds", "sec", "elapsed", "clock", "header.stamp")
FORCE, TORQUE = (
    ("f", "force", "ft_f", "wrench.force", "forces"),
    ("torque", "tau", "moment", "wrench.torque", "torques", "m"),
)
PLACE = ("", "p", "pos", "position", "t", "translation", "place", "xyz", "location", "trans")
TURN = ("q", "quat", "quaternion", "rot", "orientation", "o", "r", "rotation", "pose.orientation")
ANGLES = (("roll", "pitch", "yaw"), ("rx", "ry", "rz"), ("phi", "theta", "psi"))
AXIS = re.compile(r"^(?:(?P<first>[xyzw])[_.\s]*(?P<stem>.*?)|(?P<stem2>.*?)[_.\s:/]*(?P<last>[xyzw]))$", re.IGNORECASE)
RATES = (10.0, 2000.0)  # [1/s] that loggers of poses have
LARGE = 5.0  # [m] spread of positions beyond which they are rather millimetres
UNIT_LENGTH = 0.01  # by which four columns may differ from a unit quaternion
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
            self.doubts.append(f"{line.strip('# ').partition(':')[0]}: {doubt}")


def guess_mapping(path: Path) -> str:
    """Propose a mapping of a log, as YAML; what is not sure says so behind a #.

    Args:
        path: A .csv or .npz file.

    Raises:
        FileNotFoundError: If there is no such file.
        ValueError: If it is no table.
    """
    table = read_table(path)
    for each in table.columns.values():
        each[~np.isfinite(each)] = np.nan
    groups = _groups(table)
    said = _Guess([f"# Proposed by physid import --guess for {path.name}: look at every line, and fill in FILL_IN."])
    units: dict[str, str] = {}
    _guess_time(table, units, said)
    place = _first(groups, PLACE, "xyz") or _beside_turn(table)
    if place:
        said.say(f"position: [{', '.join(place)}]")
        _guess_length(table, place, units, said)
    else:
        said.say(
            "position: [FILL_IN, FILL_IN, FILL_IN]",
            f"no three columns that end in x, y, z; there are {', '.join(table.columns)}",
        )
    _guess_turn(table, groups, place, units, said)
    for name, stems in (("force", FORCE), ("torque", TORQUE)):
        found = _first(groups, stems, "xyz")
        if found and found != place:
            said.say(f"{name}: [{', '.join(found)}]", "commanded, or measured with the other sign? physid check tells")
    if not _first(groups, FORCE, "xyz"):
        said.say("# force: [fx, fy, fz]", "no columns of forces here; in another file: forces: {file: ..., time: ...}")
    if units:
        said.say(f"units: {{{', '.join(f'{name}: {unit}' for name, unit in units.items())}}}")
    _guess_axes(table, place, said)
    said.say("size: [FILL_IN, FILL_IN, FILL_IN]", "the full edges of the body [m], no log holds them")
    said.say("mass: FILL_IN", "[kg]; a first guess where it is in unknown")
    said.say("unknown: [block.friction]", "what shall be identified")
    doubts = "".join(f"#   {doubt}\n" for doubt in said.doubts)
    return "\n".join(said.lines) + f"\n# {len(said.doubts)} lines are not sure:\n{doubts}"


def _groups(table: Table) -> dict[str, dict[str, str]]:
    """Group columns by what is beside the x, y, z, w in their names: stem -> letter -> column."""
    groups: dict[str, dict[str, str]] = {}
    for column in table.columns:
        if array := re.match(r"^(.+)\[(\d)\]$", column):
            count = sum(one.startswith(f"{array[1]}[") for one in table.columns)
            letter = "xyzw"[int(array[2])] if count in (3, 4) and int(array[2]) < 4 else None
            stem = array[1]
        else:
            found = AXIS.match(split_header(column)[0])
            letter = (found["first"] or found["last"]).lower() if found else None
            stem = (found["stem"] if found["first"] else found["stem2"]) or "" if found else ""
        if letter:
            groups.setdefault(stem.lower().strip("_. :/"), {}).setdefault(letter, column)
    return groups


def _first(groups: dict[str, dict[str, str]], stems: tuple[str, ...], letters: str) -> list[str]:
    """Return the columns of the first group with such a name that has all letters."""
    for exact in (True, False):
        for stem, found in groups.items():
            near = stem in stems if exact else any(len(one) > 1 and one in stem for one in stems)
            if near and set(letters) <= set(found):
                return [_quoted(found[letter]) for letter in letters]
    return []


def _beside_turn(table: Table) -> list[str]:
    """Return the three columns before four that are a unit quaternion, in a log without names."""
    names = list(table.columns)
    if names != [str(index) for index in range(len(names))]:
        return []
    four = _unit_columns(table, names)
    return [_quoted(name) for name in names[names.index(four[0]) - 3 : names.index(four[0])]] if four else []


def _unit_columns(table: Table, names: list[str]) -> list[str]:
    """Return four columns in a row whose squares add up to one."""
    for start in range(len(names) - 3):
        four = names[start : start + 4]
        if len({len(table.columns[name]) for name in four}) == 1:
            length = np.sqrt(sum(np.square(table.columns[name]) for name in four))
            if np.nanmax(np.abs(length - 1)) < UNIT_LENGTH:
                return four
    return []


def _guess_time(table: Table, units: dict[str, str], said: _Guess) -> None:
    """Find the column of stamps and its unit."""
    rising = [name for name, each in table.columns.items() if len(each) > 1 and (np.diff(each) > 0).all()]
    named = [name for name in table.columns if re.split(r"[_\s\[(]", split_header(name)[0].lower())[0] in TIME]
    found = next((name for name in named if name in rising), next(iter(named), next(iter(rising), None)))
    if found is None:
        said.say("rate: FILL_IN", "no column that rises as time does; frames per second of the tracker")
        return
    said.say(f"time: {_quoted(found)}", "" if found in named else "it is the first column that rises")
    unit = table.units.get(found)
    stamps = table.columns[found]
    step = float(np.median(np.diff(stamps))) if len(stamps) > 1 else 0.0
    fitting = [
        one
        for one, factor in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9))
        if step > 0 and RATES[0] <= 1 / (step * factor) <= RATES[1]
    ]
    if unit is None:
        units["time"] = fitting[0] if fitting else "FILL_IN"
        if fitting != ["s"]:
            said.doubts.append(f"units.time: {units['time']}, since stamps are {step:.4g} apart")
    if found not in rising:
        said.say("# trajectory: FILL_IN", f"{found} runs back: is there a column that numbers trajectories?")


def _guess_length(table: Table, place: list[str], units: dict[str, str], said: _Guess) -> None:
    """Find the unit of positions: as headers say, or by their spread."""
    values = np.stack([table.values(_bare(name)) for name in place], 1)
    spread = float(np.nanmax(np.nanmax(values, 0) - np.nanmin(values, 0)))
    if table.units.get(_bare(place[0])):
        return
    units["position"] = "mm" if spread > LARGE else "m"
    said.doubts.append(f"units.position: {units['position']}, since positions spread over {spread:.4g}")


def _guess_turn(
    table: Table, groups: dict[str, dict[str, str]], place: list[str], units: dict[str, str], said: _Guess
) -> None:
    """Find the orientation: named columns, or four that are a unit quaternion."""
    found = _first(groups, TURN, "xyzw")
    if found:
        names = [_bare(name) for name in found]
        if any(re.search(r"\[\d\]$", name) for name in names):
            order, why = _order_by_value(table, names)
            said.say(f"quaternion: [{', '.join(found)}]")
            said.say(f"order: {order}", why)
        else:
            said.say(f"quaternion: [{', '.join(found)}]")
        return
    low = {split_header(name)[0].lower(): name for name in table.columns}
    for angles in ANGLES:
        if set(angles) <= set(low):
            said.say(f"euler: [{', '.join(_quoted(low[one]) for one in angles)}]")
            said.say(
                "euler_order: xyz", "about the fixed axes x, y, z one after another; ZYX with yaw first is the same"
            )
            largest = max(float(np.nanmax(np.abs(table.columns[low[one]]))) for one in angles)
            if not table.units.get(low[angles[0]]):
                units["angle"] = "deg" if largest > 2 * np.pi else "rad"
                said.doubts.append(f"units.angle: {units['angle']}, since angles reach {largest:.4g}")
            return
    others = [name for name in table.columns if name not in [_bare(one) for one in place]]
    four = _unit_columns(table, others)
    if four:
        order, why = _order_by_value(table, four)
        said.say(f"quaternion: [{', '.join(map(_quoted, four))}]", "by their length, which is 1")
        said.say(f"order: {order}", why)
        return
    said.say("orientation: none", "no quaternion, no angles: does the body not turn?")


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
    values = np.stack([table.values(_bare(name)) for name in place], 1)
    least = int(np.argmin(np.nanstd(values, 0)))
    name = ("x-up", "y-up", "z-up")[least]
    said.say(
        f"axes: {name}",
        f"bodies move least along {'xyz'[least]}; thrown ones do not. z-up, y-up, left-handed-y-up, ...",
    )


def _quoted(name: str) -> str:
    """Quote a name for YAML where it needs it."""
    return (
        name
        if re.fullmatch(r"[A-Za-z_][\w. ]*", name) and name.lower() not in ("yes", "no", "on", "off")
        else f'"{name}"'
    )


def _bare(name: str) -> str:
    """Return a name without its quotes."""
    return name.strip('"')
