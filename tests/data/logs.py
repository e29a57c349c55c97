"""Logs of a thrown, turning box by closed form, as other programs would write them; nothing of physid is in them."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Truth:
    """What happened: world frame, z up, SI."""

    time: Array
    place: Array
    turn: Rotation
    force_time: Array
    force: Array

    @classmethod
    def of(
        cls, seed: int = 0, rate: float = 100.0, jitter: float = 0.1, missing: float = 0.05, seconds: float = 2.0
    ) -> Truth:
        """Draw a motion, its stamps with jitter, some missing, and forces at 500 Hz."""
        generator = np.random.default_rng(seed)
        number = np.flatnonzero(generator.random(int(seconds * rate)) > missing)
        time = (number + generator.uniform(-jitter, jitter, len(number))) / rate
        time -= time[0]
        place = np.stack([0.5 * time, -0.2 * time + 0.1 * time**2, 0.3 + 0.05 * np.sin(3 * time)], 1)
        turn = Rotation.from_rotvec(np.outer(time, [0.2, -0.5, 1.0])) * Rotation.from_euler("xyz", [0.1, 0.2, 0.3])
        force_time = np.arange(-0.01, seconds, 1 / 500)
        phase = np.outer(force_time, [3.0, 5.0, 7.0])
        return cls(time, place, turn, force_time, np.sin(phase) * [1.0, 2.0, 3.0])


def write_csv(path: Path, names: list[str], columns: list[Array]) -> Path:
    """Write a table as any logger would."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(names)
        writer.writerows(
            [repr(float(value)) if np.isfinite(value) else "" for value in row] for row in zip(*columns, strict=True)
        )
    return path


def y_up(vectors: Array) -> Array:
    """Return vectors in a right-handed frame with y up: x stays, y is the world's z, z the world's -y."""
    return np.stack([vectors[:, 0], vectors[:, 2], -vectors[:, 1]], 1)


def write_y_up(folder: Path, truth: Truth, name: str = "run") -> tuple[Path, Path]:
    """Write millimetres, y up, quaternions w first, and forces in a file of their own."""
    change = Rotation.from_matrix([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
    x, y, z = (1000 * y_up(truth.place)).T
    qx, qy, qz, qw = (change * truth.turn).as_quat().T
    poses = write_csv(
        folder / f"{name}.csv", ["t", "x", "y", "z", "qw", "qx", "qy", "qz"], [truth.time, x, y, z, qw, qx, qy, qz]
    )
    forces = write_csv(folder / f"{name}_forces.csv", ["t", "fx", "fy", "fz"], [truth.force_time, *y_up(truth.force).T])
    return poses, forces
