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
TURNS = {"roll": "x", "pitch": "y", "yaw": "z"}  # where z is up or down


def read_orientations(
    table: Table, each: BodyMap, log: LogMap, rows: int
) -> tuple[Array, NDArray[np.intp] | Sequence[int]]:
    """Return unit quaternions x y z w (T, 4) in the log's axes, and rows that hold none."""
    if each.orientation == "orientation":
        return np.tile([0.0, 0.0, 0.0, 1.0], (rows, 1)), ()
    if each.orientation in ("euler", "rotation_vector"):
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
    """Refuse angles whose names say another order: other letters, or roll, pitch and yaw where yaw, pitch and roll are.

    Where z is upright, roll, pitch and yaw mostly are about x, y and z; whoever lists them otherwise may mean it.
    """
    bare = [split_header(str(name))[0].lower() for name in names]
    plain = "".join(name[-1:] for name in bare)
    spoken = "".join(next((axis for word, axis in TURNS.items() if name.endswith(word)), "?") for name in bare)
    wrong = set(plain) <= set("xyz") and plain != sequence.lower()
    if wrong or (upright and len(spoken) > 1 and spoken == sequence.lower()[::-1]):
        raise ValueError(
            f"{table.path}: euler_order says {sequence}, but the columns are {', '.join(map(str, names))}; list them "
            "as they stand in the order that you give"
        )


def _order_of(table: Table, names: Sequence[Reference], order: str | None) -> str:
    """Return the order of a quaternion's columns: as the mapping says, or as their names end."""
    ends = "".join(split_header(str(name))[0].lower()[-1:] for name in names)
    named = {"xyzw": "xyzw", "wxyz": "wxyz", "ijkr": "xyzw", "rijk": "wxyz"}.get(ends)
    if order is None and named is None:
        raise ValueError(
            f"{table.path}: expected order: xyzw or wxyz, for the names {', '.join(map(str, names))} do not say it; a "
            "body at rest in its first orientation has w near 1"
        )
    if order is not None and named is not None and named != order:
        raise ValueError(
            f"{table.path}: order says {order}, but the columns are {', '.join(map(str, names))}; list them as they "
            "stand in the order that you give, or leave order out"
        )
    return order or named or "xyzw"


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
