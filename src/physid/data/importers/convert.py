"""Logs to a recording set, by a mapping."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from physid.data import (
    Recording,
    assign_splits,
    read_trajectory,
    trajectory_path,
    write_scene,
    write_sums,
    write_trajectory,
)
from physid.data.importers.finding import explained, force_logs
from physid.data.importers.mapping import GUESSED_FRICTION, LogMap
from physid.data.importers.reading_logs import Forces, Poses, along_lines, read_forces, read_poses
from physid.data.importers.sets import Imported, new_set
from physid.data.importers.tables.files import read_table
from physid.data.observations.stamps import check_clocks, rhythm_of, unlike_lengths
from physid.scenes import Scene

ROUND, NEAR = 3, 5e-3  # digits of a nominal rate, and how near to the stamps' own such a round one must be
FRICTION_NOTE = f"{GUESSED_FRICTION:g} is a first guess, and it is unknown, for the mapping does not say it"
LEAST = 2  # frames of a trajectory
NO_STAMPS = "without stamps a mapping says the rate"


def import_logs(files: Sequence[Path], values: dict[str, Any], out: Path) -> Imported:
    """Convert logs to a recording set; it is there whole or not at all.

    Args:
        files: Logs of poses, each of one trajectory or, with a column that numbers them, of several.
        values: The mapping (see `LogMap.from_mapping`).
        out: Folder of the set; must not exist, or be empty.

    Raises:
        FileNotFoundError: If there are no logs.
        FileExistsError: If the folder holds something.
        ValueError: If the mapping or a log is wrong; the message names file, line, and what to do.
    """
    if not files:
        raise FileNotFoundError(
            "expected logs to import, found none; name .csv or .npz files, or a folder that holds some"
        )
    log = LogMap.from_mapping(values)
    notes = [f"{name}: {FRICTION_NOTE}" for name in log.unsaid]
    with new_set(out, values) as part:
        count = _write(files, log, part, notes)
    return Imported(out, count, tuple(notes))


def _write(files: Sequence[Path], log: LogMap, folder: Path, notes: list[str]) -> int:
    """Write trajectories and the description of the set."""
    step, count = log.time_step, 0
    source = log.source or f"imported from {files[0].name}" + (f" and {len(files) - 1} more" if len(files) > 1 else "")
    bodies = tuple(each.body for each in log.bodies)
    scene = Scene(log.scene, step or 1.0, log.ground, bodies, log.unknown, None, log.gravity, source)
    for file, recording in _recordings(files, log, notes):
        try:
            if step is None:
                step = _nominal_step(recording)
                notes.append(f"time_step: {step:.6g} s ({1 / step:.6g} frames per second), as the stamps show")
            check_clocks(recording, step)
        except ValueError as error:
            raise ValueError(f"{file}: {str(error).replace('recording.yaml', 'the mapping')}") from None
        write_trajectory(trajectory_path(folder, count), recording)
        count += 1
    assert step is not None
    for index, split in enumerate(assign_splits(count, log.split) if log.split else ()):
        path = trajectory_path(folder, index)
        write_trajectory(path, replace(read_trajectory(path), split=split))
    write_scene(folder, replace(scene, time_step=step))
    write_sums(folder)
    return count


def _recordings(files: Sequence[Path], log: LogMap, notes: list[str]) -> Iterator[tuple[Path, Recording]]:
    """Yield trajectory by trajectory, with one log in memory at a time."""
    others = force_logs(files, log.forces.file)
    for index, file in enumerate(files):
        table = read_table(file, header=log.header)
        other = others[index]
        with explained(file, files):
            poses = read_poses(table, log)
            source = table if other is None else read_table(other, header=log.forces.header)
            # Arrays of a NumPy archive may be of several lengths: forces of another one are no part of the poses' rows.
            apart = not table.line and log.forces.time is not None and log.forces.time != log.time
            forces = read_forces(source, log, own=other is not None or apart)
        own = other is not None or (forces is not None and (apart or len(forces.row) + forces.empty != len(poses.pose)))
        if any(each.clock is not None for each in log.bodies):
            whole = int(np.isfinite(poses.pose[..., 0]).all(1).sum())
            notes.append(
                f"{file}: bodies have clocks of their own; {whole} of {len(poses.pose)} frames hold all of them"
            )
        taken = [*table.notes, *poses.notes, *(() if forces is None else (*forces.notes, *_frames(poses, forces, log)))]
        notes += [one for one in taken if one not in notes]
        if forces is not None and forces.empty:
            notes.append(f"{other or file}: {forces.empty} rows without forces; the force before each is held")
        if poses.time is None and forces is not None and forces.time is not None and log.time_step is not None:
            remark = unlike_lengths(len(poses.pose) * log.time_step, float(np.ptp(forces.time)), 1 / log.time_step)
            notes += [] if remark is None else [f"{file}: {remark}"]
        if own and forces is not None and forces.time is not None and log.forces.between is None and not index:
            notes += _held(forces.time)
        groups = poses.group.max() + 1
        if outside := int((poses.group < 0).sum()):
            notes.append(
                f"{file}: {outside} rows belong to no trajectory, for {log.trajectory} is empty there: left out"
            )
        if own and groups > 1 and poses.time is None:
            raise ValueError(f"{file}: expected stamps to tell which forces belong to which trajectory, found none")
        for group in range(groups):
            yield file, _recording(file, poses, forces, group, log, own=own)


def _recording(file: Path, poses: Poses, forces: Forces | None, group: int, log: LogMap, *, own: bool) -> Recording:
    """Build one trajectory of a log; its clock starts with its first frame."""
    rows = np.flatnonzero(poses.group == group)
    seen = np.isfinite(poses.pose[rows, :, 0]).any(1)
    if seen.sum() < LEAST:
        raise ValueError(f"{file}: expected at least {LEAST} rows with poses, found {int(seen.sum())}")
    # Rows in which nothing but forces stands are no frames.
    frames = rows[seen] if forces is not None and not own and poses.time is not None else rows
    start = 0.0 if poses.time is None else float(poses.time[frames[0]])
    if poses.time is None and not own and log.forces.time is None and log.forces.rate is not None:
        start = frames[0] / log.forces.rate  # rows of forces are counted through the whole log
    time = None if poses.time is None else poses.time[frames] - start
    wrench = wrench_time = None
    if forces is not None:
        within = np.isin(forces.row, rows)
        if own:
            within = np.full(len(forces.row), True) if forces.names is None else forces.names == poses.names[group]
            if not within.any():
                raise ValueError(f"{file}: expected forces of trajectory {poses.names[group]:.9g}, found none")
        wrench, row = forces.wrench[within], forces.row[within]
        if forces.time is not None:
            stamps = forces.time[within] - start
            same = not own and log.forces.time is None and not log.forces.offset and np.array_equal(row, frames)
            wrench_time = None if same else stamps
            if own and forces.names is None and poses.group.max() > 0:
                wrench, wrench_time = _around(
                    wrench, stamps, float(poses.time[frames[-1]] - start) if poses.time is not None else 0.0
                )
        elif len(wrench) != len(frames):
            raise ValueError(
                f"{file}: expected as many rows of forces as of poses, found {len(wrench)} and {len(frames)}; give the "
                "forces a clock: forces.time=COLUMN or forces.rate=ROWS_PER_SECOND"
            )
        if log.forces.axes == "body":
            if (clock := time) is None:
                assert log.time_step is not None, NO_STAMPS
                clock = log.time_step * np.arange(len(frames), dtype=np.float64)
            wrench = poses.turned(wrench, clock if wrench_time is None else wrench_time, frames, clock)
        if log.forces.between == "linear":
            if (rows_at := time if wrench_time is None else wrench_time) is None:
                raise ValueError(
                    f"{file}: expected stamps for forces.between=linear, found none; say time, or forces.rate"
                )
            frame = log.time_step if time is None else float(np.median(np.diff(time)))
            assert frame is not None, NO_STAMPS
            wrench_time, wrench = along_lines(rows_at, wrench, frame)
    return Recording(pose=poses.pose[frames], wrench=wrench, time=time, wrench_time=wrench_time, protocol=log.protocol)


def _frames(poses: Poses, forces: Forces, log: LogMap) -> list[str]:
    """Say that a log has frames of several names, which are taken for one; transforms are not chained."""
    if log.forces.axes == "body" or len({*poses.frames, *forces.frames}) < 2:
        return []
    return [
        f"poses are in the frame {' and '.join(poses.frames) or 'that none names'}, forces in "
        f"{' and '.join(forces.frames) or 'one that none names'}; both are taken for the axes of the world; of a "
        "sensor that turns with the body: forces.axes=body"
    ]


def _held(time: Any) -> list[str]:
    """Say that forces are held, which commands are and samples of a sensor are not; nothing of a single row."""
    if len(time) < 2:
        return []
    row = float(np.median(np.diff(time)))
    return [
        f"forces: each row is held until the next, {1e3 * row:.3g} ms later, as commands are "
        f"(forces.between=held); if a sensor sampled them they act {5e2 * row:.3g} ms too late: forces.between=linear"
    ]


def _around(wrench: Any, stamps: Any, end: float) -> tuple[Any, Any]:
    """Return the rows of forces that act in one trajectory out of several: the last one before it, and all in it."""
    first = max(int(np.searchsorted(stamps, 0.0, side="right")) - 1, 0)
    last = max(int(np.searchsorted(stamps, end)), first + 1)
    return wrench[first:last], stamps[first:last]


def _nominal_step(recording: Recording) -> float:
    """Return the nominal time between frames [s]: a round rate, where the stamps are near one."""
    assert recording.time is not None
    if len(recording.time) < LEAST:
        raise ValueError(f"expected at least {LEAST} rows, found {len(recording.time)}")
    rate = 1 / rhythm_of(recording.time).period
    rounded = float(f"{rate:.{ROUND}g}")
    return 1 / (rounded if abs(rounded / rate - 1) < NEAR else rate)
