"""Real recordings, converted to recording sets."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING
from zipfile import is_zipfile

import numpy as np
from numpy.typing import NDArray

from physid.data import (
    UNIT_TOLERANCE,
    Recording,
    assign_splits,
    trajectory_path,
    write_scene,
    write_sums,
    write_trajectory,
)
from physid.data.tensors import require_modest_tensors
from physid.scenes import Body, Ground, Scene
from physid.scenes.rotations import rotate

if TYPE_CHECKING:
    from torch import Tensor

Array = NDArray[np.float64]
CUBE_SOURCE = "real tosses of a cube: github.com/DAIRLab/dair_pll, folder assets/contactnets_cube (BSD 3-clause)"
CUBE_RATE = 148.0  # [Hz]
JOINTED = 15
"""Columns of the makers' other tosses: the angle of a joint, and its rate, beside those of a body."""
CUBE_SPLIT = {"train": 6, "val": 1, "test": 3}
# The makers' nominal model; friction from a tilt test.
CUBE = Body("cube", (0.1048, 0.1048, 0.1048), 0.37, 0.18, 0.125, inertia=(0.00081, 0.00081, 0.00081))
CUBE_GROUND = -0.00185
"""Nominal height of the ground [m]: the files do not state one, and their cubes come to rest this much below zero."""


def import_cube_tosses(folder: Path | str, out: Path | str) -> int:
    """Convert the real cube tosses of ContactNets (Pfrommer, Halm, Posa, CoRL 2020) to a recording set.

    Each file N.pt holds a float64 tensor (T, 13) at 148 Hz: quaternion w x y z, position [m], angular velocity in the
    body frame [rad/s], velocity [m/s]. No force acts but gravity. The ground's height is not in the files and is not
    estimated from them: `CUBE_GROUND` is written as its nominal value.

    Args:
        folder: Where the files are.
        out: Folder of the recording set.

    Returns:
        The number of tosses.

    Raises:
        FileNotFoundError: If there is no such folder, or no toss in it.
        ValueError: If a file is not such a tensor.
    """
    place = Path(folder)
    files = sorted(place.glob("*.pt"), key=lambda path: (len(path.stem), path.stem))
    if not files:
        raise FileNotFoundError(
            f"{place}: expected cube tosses N.pt, found none; get them from {CUBE_SOURCE.partition(': ')[2]}"
        )
    splits = assign_splits(len(files), CUBE_SPLIT)
    tosses = [_read_toss(path) for path in files]
    scene = Scene(
        name="toss",
        time_step=1 / CUBE_RATE,
        ground=Ground(offset=CUBE_GROUND),
        bodies=(CUBE,),
        unknown=("cube.friction", "cube.restitution"),
        source=CUBE_SOURCE,
    )
    write_scene(Path(out), scene)
    for index, ((pose, twist), split) in enumerate(zip(tosses, splits, strict=True)):
        recording = Recording(pose=pose, twist=twist, split=split, protocol="real")
        write_trajectory(trajectory_path(Path(out), index), recording)
    write_sums(Path(out))
    return len(files)


def _read_toss(path: Path) -> tuple[Array, Array]:
    """Read one toss as poses (T, 1, 7) and twists (T, 1, 6), world frame."""
    import torch

    try:
        if not is_zipfile(path):
            raise ValueError("no archive of torch.save; torch.save(torch.load(FILE), FILE) makes one of an older file")
        require_modest_tensors(path)
        value: Tensor = torch.load(path, weights_only=True)
        rows = value.numpy().astype(np.float64)
    except (OSError, RuntimeError, AttributeError, ValueError, EOFError) as error:
        raise ValueError(f"{path}: expected a saved tensor, found something else ({error})") from None
    if rows.ndim != 2 or rows.shape[1] != 13 or len(rows) < 2:
        jointed = rows.ndim == 2 and rows.shape[1] == JOINTED
        more = (
            f"; {JOINTED} columns are those of a body with a joint, which recording sets do not hold" if jointed else ""
        )
        raise ValueError(f"{path}: expected a tensor (T, 13) of at least 2 frames, found {rows.shape}{more}")
    quaternion = rows[:, [1, 2, 3, 0]]
    length = np.linalg.norm(quaternion, axis=1)
    if not np.isfinite(rows).all() or np.abs(length - 1).max() > UNIT_TOLERANCE:
        raise ValueError(f"{path}: expected finite rows that begin with a unit quaternion w x y z, found others")
    spin = rotate(quaternion, rows[:, 7:10])
    pose = np.concatenate([rows[:, 4:7], quaternion / length[:, None]], 1)
    return pose[:, None], np.concatenate([spin, rows[:, 10:]], 1)[:, None]
