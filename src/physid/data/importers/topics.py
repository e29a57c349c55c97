"""Which columns share their rows: those of one topic of a bag; rows of another one are other moments."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from physid.data.importers.columns import is_constant, unsigned
from physid.data.importers.mapping import LogMap, Reference
from physid.data.importers.tables.table import STAMP, MissingColumnError, Table

Array = NDArray[np.float64]


def _one_topic(table: Table, references: Sequence[Reference | None], what: str, remedy: str = "") -> str:
    """Return the topic that columns are of, or nothing where all columns share rows.

    Rows of two topics are other moments, even if there are as many of them.

    Raises:
        ValueError: If they are of several topics, or of one whose messages are in several frames.
    """
    found: dict[str, Reference] = {}
    for one in references:
        if one is not None and not is_constant(table, one):
            found.setdefault(table.topic_of(unsigned(table, one)), one)
    if len(found) > 1:
        (first, one), (second, other), *_ = found.items()
        raise ValueError(
            f"{table.path}: expected {what} in one topic, found {one} of {first or 'the log'} and {other} of "
            f"{second or 'the log'}, whose messages are sent at times of their own; {remedy or 'name columns of one'}"
        )
    topic = next(iter(found), "")
    if len(frames := table.frames.get(topic, ())) > 1:
        raise ValueError(
            f"{table.path}: expected {topic} in one frame, found messages in {' and '.join(frames)}; transforms are "
            "not chained: write those of one frame into a bag of their own"
        )
    return topic


def frames_of_poses(table: Table, log: LogMap) -> tuple[str, ...]:
    """Return the frames that the log says the poses are in, once the poses of a body are of the topic of their clock.

    Raises:
        ValueError: If they are not, or the messages of their topic are in several frames.
    """
    columns = [(*each.position, *each.columns, each.visible) for each in log.bodies]
    if any(each.clock is not None for each in log.bodies):
        topics = [
            _one_topic(
                table,
                (*own, log.time if each.clock is None else each.clock),
                f"the poses of {each.body.name} and their clock",
            )
            for own, each in zip(columns, log.bodies, strict=True)
        ]
    else:
        topics = [
            _one_topic(
                table,
                (*(one for own in columns for one in own), log.time, log.trajectory),
                "poses and their stamps",
                "name columns of one, or, of several bodies, their own stamps: bodies: [..., {clock: COLUMN, ...}]",
            )
        ]
    return tuple({frame: None for topic in topics for frame in table.frames.get(topic, ())})


def topic_of_forces(table: Table, log: LogMap, *, own: bool) -> str:
    """Return the topic of the forces, once they are of that of their stamps; without stamps, of that of the poses.

    Args:
        table: The log that holds them.
        log: What its columns mean.
        own: Whether it is another one than that of the poses.

    Raises:
        ValueError: If they are not, or the messages of their topic are in several frames.
    """
    columns = [one for each in log.bodies for one in (*each.force, *each.torque)]
    one_log = "name columns of one, or write those of all bodies into a log on one clock (forces.file)"
    topic = _one_topic(table, columns, "forces and torques", one_log)
    if log.forces.time is not None:
        _one_topic(table, (*columns, log.forces.time), "forces and forces.time")
    elif topic:
        stamp = f"{topic}/{STAMP}"
        remedy = f"give the forces their own stamps: forces.time={stamp if stamp in table.columns else 'COLUMN'}"
        beside = [log.time] if log.forces.rate is None else []
        if not own:  # a rate does not say either how long after the poses they begin
            beside = [log.time, *(one for each in log.bodies for one in each.position)]
        _one_topic(table, (*beside, *columns), "poses and forces without stamps of their own", remedy)
    return topic


def names_of_rows(table: Table, log: LogMap, topic: str, count: int) -> Array | None:
    """Return of which trajectory each row of a log of forces is; None where it does not say."""
    try:
        column = None if log.trajectory is None else table.find(log.trajectory)
    except MissingColumnError:
        return None
    if column is None or table.topics.get(column, "") != topic or len(table.columns[column]) != count:
        return None
    return table.values(column)
