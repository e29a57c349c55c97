"""One log, by a mapping, as poses and forces in SI, world frame. Nothing is estimated, smoothed or resampled."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from physid.data.importers.columns import (
    line_of,
    numbered,
    read_columns,
    read_stamps,
    require_increasing,
    units_of_names,
)
from physid.data.importers.mapping import BodyMap, LogMap
from physid.data.importers.orientations import ANGLES, read_orientations, say_why_none
from physid.data.importers.rotations import in_world, turned
from physid.data.importers.tables.files import read_table
from physid.data.importers.tables.table import Table
from physid.data.importers.topics import frames_of_poses, names_of_rows, topic_of_forces
from physid.scenes.rotations import rotate

Array = NDArray[np.float64]
PARTS = 8  # of a frame, or of the time between two rows of forces that change steadily if that is longer


@dataclass(frozen=True)
class Poses:
    """Poses of all rows of a log.

    Attributes:
        time: Stamps [s], on the log's own clock, shape (T,); None where it has none.
        pose: World frame, NaN where not seen, shape (T, N, 7).
        group: Number of the trajectory that each row belongs to, shape (T,).
        names: By which the log's own column names these trajectories, in their order; none without such a column.
        frames: That the log says they are in.
        notes: What was taken for granted, a line each.
    """

    time: Array | None
    pose: Array
    group: NDArray[np.int64]
    names: Array = field(default_factory=lambda: np.empty(0))
    frames: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    def turned(self, wrench: Array, at: Array, frames: NDArray[np.intp], time: Array) -> Array:
        """Turn wrenches in the axes of bodies into the world, see `in_world`; `frames` are those of a trajectory."""
        return in_world(wrench, at, self.pose[frames], time)


@dataclass(frozen=True)
class Forces:
    """Forces of all rows of a log that hold any.

    Attributes:
        time: Stamps [s], on the clock of the poses, shape (S,); None where the log has none.
        wrench: World frame, torque before force, shape (S, N, 6).
        row: Row of the log that each comes from, shape (S,).
        empty: Rows of the log without forces.
        names: Of the trajectory of each, where a log of forces alone has the column that names them, shape (S,).
        frames: That the log says they are in.
        notes: What was taken for granted, a line each.
    """

    time: Array | None
    wrench: Array
    row: NDArray[np.int64]
    empty: int
    names: Array | None = None
    frames: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def read_poses(table: Table, log: LogMap) -> Poses:
    """Read stamps and poses of all bodies.

    Where bodies have clocks of their own, the rows are all stamps of all of them, in order; at those of another body a
    body counts as not seen.

    Raises:
        ValueError: If a column is missing, units contradict each other, or a row holds no pose.
    """
    frames = frames_of_poses(table, log)
    bodies = [_pose_of(table, each, log) for each in log.bodies]
    if any(each.clock is not None for each in log.bodies):
        return replace(_on_one_clock(table, bodies, log), frames=frames, notes=_notes_of_poses(table, log))
    if len({len(each) for each in bodies}) > 1:
        raise ValueError(
            f"{table.path}: expected poses of all bodies in the same rows, found {[len(b) for b in bodies]}; where "
            "bodies have stamps of their own, name their column: bodies: [..., {clock: COLUMN, ...}]"
        )
    pose = np.stack(bodies, 1)
    time = None if log.time is None else read_stamps(table, log.time, log.units.get("time"))
    if time is not None and len(time) != len(pose):
        raise ValueError(f"{table.path}: expected a stamp for each of {len(pose)} poses, found {len(time)}")
    group, names = np.zeros(len(pose), dtype=np.int64), np.empty(0)
    if log.trajectory is not None:
        group, names = numbered(table, log.trajectory)
    if time is not None:
        for one in range(group.max() + 1):
            require_increasing(table, time[group == one], np.flatnonzero(group == one))
    return Poses(time, pose, group, names, frames, _notes_of_poses(table, log))


def _notes_of_poses(table: Table, log: LogMap) -> tuple[str, ...]:
    """Say which units were taken from the names of columns of poses."""
    clocks = [one for one in (log.time, *(each.clock for each in log.bodies)) if one is not None]
    turns = [one for each in log.bodies if each.orientation in ANGLES for one in each.columns]
    places = [one for each in log.bodies for one in each.position]
    return tuple(units_of_names(table, {"time": clocks, "position": places, "angle": turns}, log.units))


def _notes_of_forces(table: Table, log: LogMap) -> tuple[str, ...]:
    """Say which units were taken from the names of columns of forces."""
    columns = {
        "force": [one for each in log.bodies for one in each.force],
        "torque": [one for each in log.bodies for one in each.torque],
        "time": [] if log.forces.time is None or "forces_time" in log.units else [log.forces.time],
    }
    return tuple(units_of_names(table, columns, log.units))


def _on_one_clock(table: Table, bodies: Sequence[Array], log: LogMap) -> Poses:
    """Lay poses of bodies with clocks of their own on the stamps of all of them."""
    if log.time is None or log.trajectory is not None:
        raise ValueError(
            f"{table.path}: expected time, the stamps of bodies that have no clock of their own, and no trajectory "
            f"column beside clock, found time: {log.time} and trajectory: {log.trajectory}"
        )
    clocks = [
        read_stamps(table, log.time if each.clock is None else each.clock, log.units.get("time")) for each in log.bodies
    ]
    for clock, pose, each in zip(clocks, bodies, log.bodies, strict=True):
        if len(clock) != len(pose):
            raise ValueError(
                f"{table.path}: expected a stamp for each of {len(pose)} poses of {each.body.name}, found "
                f"{len(clock)}; is its clock the column beside its poses?"
            )
        require_increasing(table, clock, np.arange(len(clock)))
    time = np.unique(np.concatenate(clocks))
    whole = np.full((len(time), len(bodies), 7), np.nan)
    for index, (clock, pose) in enumerate(zip(clocks, bodies, strict=True)):
        whole[np.searchsorted(time, clock), index] = pose
    return Poses(time, whole, np.zeros(len(time), dtype=np.int64))


def read_force_log(path: Path, log: LogMap) -> Forces | None:
    """Read a log of forces that stands by itself (see `read_forces`)."""
    return read_forces(read_table(path, header=log.forces.header), log, own=True)


def read_forces(table: Table, log: LogMap, *, own: bool) -> Forces | None:
    """Read forces of all bodies; None where the mapping names no columns of them.

    Args:
        table: The log that holds them.
        log: What its columns mean.
        own: Whether it is another file than that of the poses, with a clock of its own.

    Raises:
        ValueError: If a column is missing, units contradict each other, or a row is empty in part.
    """
    if not any(each.force or each.torque for each in log.bodies):
        return None
    topic = topic_of_forces(table, log, own=own)
    sign = float(np.sign(np.linalg.det(log.axes)))  # a torque is a pseudovector: a mirror turns it round
    axes = np.diag([1.0, 1.0, sign]) if log.forces.axes == "body" else log.axes  # boxes are mirrored along z (`turned`)
    parts = []
    for each in log.bodies:
        for references, quantity, mirror in ((each.torque, "torque", sign), (each.force, "force", 1.0)):
            parts.append(
                (read_columns(table, references, quantity, log.units, 3), mirror) if references else (None, 1.0)
            )
    count = next(len(values) for values, _ in parts if values is not None)
    wrench = np.zeros((count, len(log.bodies), 6))
    for index, (values, mirror) in enumerate(parts):
        if values is not None:
            if len(values) != count:
                raise ValueError(f"{table.path}: expected as many torques as forces, found {len(values)} and {count}")
            wrench[:, index // 2, 3 * (index % 2) : 3 * (index % 2) + 3] = mirror * values @ axes.T
    empty = np.isnan(wrench).any((1, 2))
    partly = empty & ~np.stack([np.isnan(v).all(1) for v, _ in parts if v is not None], 1).all(1)
    if partly.any():
        raise ValueError(
            f"{line_of(table, int(partly.argmax()))}: expected all components of the forces or none, found some of them"
        )
    clock = log.forces.time if log.forces.time is not None else (log.time if log.forces.rate is None else None)
    time = None
    if clock is not None:
        unit = log.units.get("forces_time")
        # What a header of their own says is theirs.
        if unit is None and not (own and table.units.get(table.find(clock))):
            unit = log.units.get("time")
        time = read_stamps(table, clock, unit)
    elif log.forces.rate is not None:
        time = np.arange(count) / log.forces.rate
    names = names_of_rows(table, log, topic, count) if own else None
    if names is not None and clock is None and time is not None:
        _, first, which = np.unique(names, return_index=True, return_inverse=True)
        time = time - time[first][which]
    if time is not None and len(time) != count:
        raise ValueError(f"{table.path}: expected a stamp for each of {count} rows of forces, found {len(time)}")
    row = np.flatnonzero(~empty)
    if not len(row):
        raise ValueError(f"{table.path}: expected forces, found nothing but empty cells")
    if time is not None and (own or log.trajectory is None):
        for one in [row] if names is None else [row[names[row] == name] for name in np.unique(names[row])]:
            require_increasing(table, time[one], one)
    stamps = None if time is None else time[row] + log.forces.offset
    return Forces(
        stamps,
        wrench[row],
        row,
        int(empty.sum()),
        None if names is None else names[row],
        table.frames.get(topic, ()),
        _notes_of_forces(table, log),
    )


def along_lines(time: Array, wrench: Array, frame: float) -> tuple[Array, Array]:
    """Return forces that are held for an eighth of a frame or less: the means of lines from one row to the next.

    Rows that come faster are not divided: the mean of a line has its impulse, and half a row is all that it is held.

    Args:
        time: Stamps [s], shape (S,).
        wrench: Shape (S, N, 6); the last one is held.
        frame: Time from one pose to the next [s].
    """
    parts = int(np.clip(np.ceil(PARTS * np.median(np.diff(time)) / frame), 1, PARTS)) if len(time) > 1 else 1
    share = np.arange(parts) / parts
    stamps = time[:-1, None] + np.diff(time)[:, None] * share
    means = wrench[:-1, None] + np.diff(wrench, axis=0)[:, None] * (share + 0.5 / parts)[:, None, None]
    return np.append(stamps, time[-1]), np.concatenate([means.reshape(-1, *wrench.shape[1:]), wrench[-1:]])


def _pose_of(table: Table, each: BodyMap, log: LogMap) -> Array:
    """Return the poses (T, 7) of a body, NaN where it was not seen."""
    place = read_columns(table, each.position, "position", log.units, 3)
    turn, wrong = read_orientations(table, each, log, len(place))
    lost = np.asarray(np.isnan(place).any(1) | np.isnan(turn).any(1))
    if log.lost == "zeros":
        lost |= (place == 0).all(1)
    if each.visible is not None:
        lost |= ~(table.values(each.visible) > 0)
    bad = [int(row) for row in wrong if not lost[row]]
    if bad:
        raise ValueError(f"{line_of(table, bad[0])}: {say_why_none(each, table, bad[0])}")
    turn = np.where(lost[:, None], [0.0, 0.0, 0.0, 1.0], turn)
    pose = np.concatenate([place @ log.axes.T, turned(turn, log.axes)], 1)
    point = np.array(each.tracked_point)
    if point.any():
        point = point * ([1, 1, -1] if np.linalg.det(log.axes) < 0 else [1, 1, 1])
        pose[:, :3] -= rotate(pose[:, 3:], point)
    pose[lost] = np.nan
    return pose
