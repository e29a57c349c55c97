"""Columns of a log in SI: what the mapping says of units and what the log itself says must agree."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from physid.data.importers.mapping import Reference
from physid.data.importers.tables.table import Table
from physid.data.importers.units import UNITS, canonical, factor_of, is_suffixed
from physid.strict import nearest, quoted

Array = NDArray[np.float64]
TURN = 1.01 * 2 * np.pi  # [rad] with what rounding adds
NO_UNIT = re.compile(r"-|\d*")  # what brackets also hold: nothing, or the number of a component
MOST_NAMED = 12  # columns that a message lists
DEFAULTS = {"position": "m", "time": "s", "angle": "rad", "force": "N", "torque": "N m"}


def read_stamps(table: Table, reference: Reference, unit: str | None) -> Array:
    """Return stamps [s]."""
    return read_columns(table, (reference,), "time", {} if unit is None else {"time": unit}, 1)[:, 0]


def read_columns(
    table: Table, references: Sequence[Reference], quantity: str | None, units: Mapping[str, str], count: int
) -> Array:
    """Return columns (T, count) in SI."""
    given = units.get(quantity) if quantity else None
    names = expanded(table, references, count)
    if len(names) != count:
        listed = ", ".join(map(str, names[:MOST_NAMED])) + (" ..." if len(names) > MOST_NAMED else "")
        raise ValueError(
            f"{table.path}: expected {count} columns for {', '.join(map(str, references))}, found {len(names)}: "
            f"{listed}; list the {count} that are meant, each by its own name"
            + ("; of a box, not angles of joints" if quantity == "position" else "")
        )
    read = [signed(table, name) for name in names]
    length = next((len(values) for values, _ in read if isinstance(values, np.ndarray)), None)
    if length is None:
        raise ValueError(f"{table.path}: expected a column among {list(references)}, found constants only")
    columns = [values if isinstance(values, np.ndarray) else np.full(length, values) for values, _ in read]
    infinite = next((each for each in columns if np.isinf(each).any()), None)
    if infinite is not None:
        row = int(np.isinf(infinite).argmax())
        raise ValueError(f"{line_of(table, row)}: expected finite numbers, found {infinite[row]}; leave the cell empty")
    if len({len(each) for each in columns}) > 1:
        raise ValueError(f"{table.path}: expected columns of one length, found {[len(each) for each in columns]}")
    factors = [_factor(table, column, quantity, given) for _, column in read]
    return np.stack([each * factor for each, factor in zip(columns, factors, strict=True)], 1)


def expanded(table: Table, references: Sequence[Reference], count: int) -> list[Reference]:
    """Return one reference for each column: the name of an array stands for all of its components."""
    if len(references) == 1 and count > 1 and isinstance(references[0], str):
        return list(table.components(references[0]))
    return list(references)


def is_constant(table: Table, reference: Reference) -> bool:
    """Return whether a reference is a number, and no column."""
    return isinstance(reference, int | float) and str(reference) not in table.columns


def unsigned(table: Table, reference: Reference) -> str:
    """Return the name that a reference means, without the sign that turns its values round."""
    name = str(reference)
    return name[1:] if name.startswith("-") and name not in table.columns else name


def signed(table: Table, reference: Reference) -> tuple[Array | float, str | None]:
    """Return the values that a reference means and its column, or a constant."""
    if is_constant(table, reference):
        return float(reference), None
    name = unsigned(table, reference)
    return (1.0 if name == str(reference) else -1.0) * table.values(name), table.find(name)


def _factor(table: Table, column: str | None, quantity: str | None, given: str | None) -> float:
    """Return what one of a column is in SI; what its header says and what the mapping says must agree."""
    if quantity is None:
        return 1.0
    said = table.units.get(column or "")
    header = canonical(said, quantity) if said else None
    if said and header is None and any(canonical(said, other) for other in DEFAULTS):
        raise ValueError(
            f'{table.path}: column "{column}" is in {said}, which is no unit of {quantity}; is it the right one?'
        )
    if said and header is None and given is None and not NO_UNIT.fullmatch(said):
        raise ValueError(
            f'{table.path}: expected a unit of {quantity} in "{column}", found {quoted(said)}'
            f"{nearest(said, UNITS[quantity])}; say which it is: units.{quantity}={DEFAULTS[quantity].replace(' ', '')}"
        )
    wanted = canonical(given, quantity) if given else None
    if header and wanted and header != wanted:
        raise ValueError(
            f"{table.path}: column '{column}' says {header}, the mapping says units.{quantity}: {wanted}; "
            "correct one of them"
        )
    return factor_of(quantity, wanted or header or DEFAULTS[quantity], f"units.{quantity}")


def units_of_names(table: Table, columns: Mapping[str, Sequence[Reference]], units: Mapping[str, str]) -> list[str]:
    """Say of which columns the unit is known by how their names end alone.

    Args:
        table: The log.
        columns: The columns that are read, by quantity.
        units: What the mapping says of quantities; of these nothing is said.
    """
    found: dict[str, list[str]] = {}
    for quantity, references in columns.items():
        for reference in () if quantity in units else references:
            for name in () if is_constant(table, reference) else table.components(unsigned(table, reference)):
                if name in table.units and is_suffixed(name) and canonical(table.units[name], quantity):
                    found.setdefault(table.units[name], []).append(name)
    return [
        f"{', '.join(names)}: taken in {unit}, as the name ends; if it does not mean that, rename the column"
        for unit, names in found.items()
    ]


def require_increasing(table: Table, time: Array, rows: NDArray[np.intp]) -> None:
    """Refuse stamps that are missing, doubled, or run back."""
    if not np.isfinite(time).all():
        raise ValueError(f"{line_of(table, int(rows[~np.isfinite(time)][0]))}: expected a time stamp, found none")
    wrong = np.flatnonzero(np.diff(time) <= 0)
    if len(wrong):
        at = int(wrong[0]) + 1
        what = "the same stamp again" if time[at] == time[at - 1] else f"time that runs back from {time[at - 1]:.9g} s"
        raise ValueError(
            f"{line_of(table, int(rows[at]))}: expected increasing time stamps, found {what} ({time[at]:.9g} s; "
            f"{len(wrong)} such rows); sort the rows or leave doubled ones out, or name the column that numbers "
            "trajectories: trajectory=COLUMN"
        )


def line_of(table: Table, row: int) -> str:
    """Return file and line of a row."""
    if not table.line:
        return f"{table.path}: row {row}"
    line = table.line + row
    for skipped in table.skipped:
        line += skipped <= line
    return f"{table.path}:{line}"


def numbered(table: Table, column: Reference) -> tuple[NDArray[np.int64], Array]:
    """Return which trajectory each row is of, -1 where the column is empty, and their numbers, in their order."""
    number = table.values(column)
    known = np.flatnonzero(~np.isnan(number))
    if not len(known):
        raise ValueError(f"{table.path}: expected numbers of trajectories in {column}, found nothing but empty cells")
    found, first, inverse = np.unique(number[known], return_index=True, return_inverse=True)
    group = np.full(len(number), -1, dtype=np.int64)
    group[known] = np.argsort(np.argsort(first))[inverse]
    return group, found[np.argsort(first)]


def require_angles(table: Table, names: Sequence[Reference], angles: Array, units: Mapping[str, str]) -> None:
    """Refuse angles beyond a turn where nothing says their unit: radians that count turns, or degrees."""
    columns = [table.find(str(one).removeprefix("-")) for one in names if isinstance(one, str)]
    if "angle" in units or any(table.units.get(one) for one in columns):
        return
    beyond = (np.abs(angles) > TURN).any(1)
    if beyond.any():
        row = int(beyond.argmax())
        raise ValueError(
            f"{line_of(table, row)}: expected angles in radians, since nothing says another unit, found "
            f"{float(np.nanmax(np.abs(angles[row]))):.4g}, more than a turn; if they are degrees: units.angle=deg, if "
            "they are radians that count turns: units.angle=rad"
        )
