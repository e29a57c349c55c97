"""Free falls, and what they say of units, clock and the direction of gravity."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physid.inspection.evidence import Evidence
from physid.inspection.finding import Finding

Array = NDArray[np.float64]
ENOUGH = 20  # windows: fewer say nothing
FALL = 0.15  # share by which a fall may differ from gravity
STRAIGHT = 0.98  # cosine between a fall and gravity from which on it is straight down
ALIKE = 0.6  # share of straight falls with one acceleration, and of what has it that falls, where it is that of a fall
AXIS = 0.97  # cosine between a fall and gravity below which the axes are others
SCALES = {1e3: "millimetres", 1e2: "centimetres", 39.37: "inches", 3.281: "feet"}
SMALLER = {
    1e3: "metres read as millimetres", 1e2: "metres read as centimetres", 10.0: "centimetres read as millimetres",
    25.4: "inches read as millimetres", 2.54: "inches read as centimetres",
}  # fmt: skip
SURELY = 0.05  # share by which a fall may differ from that in another unit, where the rate may be another as well


def falls(seen: Evidence) -> Finding | None:
    """Free falls in another direction, or with another acceleration, than gravity."""
    k, gravity = seen.kinematics, seen.weight
    g = float(np.linalg.norm(gravity))
    if not g:
        return None
    size = np.linalg.norm(k.acceleration, axis=1)
    free = seen.smooth & seen.unforced
    slow = _clock(k.acceleration[free], gravity, 0.05 * len(size))
    if slow is not None:
        return slow
    for scale, unit in SCALES.items():
        alike = k.acceleration[free & (np.abs(size / (scale * g) - 1) < FALL)]
        # What falls, falls in one direction; impacts have any.
        if len(alike) > max(ENOUGH, 0.05 * len(size)) and np.linalg.norm(alike.mean(0)) > AXIS * scale * g * (1 - FALL):
            return Finding(
                f"bodies fall with about {scale * g:.4g} m/s^2, gravity is {g:.3g}: positions seem to be in {unit}",
                f"import with the unit of the log (units.position), or divide positions by {scale:g}",
            )
    falling = free & (np.abs(size / g - 1) < FALL)
    if np.count_nonzero(falling) < max(ENOUGH, 0.02 * len(size)):
        return None
    mean = np.median(k.acceleration[falling], axis=0)
    if abs(np.linalg.norm(mean) / g - 1) > FALL:
        return None  # noise has no direction
    cosine = float(mean @ gravity / np.linalg.norm(mean) / g)
    if cosine < AXIS:
        axis = int(np.abs(mean).argmax())
        up, axes = seen.origin.up(f"{'-' if mean[axis] > 0 else ''}{'xyz'[axis]}")
        return Finding(
            f"bodies fall along {_vector(mean)} m/s^2, gravity is {_vector(gravity)}: up seems to be {up}",
            f"import with the axes of the log (axes={axes}), or correct gravity in recording.yaml",
        )
    return None


def _clock(acceleration: Array, gravity: Array, enough: float) -> Finding | None:
    """Free falls along gravity at another rate, one for all of them, which no unit of length explains."""
    size, g = np.linalg.norm(acceleration, axis=1), float(np.linalg.norm(gravity))
    falling = size[(acceleration @ gravity > STRAIGHT * size * g) & (size > 0)] / g
    if len(falling) < max(ENOUGH, enough):
        return None
    share = float(np.median(falling))
    alike = np.mean(np.abs(falling / share - 1) < FALL) > ALIKE
    # Friction slows by one acceleration, too, but in any direction.
    down, any_way = (np.count_nonzero(np.abs(one / share - 1) < FALL) for one in (falling, size / g))
    if down < ALIKE * any_way:
        return None
    if not alike or any(abs(share / scale - 1) < FALL for scale in (1.0, *SCALES)):
        return None
    factor = share**0.5
    for times, what in SMALLER.items():
        if abs(share * times - 1) < SURELY:
            return Finding(
                f"bodies fall straight down with {share * g:.3g} m/s^2, gravity is {g:.3g}: positions seem to be "
                f"{times:g} times too small, as {what} are",
                f"import with the unit of the log (units.position); or, if stamps are not to be trusted, with "
                f"{1 / factor:.3g} times the rate",
            )
    return Finding(
        f"bodies fall straight down with {share * g:.3g} m/s^2, gravity is {g:.3g}: the frame rate seems to be "
        f"{factor:.3g} times the true one",
        f"import with the rate at which it was recorded (rate): {1 / factor:.3g} times what it is now; films in slow "
        "motion are played at another",
    )


def upside(seen: Evidence) -> Finding | None:
    """Gravity that points away from the ground."""
    gravity, normal = seen.weight, np.array(seen.scene.ground.normal)
    if float(gravity @ normal) <= 0:
        return None
    return Finding(
        f"gravity is {_vector(gravity)} m/s^2 and points away from the ground, whose normal is {_vector(normal)}: "
        "nothing could lie on it",
        "correct the sign of gravity in recording.yaml, or import with the axes of the log (axes=z-down)",
    )


def _vector(value: Array) -> str:
    """Write a vector."""
    return f"({', '.join(f'{one:.2f}' for one in value)})"
