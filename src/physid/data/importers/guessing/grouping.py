"""Which columns belong together, by their names: positions, quaternions, forces."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np

from physid.data.importers.guessing.lines import quoted
from physid.data.importers.tables.table import Table
from physid.data.importers.units import canonical, split_header

Group = dict[str, str]  # letter -> column
Groups = dict[str, Group]  # what is beside the letters in the names -> the columns
Pair = tuple[Group, Group]
PLACE = ("", "p", "pos", "position", "t", "translation", "place", "xyz", "location", "trans")
TURN = ("q", "quat", "quaternion", "rot", "orientation", "o", "r", "rotation", "pose.orientation")
OF_EITHER = "t"  # a translation, or a torque
AXIS = re.compile(r"^(?:(?P<first>[xyzw])[_.\s]*(?P<stem>.*?)|(?P<stem2>.*?)[_.\s:/]*(?P<last>[xyzw]))$", re.IGNORECASE)
POSE = 7  # numbers of a position and a quaternion in one array
OF_MESSAGES = ("pose", "transform", "position", "odometry", "observation", "state", "wrench")
ZERO = "0"  # what a group has in place of a column that a log does not have
BETWEEN = "/._ :"  # words of a name
UNIT_LENGTH = 0.01  # by which four columns may differ from a unit quaternion


def groups_of(table: Table) -> Groups:
    """Group columns by what is beside the x, y, z, w in their names: stem -> letter -> column."""
    groups: Groups = {}
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


def first_of(groups: Groups, stems: tuple[str, ...], letters: str) -> list[str]:
    """Return the columns of the first group with such a name that has all letters."""
    for exact in (True, False):
        for stem, found in groups.items():
            near = stem in stems if exact else any(len(one) > 1 and one in stem for one in stems)
            if near and set(letters) <= set(found):
                return columns_of(found, letters)
    return []


def vectors_of(table: Table, groups: Groups, quantity: str) -> Groups:
    """Return groups of three columns that may be a quantity, by their units; those whose headers say so come first."""
    said = {stem: _quantity_of(table, one) for stem, one in groups.items() if set("xyz") <= set(one)}
    return {
        stem: groups[stem] for own in (True, False) for stem, one in said.items() if one == (quantity if own else "")
    }


def _quantity_of(table: Table, group: Group) -> str:
    """Return which quantity the unit of a group is one of; nothing where headers say no unit."""
    unit = table.unit_of(first_there(group))
    kinds = ("position", "force", "torque") if unit else ()
    return next((kind for kind in kinds if unit and canonical(unit, kind)), "")


def force_beside(groups: Groups, stem: str) -> Group | None:
    """Return forces that are called as a group, but with f for t: fx beside tx, ft_fx beside ft_tx."""
    twin = groups.get(f"{stem[:-1]}f") if stem.endswith(OF_EITHER) else None
    return twin if twin and set("xyz") <= set(twin) else None


def place_of(table: Table, groups: Groups) -> list[str]:
    """Return the columns of a position, where no quaternion has the same name; torques beside forces come last."""
    may = vectors_of(table, groups, "position")
    rank = {stem: _rank(table, groups, stem) for stem in may}
    named = {stem: may[stem] for stem in sorted((stem for stem in groups if stem in may), key=lambda stem: rank[stem])}
    torques = {stem for stem in named if _may_be_torque(table, groups, stem)}
    return (
        first_of({stem: one for stem, one in named.items() if stem not in torques}, PLACE, "xyz")
        or _beside_turn(table)
        or first_of(named, PLACE, "xyz")
    )


def _may_be_torque(table: Table, groups: Groups, stem: str) -> bool:
    """Return whether a group is called as torques beside forces, and no header says that it is a length."""
    return force_beside(groups, stem) is not None and not _quantity_of(table, groups[stem])


def pairs_of(table: Table, groups: Groups) -> dict[str, Pair]:
    """Return what has both a position and a quaternion: what their names begin with -> the columns of the two.

    `cup_x` and `cup_qw` begin with `cup`, `/cup/pose/pose/position/x` and `/cup/pose/pose/orientation/w` with
    `/cup/pose/pose`. Of several positions the first counts; `tx` beside `fx` is one only where there is no other.
    """
    turns: dict[str, Group] = {}
    for stem, one in groups.items():
        if set(one) == set("xyzw"):
            turns.setdefault(without(stem, TURN), one)
    places: dict[str, list[str]] = {}
    may = vectors_of(table, groups, "position")
    for stem, one in groups.items():
        if set(one) == set("xyz") and stem in may:
            places.setdefault(without(stem, PLACE), []).append(stem)
    return {
        prefix: (groups[min(stems, key=lambda stem: _rank(table, groups, stem))], turns[prefix])
        for prefix, stems in places.items()
        if prefix in turns
    }


def _rank(table: Table, groups: Groups, stem: str) -> int:
    """Return how far the name of a group is from one that nothing but a position has."""
    either = re.split(r"[/._ :]", stem)[-1] == OF_EITHER and not _quantity_of(table, groups[stem])
    return either + _may_be_torque(table, groups, stem)


def doubt_of_place(table: Table, groups: Groups, place: Sequence[str]) -> str:
    """Say that columns which are taken for a position may be torques; nothing where they cannot."""
    for stem, one in groups.items():
        if set("xyz") <= set(one) and columns_of(one, "xyz") == list(place) and _may_be_torque(table, groups, stem):
            beside = ", ".join(columns_of(force_beside(groups, stem) or {}, "xyz"))
            return f"no other columns are a position; or are they torques, beside {beside}?"
    return ""


def without(stem: str, words: Sequence[str]) -> str:
    """Return a stem without the word that says what it is."""
    for word in sorted(words, key=len, reverse=True):
        if word and stem.endswith(word) and (stem == word or stem[-len(word) - 1] in BETWEEN):
            return stem[: -len(word)].rstrip(BETWEEN)
    return stem


def owner_of(prefix: str) -> str:
    """Return what a prefix begins with before words of messages: `/cup` of `/cup/pose/pose` and of `/cup/wrench`."""
    while (shorter := without(prefix, OF_MESSAGES)) != prefix:
        prefix = shorter
    return prefix


def names_of(prefixes: Sequence[str]) -> list[str]:
    """Return what bodies may be called: the last word of each prefix that is no word of messages."""
    names: list[str] = []
    for prefix in prefixes:
        words = [one for one in re.split(r"[^a-z0-9]+", prefix) if one and one not in OF_MESSAGES]
        name = words[-1] if words else "block"
        free = (f"{name}_{number}" if number > 1 else name for number in range(1, len(prefixes) + 2))
        names.append(next(one for one in free if one not in names))
    return names


def columns_of(group: Mapping[str, str], letters: str) -> list[str]:
    """Return the columns of a group by their letters."""
    return [ZERO if group[letter] == ZERO else quoted(group[letter]) for letter in letters]


def first_there(group: Group) -> str:
    """Return the first column of a group that the log has."""
    return next(group[letter] for letter in "xyz" if group[letter] != ZERO)


def filled(groups: Groups, words: Sequence[str]) -> Groups:
    """Return groups in which those of some names that have only one or two of x, y, z are zero along the others."""
    return {
        stem: one if "w" in one or without(stem, words) == stem else {letter: one.get(letter, ZERO) for letter in "xyz"}
        for stem, one in groups.items()
    }


def _beside_turn(table: Table) -> list[str]:
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
            seen = length[np.isfinite(length)]
            if len(seen) and np.abs(seen - 1).max() < UNIT_LENGTH:
                return four
    return []
