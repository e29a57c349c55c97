"""Which columns belong together, by their names: positions, quaternions, forces, and the stamps that go with them."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence

import numpy as np
import yaml
from numpy.typing import NDArray

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
FORCE, TORQUE = (
    ("f", "force", "ft_f", "wrench.force", "forces"),
    ("torque", "tau", "moment", "wrench.torque", "torques", "m"),
)
PLACE = ("", "p", "pos", "position", "t", "translation", "place", "xyz", "location", "trans")
TURN = ("q", "quat", "quaternion", "rot", "orientation", "o", "r", "rotation", "pose.orientation")
ANGLES = (("roll", "pitch", "yaw"), ("rx", "ry", "rz"), ("phi", "theta", "psi"))
AXIS = re.compile(r"^(?:(?P<first>[xyzw])[_.\s]*(?P<stem>.*?)|(?P<stem2>.*?)[_.\s:/]*(?P<last>[xyzw]))$", re.IGNORECASE)
POSE = 7  # numbers of a position and a quaternion in one array
RATES = (10.0, 2000.0)  # [1/s] that loggers have
NUMBERED = ("episode_index", "episode", "trajectory", "trial", "run", "take")
OF_MESSAGES = ("pose", "transform", "position", "odometry", "observation", "state")
MOST_NAMED = 12  # columns that a comment lists
UNIT_LENGTH = 0.01  # by which four columns may differ from a unit quaternion
Pair = tuple[dict[str, str], dict[str, str]]


def groups_of(table: Table) -> dict[str, dict[str, str]]:
    """Group columns by what is beside the x, y, z, w in their names: stem -> letter -> column."""
    groups: dict[str, dict[str, str]] = {}
    for column in table.columns:
        if array := re.match(r"^(.+)\[(\d)\]$", column):
            inside, index = [one for one in table.columns if one.startswith(f"{array[1]}[")], int(array[2])
            letter = "xyzw"[index] if len(inside) in (3, 4) and index < 4 else None
            stem = array[1]
            if len(inside) == POSE and unit_columns(table, inside[3:]):
                stem, letter = (stem, "xyz"[index]) if index < 3 else (f"{stem}/q", "xyzw"[index - 3])
        else:
            found = AXIS.match(split_header(column)[0])
            letter = (found["first"] or found["last"]).lower() if found else None
            stem = (found["stem"] if found["first"] else found["stem2"]) or "" if found else ""
        if letter:
            groups.setdefault(stem.lower().strip("_. :/"), {}).setdefault(letter, column)
    return groups


def first_of(groups: dict[str, dict[str, str]], stems: tuple[str, ...], letters: str) -> list[str]:
    """Return the columns of the first group with such a name that has all letters."""
    for exact in (True, False):
        for stem, found in groups.items():
            near = stem in stems if exact else any(len(one) > 1 and one in stem for one in stems)
            if near and set(letters) <= set(found):
                return columns_of(found, letters)
    return []


def torque_beside(groups: dict[str, dict[str, str]], force: list[str]) -> list[str]:
    """Return the columns that are called as those of forces, but with t for f: tx beside fx, ft_tx beside ft_fx."""
    for stem, found in groups.items():
        twin = groups.get(f"{stem[:-1]}f") if stem.endswith("t") else None
        if twin and set("xyz") <= set(found) & set(twin) and columns_of(twin, "xyz") == force:
            return columns_of(found, "xyz")
    return []


def not_read(table: Table, lines: Sequence[str]) -> list[str]:
    """Say in a comment which columns of a log the lines of a mapping leave out; nothing where they leave out none."""
    said, open_ends = set[str](), [yaml.safe_load(printable("\n".join(lines)))]
    while open_ends:
        value = open_ends.pop()
        if isinstance(value, Mapping):
            open_ends += value.values()
        elif isinstance(value, list):
            open_ends += value
        else:
            said.add(str(value))
    left = [name for name in table.columns if not {name, name.partition("[")[0], name.rpartition("/")[0]} & said]
    if not left:
        return []
    more = f" and {len(left) - MOST_NAMED} more" if len(left) > MOST_NAMED else ""
    return [f"# not read, of {table.path.name}: {', '.join(map(quoted, left[:MOST_NAMED]))}{more}"]


def pairs_of(groups: dict[str, dict[str, str]]) -> dict[str, Pair]:
    """Return what has both a position and a quaternion: what their names begin with -> the columns of the two.

    `cup_x` and `cup_qw` begin with `cup`, `/cup/pose/pose/position/x` and `/cup/pose/pose/orientation/w` with
    `/cup/pose/pose`.
    """
    places = {_without(stem, PLACE): one for stem, one in groups.items() if set(one) == set("xyz")}
    turns = {_without(stem, TURN): one for stem, one in groups.items() if set(one) == set("xyzw")}
    return {prefix: (place, turns[prefix]) for prefix, place in places.items() if prefix in turns}


def _without(stem: str, words: Sequence[str]) -> str:
    """Return a stem without the word that says what it is."""
    for word in sorted(words, key=len, reverse=True):
        if word and stem.endswith(word) and (stem == word or stem[-len(word) - 1] in "/._ :"):
            return stem[: -len(word)].rstrip("/._ :")
    return stem


def named(prefix: str) -> str:
    """Return what a body may be called: the last word of a prefix that is no word of messages."""
    words = [one for one in re.split(r"[^a-z0-9]+", prefix) if one and one not in OF_MESSAGES]
    return words[-1] if words else "block"


def columns_of(group: Mapping[str, str], letters: str) -> list[str]:
    """Return the columns of a group by their letters."""
    return [quoted(group[letter]) for letter in letters]


def listed(table: Table, columns: list[str]) -> str:
    """Write columns as a list, or by the one name that stands for them all, and for nothing else."""
    names = [bare(one) for one in columns]
    stem = names[0].rpartition("/")[0]
    alone = bool(stem) and table.components(stem) == names
    return quoted(stem) if alone else f"[{', '.join(columns)}]"


def frame_of(table: Table, columns: list[str], point: str = "") -> str:
    """Say which frame the log says that columns are in; nothing where it does not."""
    frame = next((said for start, said in table.frames.items() if bare(columns[0]).startswith(start)), "")
    return (
        f"in the frame {frame}: are its axes the world's" + (f", its origin {point}?" if point else "?")
        if frame
        else ""
    )


def clock_of(table: Table, columns: list[str]) -> str:
    """Return the column of stamps that goes with columns, by its name; of several the one with most of it in common."""
    length = len(table.columns[bare(columns[0])]) if columns else None
    named = [
        name
        for name, each in table.columns.items()
        if re.split(r"[_\s\[(]", split_header(name)[0].lower().rpartition("/")[2])[0] in TIME
        and length in (None, len(each))
    ]
    rising = [name for name in named if rises(table.columns[name])]
    start = bare(columns[0]) if columns else ""
    # A stamp goes before when a message was received, which is the last of TIME.
    return max(rising or named, key=lambda one: _in_common(one, start), default="")


def _in_common(one: str, other: str) -> int:
    """Count the letters with which both begin."""
    return next((at for at, (a, b) in enumerate(zip(one, other, strict=False)) if a != b), min(len(one), len(other)))


def rises(values: Array) -> bool:
    """Tell whether values grow from row to row."""
    return len(values) > 1 and bool((np.diff(values) > 0).all())


def counts(values: Array) -> bool:
    """Return whether values count rows, one after another: the number of a frame is no time."""
    return len(values) > 1 and bool((np.diff(values) == 1).all())


def beside_turn(table: Table) -> list[str]:
    """Return the three columns before four that are a unit quaternion, in a log without names."""
    names = list(table.columns)
    if names != [str(index) for index in range(len(names))]:
        return []
    four = unit_columns(table, names)
    return [quoted(name) for name in names[names.index(four[0]) - 3 : names.index(four[0])]] if four else []


def unit_columns(table: Table, names: list[str]) -> list[str]:
    """Return four columns in a row whose squares add up to one."""
    for start in range(len(names) - 3):
        four = names[start : start + 4]
        if len({len(table.columns[name]) for name in four}) == 1:
            length = np.sqrt(sum(np.square(table.columns[name]) for name in four))
            if np.nanmax(np.abs(length - 1)) < UNIT_LENGTH:
                return four
    return []


def quoted(name: str) -> str:
    """Quote a name for YAML where it needs it."""
    return (
        name
        if re.fullmatch(r"[A-Za-z_/][\w. /]*", name) and name.lower() not in ("yes", "no", "on", "off")
        else json.dumps(name, ensure_ascii=not name.isprintable())
    )


def printable(text: str) -> str:
    """Return a text whose comments YAML takes, control characters escaped."""
    return "".join(
        each if each.isprintable() or each == "\n" else each.encode("unicode_escape").decode() for each in text
    )


def bare(name: str) -> str:
    """Return a name without its quotes."""
    return str(json.loads(name)) if name.startswith('"') else name


def step_of(stamps: Array) -> float:
    """Return the typical distance of stamps."""
    return float(np.median(np.diff(stamps))) if len(stamps) > 1 else 0.0


def units_of_stamps(stamps: Array) -> list[str]:
    """List the units in which stamps are as far apart as loggers write rows."""
    step = step_of(stamps)
    return [
        one
        for one, factor in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9))
        if step > 0 and RATES[0] <= 1 / (step * factor) <= RATES[1]
    ]
