"""Orientations of a body, in whatever columns a log has for them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from physid.data.importers.columns import expanded, read_columns, require_angles, signed
from physid.data.importers.mapping import BodyMap, LogMap, Reference
from physid.data.importers.rotations import ROUNDED, from_euler, from_matrices, from_quaternions, from_vectors
from physid.data.importers.tables.table import Table
from physid.data.importers.units import split_header

Array = NDArray[np.float64]
ANGLES = ("euler", "rotation_vector")
TURNS = {"roll": "x", "pitch": "y", "yaw": "z"}  # where z is up or down


def read_orientations(
    table: Table, each: BodyMap, log: LogMap, rows: int
) -> tuple[Array, NDArray[np.intp] | Sequence[int]]:
    """Return unit quaternions x y z w (T, 4) in the log's axes, and rows that hold none."""
    if each.orientation == "orientation":
        return np.tile([0.0, 0.0, 0.0, 1.0], (rows, 1)), ()
    if each.orientation in ANGLES:
        sequence = each.order or "xyz"
        count = len(sequence) if each.orientation == "euler" else 3
        if each.orientation == "euler":
            _require_order(table, each.columns, sequence, upright=bool(log.axes[2, 2]))
        angles = read_columns(table, each.columns, "angle", log.units, count)
        require_angles(table, each.columns, angles, log.units)
        return (from_euler(angles, sequence, 1.0) if each.orientation == "euler" else from_vectors(angles, 1.0)), ()
    if each.orientation == "matrix":
        return from_matrices(read_columns(table, each.columns, None, log.units, 9))
    names = expanded(table, each.columns, 4)
    order = _order_of(table, names, each.order)
    return from_quaternions(read_columns(table, each.columns, None, log.units, 4), order)


def _require_order(table: Table, names: Sequence[Reference], sequence: str, *, upright: bool) -> None:
    """Refuse angles whose names say another order than the one that is given.

    Where z is upright, roll, pitch and yaw are about x, y and z.
    """
    bare = [_bare(name) for name in names]
    plain = "".join(name[-1:] for name in bare)
    spoken = "".join(next((axis for word, axis in TURNS.items() if name.endswith(word)), "?") for name in bare)
    said = [plain, spoken] if upright else [plain]
    if any(set(one) <= set("xyz") and one != sequence.lower() for one in said):
        raise ValueError(
            f"{table.path}: euler_order says {sequence}, but the columns are {', '.join(map(str, names))}; list them "
            "as they stand in the order that you give, or, where a name means another axis (roll, pitch, yaw: x, y, z)"
            ", rename the column"
        )


def _order_of(table: Table, names: Sequence[Reference], order: str | None) -> str:
    """Return the order of a quaternion's columns: as the mapping says, or as their names end."""
    ends = "".join(_bare(name)[-1:] for name in names)
    named = ends.translate(str.maketrans("ijkr", "xyzw")) if sorted(ends) == sorted("ijkr") else ends
    said = named if sorted(named) == sorted("xyzw") else None
    if order is None and said is None:
        raise ValueError(
            f"{table.path}: expected order: xyzw or wxyz, for the names {', '.join(map(str, names))} do not say it; a "
            "body at rest in its first orientation has w near 1"
        )
    if said is not None and said not in (("xyzw", "wxyz") if order is None else (order,)):
        raise ValueError(
            f"{table.path}: order says {order or 'nothing, which leaves xyzw or wxyz'}, but the columns are "
            f"{', '.join(map(str, names))}; list them as they stand in the order that you give, or leave order out"
        )
    return order or said or "xyzw"


def _bare(name: Reference) -> str:
    """Return the name of a column without its unit, in small letters."""
    return split_header(str(name))[0].lower()


def say_why_none(each: BodyMap, table: Table, row: int) -> str:
    """Say why a row holds no orientation: for the message that refuses it."""
    if each.orientation == "matrix":
        return f"expected a rotation matrix for {each.body.name}, row by row, found none; are these its columns?"
    found = [
        float(v[row]) if isinstance(v, np.ndarray) else v
        for v, _ in (signed(table, n) for n in expanded(table, each.columns, 4))
    ]
    length = float(np.linalg.norm(found))
    if length == 0:
        return (
            f"expected a unit quaternion for {each.body.name}, found zeros; if they mean that it was lost: lost: zeros"
        )
    return (
        f"expected a unit quaternion for {each.body.name} (to {ROUNDED:g}), found "
        f"{', '.join(f'{one:.4g}' for one in found)} of length {length:.4g}; are these angles "
        "(euler, with units.angle), or other columns?"
    )
