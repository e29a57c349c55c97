"""Which columns hold orientations."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from physid.data.importers.guessing.grouping import TURN, Groups, first_of, unit_columns
from physid.data.importers.guessing.lines import Lines, bare, listed, quoted
from physid.data.importers.tables.table import Table
from physid.data.importers.units import split_header

ANGLES = (("roll", "pitch", "yaw"), ("rx", "ry", "rz"), ("phi", "theta", "psi"))
SURE = 0.95  # of a component that stays w of a body that hardly turns


def say_turn(table: Table, groups: Groups, found: Sequence[str], place: Sequence[str], said: Lines) -> None:
    """Write the orientation: columns that are found, named ones, or four that are a unit quaternion."""
    found = found or first_of(groups, TURN, "xyzw")
    if found:
        say_quaternion(table, found, said)
        return
    low = {split_header(name)[0].lower(): name for name in table.columns}
    for angles in ANGLES:
        if set(angles) <= set(low):
            said.say(f"euler: [{', '.join(quoted(low[one]) for one in angles)}]")
            said.say(
                "euler_order: xyz", "about the fixed axes x, y, z one after another; ZYX with yaw first is the same"
            )
            seen = np.concatenate([table.columns[low[one]] for one in angles])
            largest = float(np.abs(seen[np.isfinite(seen)]).max(initial=0.0))
            if not table.unit_of(low[angles[0]]):
                said.units["angle"] = "deg" if largest > 2 * np.pi else "rad"
                said.doubt(f"units.angle: {said.units['angle']}, since angles reach {largest:.4g}")
            return
    others = [name for name in table.columns if name not in [bare(one) for one in place]]
    four = unit_columns(table, others)
    if four:
        order, why = _order_by_value(table, four)
        said.say(f"quaternion: [{', '.join(map(quoted, four))}]", "by their length, which is 1")
        said.say(f"order: {order}", why)
        return
    said.say("orientation: none", "no quaternion, no angles: does the body not turn?")


def say_quaternion(table: Table, found: Sequence[str], said: Lines, before: str = "") -> None:
    """Write a quaternion, and its order where the names do not say it; `before` goes before each line."""
    said.say(f"{before}quaternion: {listed(table, found)}")
    names = [bare(name) for name in found]
    if any(re.search(r"\[\d\]$", name) for name in names):
        order, why = _order_by_value(table, names)
        said.say(f"{before}order: {order}", why)


def _order_by_value(table: Table, four: list[str]) -> tuple[str, str]:
    """Guess the order of a quaternion: w is near 1 where a body has hardly turned, as it has in the first row."""
    rows = np.stack([table.columns[name] for name in four], 1)
    seen = rows[np.isfinite(rows).all(1)]
    start = np.abs(seen[0]).tolist() if len(seen) else [0.0] * 4
    order = "wxyz" if start[0] > start[3] else "xyzw"
    return order, f"the first row is {', '.join(f'{one:.3g}' for one in start)}" + (
        "" if max(start[0], start[3]) > SURE else ", which does not show it"
    )
