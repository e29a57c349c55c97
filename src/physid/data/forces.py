"""Forces that a user plans, in a file of their own."""

from __future__ import annotations

import csv
import io
import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from physid.data.importers.units import factor_of, split_header
from physid.scenes import Scene
from physid.strict import LARGEST, MOST_SHOWN, nearest, quoted, shown, whole
from physid.yaml_files import read_text

Array = NDArray[np.float64]
NEAR = 0.02  # of a time step, by which stamps may be rounded
TIMES = ("t", "time", "stamp", "timestamp", "seconds")
COMPONENTS = ("torque_x", "torque_y", "torque_z", "force_x", "force_y", "force_z")


def read_forces(path: Path | str, scene: Scene) -> Array:
    """Read planned wrenches: one row for each time step of the scene, held from its frame to the next.

    A CSV file names its columns BODY.force_x or BODY.torque_z, with a unit behind or in SI, world frame, at the centre
    of the box; what it does not name is zero. Where it has a column `time`, which begins with 0 in the first frame, a
    row is held until the next, and the last until its time step ends; in each time step acts the mean of what is held.
    A NumPy file (.npy) holds an array (n, N, 6), torque before force.

    Args:
        path: The file.
        scene: Names the bodies.

    Returns:
        Wrenches of n + 1 frames, the last one zero, shape (n + 1, N, 6).

    Raises:
        FileNotFoundError: If there is no such file.
        ValueError: If it is of another kind, names an unknown column, is empty, or holds what is not finite.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"{path}: expected planned forces, found no such file")
    readers = {".csv": _read_csv, ".npy": _read_npy}
    if path.suffix not in readers:
        raise ValueError(f"{path}: expected planned forces as .csv or .npy, found {path.suffix or 'no suffix'}")
    wrench = readers[path.suffix](path, scene)
    if not len(wrench):
        raise ValueError(f"{path}: expected a row of forces for each time step, found none")
    if not np.isfinite(wrench).all():
        row = int(np.argwhere(~np.isfinite(wrench))[0, 0])
        raise ValueError(f"{path}: expected finite forces, found {wrench[row].tolist()} in row {row}")
    return np.concatenate([wrench, np.zeros_like(wrench[:1])])


def _read_csv(path: Path, scene: Scene) -> Array:
    """Read named columns."""
    places = {f"{body.name}.{one}": (n, k) for n, body in enumerate(scene.bodies) for k, one in enumerate(COMPONENTS)}
    try:
        lines = io.StringIO(read_text(path, "utf-8-sig", most=None), newline="")
        header, *rows = [[cell.strip() for cell in line] for line in csv.reader(lines) if line] or [[]]
    except (csv.Error, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: expected rows of numbers in CSV, found none ({error})") from None
    names = [split_header(each)[0] for each in header]
    stamps = [column for column, name in enumerate(names) if name not in places and _is_time(name)]
    for column, name in enumerate(names):
        if name not in places and column not in stamps[:1]:
            raise ValueError(f"{path}: unknown column {quoted(name)}{nearest(name, ('time', *places))}")
        if names.count(name) > 1:
            raise ValueError(f"{path}: expected each column once, found {quoted(name)} {names.count(name)} times")
    values = np.zeros((len(rows), len(names)))
    for number, row in enumerate(rows):
        try:
            values[number] = [float(value) for _, value in zip(names, row, strict=True)]
        except ValueError:
            found = ", ".join(row)[:MOST_SHOWN]
            raise ValueError(f"{path}: expected {len(names)} numbers in row {number}, found {found}") from None
    if not np.isfinite(values).all():
        first = int(np.argwhere(~np.isfinite(values))[0, 0])
        raise ValueError(f"{path}: expected finite numbers, found {', '.join(rows[first])[:MOST_SHOWN]} in row {first}")
    values *= [_factor(each, path) for each in header]
    wrench = np.zeros((len(rows), len(scene.bodies), len(COMPONENTS)))
    for column, name in enumerate(names):
        if name in places:
            wrench[:, *places[name]] = values[:, column]
    return _in_steps(path, values[:, stamps[0]], wrench, scene.time_step) if stamps else wrench


def _in_steps(path: Path, time: Array, wrench: Array, step: float) -> Array:
    """Return the means over time steps, so the same impulses, of wrenches that are held from stamp to stamp."""
    if not len(time):
        return wrench
    if not (abs(time[0]) < NEAR * step and (np.diff(time) > 0).all()):
        raise ValueError(
            f"{path}: expected stamps that begin with 0, the first frame, and increase, found {shown(time.tolist())}; "
            "subtract the stamp of the first frame"
        )
    count = whole(math.floor(time[-1] / step + NEAR) + 1, f"{path}: time steps", low=1, high=LARGEST["steps"])
    frames = step * np.arange(count + 1)
    stamps = np.append(np.maximum(time, 0.0), frames[-1])
    stamps[0] = 0.0
    impulse = np.zeros((len(stamps), *wrench.shape[1:]))
    impulse[1:] = (np.diff(stamps)[:, None, None] * wrench).cumsum(0)
    flat = impulse.reshape(len(stamps), -1)
    at_frames = np.stack([np.interp(frames, stamps, one) for one in flat.T], 1)
    return np.diff(at_frames, axis=0).reshape(count, *wrench.shape[1:]) / step


def _is_time(name: str) -> bool:
    """Return whether a column is one of stamps, by its name."""
    return name.lower().partition("_")[0] in TIMES


def _factor(header: str, path: Path) -> float:
    """Return what one of the unit in a header is in SI; without one, it is SI already."""
    name, unit = split_header(header)
    quantity = "time" if _is_time(name) else "torque" if "torque" in name else "force"
    return 1.0 if unit is None else factor_of(quantity, unit, f"{path}: {header}")


def _read_npy(path: Path, scene: Scene) -> Array:
    """Read one array."""
    try:
        # Mapped, not read: a header that declares more than the file holds is refused before anything is allocated.
        wrench = np.load(path, allow_pickle=False, mmap_mode="r")
        if not isinstance(wrench, np.ndarray):
            raise ValueError("an archive of arrays")
    except OSError:
        raise
    except Exception as error:  # NumPy reads headers with Python's own parser, which has errors of many kinds
        reason = (str(error).splitlines() or [""])[0][:200]
        raise ValueError(f"{path}: expected a NumPy array, found what cannot be read ({reason})") from None
    shape = (len(scene.bodies), len(COMPONENTS))
    if wrench.ndim != 3 or wrench.shape[1:] != shape or wrench.dtype.kind not in "fiu":
        raise ValueError(f"{path}: expected numbers of shape (n, {shape[0]}, 6), found {wrench.dtype} {wrench.shape}")
    return np.asarray(wrench, dtype=np.float64)
