"""What looks like a mistake in recordings of boxes on a plane, each with the figures that say so, and the mend."""

from __future__ import annotations

from collections.abc import Callable
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from physid.inspection.evidence import Evidence
from physid.inspection.finding import Finding
from physid.inspection.kinematics import lowest_corner

Array = NDArray[np.float64]
ENOUGH = 20  # windows: fewer say nothing
FALL = 0.15  # share by which a fall may differ from gravity
STRAIGHT = 0.98  # cosine between a fall and gravity from which on it is straight down
ALIKE = 0.6  # share of straight falls that have one acceleration, where it is that of a fall
AXIS = 0.97  # cosine between a fall and gravity below which the axes are others
SCALES = {1e3: "millimetres", 1e2: "centimetres", 39.37: "inches", 3.281: "feet"}
LARGE = 10.0  # [m]
WRONG, OTHER = -0.3, 0.6  # correlation of forces with accelerations: of the wrong sign, of other axes
RATIO = (0.02, 20.0)  # of mass times acceleration over force
SHARE = 0.1  # of frames, from which on it is no accident
FLOAT = 0.02  # share of the smallest edge by which a lying body may seem to float or sink
DEEP = 0.05  # share of the smallest edge that a body may sink in
ORDERS: dict[str, Callable[[Array], Array]] = {
    "order: wxyz (w stands first)": lambda q: q[..., [1, 2, 3, 0]],
    "the inverse rotations (world to body)": lambda q: q * [-1, -1, -1, 1],
    "wxyz of the inverse rotations": lambda q: q[..., [1, 2, 3, 0]] * [-1, -1, -1, 1],
}


def sizes(seen: Evidence) -> Finding | None:
    """Sizes that are not in metres."""
    k, edge = seen.kinematics, float(seen.scene.sizes.max())
    speed = np.linalg.norm(k.velocity, axis=1)
    if len(speed) and edge > LARGE and float(speed.max()) < edge:
        return Finding(
            f"a body of {edge:g} m moves at {np.median(speed):.3g} m/s: sizes seem to be in millimetres",
            "write the full edges in metres into recording.yaml",
        )
    return None


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
        up = f"{'-' if mean[axis] > 0 else ''}{'xyz'[axis]}"
        return Finding(
            f"bodies fall along {_vector(mean)} m/s^2, gravity is {_vector(gravity)}: up seems to be {up}",
            f"import with the axes of the log (axes={_preset(up)}), or correct gravity in recording.yaml",
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
    if not alike or any(abs(share / scale - 1) < FALL for scale in (1.0, *SCALES)):
        return None
    factor = share**0.5
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


def lying(seen: Evidence) -> Finding | None:
    """Bodies that slide along gravity: another axis is up."""
    if not seen.weight.any():
        return None
    k, gravity = seen.kinematics, seen.weight / np.linalg.norm(seen.weight)
    place = np.concatenate([one.pose[..., :3][one.seen] for one in seen.recordings if one.pose is not None])
    spread = place.std(0)
    along = float(np.abs(spread @ np.abs(gravity)))
    least = int(spread.argmin())
    edge = float(seen.scene.sizes.min())
    size = np.linalg.norm(k.acceleration, axis=1)
    falling = np.mean(np.abs(size / np.linalg.norm(seen.weight) - 1) < 2 * FALL) if len(size) else 0.0
    tilted = abs(float(gravity @ np.array(seen.scene.ground.normal))) < 0.999
    if tilted or abs(gravity[least]) > 0.5 or falling > 0.02 or along < edge or spread[least] > 0.1 * along:
        return None
    return Finding(
        f"bodies move {along:.3g} m (standard deviation) along gravity without ever falling, and only "
        f"{spread[least]:.2g} m along {'xyz'[least]}: up seems to be {'xyz'[least]}",
        f"import with the axes of the log (axes={_preset('xyz'[least])})",
    )


def orders(seen: Evidence) -> Finding | None:
    """Orientations that sink bodies into the ground, where another order of the quaternion does not."""
    edge = float(seen.scene.sizes.min())

    def depth(change: Callable[[Array], Array]) -> float:
        worst = []
        for one in seen.recordings:
            assert one.pose is not None
            for body in range(one.pose.shape[1]):
                pose = one.pose[one.seen[:, body], body]
                pose = np.concatenate([pose[:, :3], change(pose[:, 3:])], 1)
                worst.append(np.maximum(-lowest_corner(pose, seen.scene, body), 0))
        return float(np.quantile(np.concatenate(worst), 0.9))

    now = depth(lambda q: q)
    if now < DEEP * edge + 3 * seen.noise.position:
        return None
    found = {name: depth(change) for name, change in ORDERS.items()}
    best = min(found, key=lambda name: found[name])
    if found[best] < 0.2 * now:
        return Finding(
            f"bodies sink {1000 * now:.3g} mm into the ground; with {best} it would be {1000 * found[best]:.2g} mm",
            f"import with {best}",
        )
    return None


def heights(seen: Evidence) -> Finding | None:
    """Bodies that lie still above or below the ground."""
    k = seen.kinematics
    if np.count_nonzero(seen.still) < ENOUGH:
        return None
    edge = float(seen.scene.sizes.min())
    lying = k.height[seen.still & (np.abs(k.height) < edge)]
    if len(lying) < ENOUGH:
        return None
    height = float(np.median(lying))
    if abs(height) < FLOAT * edge + seen.noise.position:
        return None
    where = "above" if height > 0 else "below"
    return Finding(
        f"bodies lie still with their lowest corner {1000 * abs(height):.3g} mm {where} the ground",
        "check ground.offset, size, and whether the tracked point is the centre (tracked_point)",
        wrong=abs(height) > 5 * FLOAT * edge,
    )


def forces(seen: Evidence) -> Finding | None:
    """Forces on the wrong side, in other axes, or of another size than the accelerations."""
    k = seen.kinematics
    normal = np.array(seen.scene.ground.normal)
    along = np.eye(3) - np.outer(normal, normal)
    chosen = seen.smooth & ~seen.still & ~seen.unforced
    if np.count_nonzero(chosen) < ENOUGH:
        return None
    push = (k.force[chosen] / seen.masses[chosen][:, None]) @ along
    # The mean acceleration of a body is gravity's and friction's; what follows the force is what is left.
    pull = (k.acceleration[chosen] - seen.weight) @ along
    sizes = float(np.sqrt(np.square(push).sum() * np.square(pull).sum()))
    if not sizes:
        return None
    match = float((push * pull).sum()) / sizes
    if match < WRONG:
        return Finding(
            f"accelerations point against the forces (correlation {match:.2f}): they seem to be those on the other "
            "body, or the sensor's reaction",
            "import with the other sign: force=[-fx, -fy, -fz]",
        )
    cross = push.T @ pull / sizes
    best, value = _best_axes(cross)
    if value > OTHER and value > match + 0.3:
        return Finding(
            f"forces do not follow accelerations (correlation {match:.2f}), but {best} would (correlation {value:.2f})",
            f"import forces as force=[{best}], in the axes of the poses",
        )
    mirrored = _mirrored(push, pull)
    if mirrored is not None:
        return mirrored
    ratio = float((push * pull).sum() / np.square(push).sum())
    if match > OTHER and not RATIO[0] < ratio < RATIO[1]:
        return Finding(
            f"mass times acceleration is {ratio:.3g} of the force: one of them is in another unit",
            "check units.force (N, mN, kN) and the mass (kg)",
        )
    return None


def _mirrored(push: Array, pull: Array) -> Finding | None:
    """Accelerations that point against the forces along one axis alone."""
    share = np.square(push).sum(0) / np.square(push).sum()
    sizes = np.sqrt(np.square(push).sum(0) * np.square(pull).sum(0))
    match = (push * pull).sum(0) / np.where(sizes > 0, sizes, 1.0)
    axes = np.flatnonzero((share > SHARE) & (match < WRONG))
    if len(axes) != 1:
        return None
    axis = int(axes[0])
    words = ", ".join(f"{'-' if each == axis else ''}f{'xyz'[each]}" for each in range(3))
    return Finding(
        f"along {'xyz'[axis]} accelerations point against the forces (correlation {match[axis]:.2f}), along others "
        "with them: poses or forces are in a left-handed frame",
        f"import with the axes of the log (axes=left-handed-z-up, left-handed-y-up), or force=[{words}] if only these "
        "are mirrored",
    )


def _best_axes(cross: Array) -> tuple[str, float]:
    """Return the signed permutation of force axes that goes best with the accelerations."""
    found: list[tuple[float, str]] = []
    for order in permutations(range(3)):
        for signs in product((1, -1), repeat=3):
            value = sum(sign * cross[axis, row] for row, (axis, sign) in enumerate(zip(order, signs, strict=True)))
            words = ", ".join(
                f"{'-' if sign < 0 else ''}f{'xyz'[axis]}" for axis, sign in zip(order, signs, strict=True)
            )
            found.append((float(value), words))
    value, words = max(found, key=lambda one: (round(one[0], 9), -one[1].count("-")))
    return words, value


def _vector(value: Array) -> str:
    """Write a vector."""
    return f"({', '.join(f'{one:.2f}' for one in value)})"


def _preset(up: str) -> str:
    """Return the name of the frame in which an axis is up."""
    return {"y": "y-up", "x": "x-up", "-z": "z-down", "-y": "y-down"}.get(up, "x -z y")
