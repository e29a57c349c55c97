"""Write the logs of a block that is pushed about on a table, as a tracker and a force sensor would write them.

Nothing of physid is in them: the motion follows from Coulomb's law in small exact steps. Positions are in millimetres
with y up, quaternions have w first, poses come 100 times a second with jitter and 5 % of the frames missing, forces 500
times. `--drag C` lets the air hold the block back with C N s/m, which no model expects.

    python examples/write_logs.py logs
    python examples/write_logs.py logs --drag 0.8
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

import numpy as np

MASS, FRICTION, GRAVITY, HEIGHT = 0.73, 0.21, 9.81, 0.05  # [kg], [-], [m/s^2], [m]
SECONDS, POSES, FORCES, FINE = 2.0, 100, 500, 50_000  # rates [1/s]
JITTER, MISSING, NOISE = 0.2, 0.05, 2e-4  # share of a period, share of frames, [m]
RUNS = 6


def push(generator: np.random.Generator, drag: float) -> tuple[np.ndarray, np.ndarray]:
    """Return forces (n, 2) at the rate of the sensor, and positions (m, 2) at the fine rate, from rest."""
    pieces = generator.uniform(-1.0, 1.0, (int(SECONDS / 0.2), 2)) * 2.5 * FRICTION * MASS * GRAVITY
    force = np.repeat(pieces, FORCES // 5, axis=0)
    place, speed, path = np.zeros(2), np.zeros(2), []
    for number in range(int(SECONDS * FINE)):
        path.append(place)
        drive = (force[number * FORCES // FINE] - drag * speed) / MASS
        # Friction takes the velocity that the push would give by at most mu g h, and never turns it round.
        free = speed + drive / FINE
        size = float(np.hypot(*free))
        after = free * max(0.0, 1 - FRICTION * GRAVITY / FINE / size) if size else free
        place, speed = place + (speed + after) / 2 / FINE, after
    return force, np.array(path)


def write(path: Path, names: list[str], columns: list[np.ndarray]) -> None:
    """Write a table."""
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(names)
        writer.writerows([f"{value:.5f}" for value in row] for row in zip(*columns, strict=True))


def main(folder: Path, drag: float = 0.0) -> None:
    """Write all runs, with so much drag [N s/m]."""
    folder.mkdir(parents=True, exist_ok=True)
    for run in range(RUNS):
        generator = np.random.default_rng(run)
        force, path = push(generator, drag)
        frame = np.flatnonzero(generator.random(int(SECONDS * POSES) - 1) >= MISSING)
        time = (frame + 0.5 + generator.uniform(-JITTER, JITTER, len(frame))) / POSES
        x, north = path[np.round(time * FINE).astype(int)].T + NOISE * generator.standard_normal((2, len(frame)))
        up = HEIGHT / 2 + NOISE * generator.standard_normal(len(frame))
        one, none = np.ones(len(frame)), np.zeros(len(frame))
        # The log's y is up and its z points south; a block that does not turn then stands in it as turned about x.
        half = np.sqrt(0.5)
        columns = [time, 1000 * x, 1000 * up, -1000 * north, half * one, -half * one, none, none]
        write(folder / f"run_{run}.csv", ["t", "x", "y", "z", "qw", "qx", "qy", "qz"], columns)
        stamps = np.arange(len(force)) / FORCES
        write(
            folder / f"run_{run}_forces.csv", ["t", "fx", "fy", "fz"], [stamps, force[:, 0], 0 * stamps, -force[:, 1]]
        )
    print(f"{folder}: {RUNS} runs; true mass {MASS} kg, friction {FRICTION}, drag {drag:g} N s/m")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", nargs="?", type=Path, default=Path("logs"))
    parser.add_argument("--drag", type=float, default=0.0)
    given = parser.parse_args()
    main(given.folder, given.drag)
