"""Forces that accelerations do not follow: of another sign, in other axes, of another unit, on another clock."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from physid.data.importers.units import UNITS
from physid.inspection.evidence import STILL, Evidence
from physid.inspection.finding import Finding
from physid.inspection.rules.clocks import beside, delay
from physid.inspection.rules.falls import ENOUGH
from physid.scenes.rotations import rotate

Array = NDArray[np.float64]
MIRROR = (
    "; that mirrors them: if the positions are what was exchanged, turn these (position) and not the forces, for "
    "quaternions and torques would stay as they are"
)
WRONG, OTHER = -0.3, 0.6  # correlation of forces with accelerations: of the wrong sign, of other axes
RATIO = (0.02, 20.0)  # of mass times acceleration over force, whatever the mass, which may be a first guess
GUESS = 5.0  # factor by which a first guess of a mass, and friction beside the force, may be off
KNOWN = (0.5, 2.0)  # the same where masses are known: 2 is a clock that is off by a factor of 1.4
SHARE = 0.1  # of the squared force along an axis, from which on accelerations along it say something
SAME_UNIT = 0.05  # share by which a factor may differ from that of a unit of force
PUSHED = 0.2  # share of the largest force of a trajectory, from which on it is clearly pushed
CLOSE = 1.15  # factor by which a size may be off from that of a unit, and be of this one and of no other
ODD = 4.0  # factor by which forces of one trajectory may differ from those of the others; a fit sees smaller ones
OTHERS = 0.7  # share of trajectories, in which accelerations follow the forces as usual, from which on others are odd
MOST_NAMED = 5
CLEAR = 0.5  # quantile of the forces from which on a body is clearly pushed


def forces(seen: Evidence) -> Finding | None:
    """Forces on the wrong side, in other axes, or of another size than the accelerations."""
    k = seen.kinematics
    normal = np.array(seen.scene.ground.normal)
    along = np.eye(3) - np.outer(normal, normal)
    chosen = seen.smooth & ~seen.still & ~seen.unforced
    if np.count_nonzero(chosen) < ENOUGH:
        return None
    push, pull = along_the_ground(seen, chosen)
    sizes = float(np.sqrt(np.square(push).sum() * np.square(pull).sum()))
    if not sizes:
        return None
    match = float((push * pull).sum()) / sizes
    if match < WRONG and delay(seen) is None:
        return Finding(
            f"accelerations point against the forces (correlation {match:.2f}): they seem to be those on the other "
            "body, or the sensor's reaction",
            f"import with the other sign: {seen.origin.forces(-np.eye(3))}",
        )
    cross = push.T @ pull / sizes
    best, value = _best_axes(cross)
    if value > OTHER and value > match + 0.3:
        return Finding(
            f"forces do not follow accelerations (correlation {match:.2f}), but in other axes they would "
            f"(correlation {value:.2f})",
            f"import forces as {seen.origin.forces(best)}, in the axes of the poses"
            + (MIRROR if np.linalg.det(best) < 0 else ""),
        )
    turning = _in_body_axes(seen, chosen, pull, along)
    if turning > OTHER and turning > match + 0.3:
        return Finding(
            f"forces do not follow accelerations (correlation {match:.2f}), but turned with the body they would "
            f"(correlation {turning:.2f}): they seem to be in the body's own axes, as of a sensor that turns with it",
            "import with forces.axes=body",
        )
    mirrored = _mirrored(seen, push, pull)
    if mirrored is not None:
        return mirrored
    ratio = float((push * pull).sum() / np.square(push).sum())
    if match > OTHER and not RATIO[0] < ratio < RATIO[1]:
        return _other_unit(ratio, seen.origin.newtons)
    odd = _odd_forces(seen, along)
    if odd is not None or match <= OTHER:
        return odd
    return _known_mass(seen, push, pull, _directions(k.velocity[chosen] @ along))


def along_the_ground(seen: Evidence, chosen: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Return the accelerations that forces would give chosen windows, and theirs, along the ground, (n, 3) each.

    The mean acceleration of a body is gravity's and friction's; what follows the force is what is left.
    """
    k, normal = seen.kinematics, np.array(seen.scene.ground.normal)
    along = np.eye(3) - np.outer(normal, normal)
    push = (k.force[chosen] / seen.masses[chosen][:, None]) @ along
    return push, (k.acceleration[chosen] - seen.weight) @ along


def _odd_forces(seen: Evidence, along: Array) -> Finding | None:
    """Few trajectories with other forces (see `odd_trajectories`), which may be as good as none beside the weight."""
    k = seen.kinematics
    size, largest = np.linalg.norm(k.force, axis=1), np.zeros(len(seen.recordings))
    np.maximum.at(largest, k.trajectory, size)
    chosen = seen.smooth & ~seen.still & (size > PUSHED * largest[k.trajectory])
    (push, pull), way = along_the_ground(seen, chosen), _directions(k.velocity[chosen] @ along)
    return odd_trajectories(seen, "force", push, pull, way, k.trajectory[chosen])


def odd_trajectories(
    seen: Evidence, kind: str, push: Array, pull: Array, way: Array, trajectory: NDArray[np.int64]
) -> Finding | None:
    """Few trajectories whose forces, or torques, are of another sign or another unit than those of the others.

    In each, accelerations are s times what pushes give, less friction along the way of the motion. Sets in which bodies
    push each other are left out. In 180 sets of four sealed banks and 70 others none is named without such a
    mistake.

    Args:
        seen: The recordings.
        kind: Of which quantity: force or torque.
        push: Accelerations that forces or torques would give, shape (n, D).
        pull: Accelerations, same shape.
        way: Unit vectors along the motion, same shape.
        trajectory: Which one each window is of, shape (n,).
    """
    if len(seen.scene.bodies) > 1:
        return None
    found: dict[int, tuple[float, float]] = {}
    for one in np.unique(trajectory):
        here = trajectory == one
        if np.count_nonzero(here) >= ENOUGH:
            parts = np.stack([each[here].ravel() for each in (push, pull, way)])
            slope, match = beside((parts @ parts.T)[None])
            found[int(one)] = float(slope[0]), float(match[0])
    following = {one: slope for one, (slope, match) in found.items() if match > OTHER}
    if len(following) < OTHERS * len(found) or not following:
        return None
    middle = float(np.median(list(following.values())))
    against = [one for one, (_, match) in found.items() if match < WRONG]
    factors = {one: slope / middle for one, slope in following.items()}
    larger = {one: factor for one, factor in factors.items() if factor >= ODD}
    smaller = {one: factor for one, factor in factors.items() if factor <= 1 / ODD}
    if len({*against, *larger, *smaller}) > (1 - OTHERS) * len(found):
        return None
    if against:
        doing = "turn against the torques" if kind == "torque" else "accelerate against the forces"
        return Finding(
            f"in {_alone(seen, against)} bodies {doing}: they have the other sign, or poses are in another frame",
            "correct these, or leave them out",
        )
    odd = max(larger, smaller, key=len)
    if not odd:
        return None
    factor, what = float(np.median(list(odd.values()))), "mass times acceleration"
    if kind == "torque":
        what = "inertia times angular acceleration"
    taken = seen.origin.newton_metres if kind == "torque" else seen.origin.newtons
    unit = nearest_unit(kind, factor * taken, taken)
    return Finding(
        f"in {_alone(seen, list(odd))} {what} is {factor:.2g} times as much beside the {kind} as in the others: "
        + (f"{kind}s seem to be in {unit}" if unit else f"these {kind}s, or this body, are others"),
        "correct these, or leave them out",
    )


def _alone(seen: Evidence, which: Sequence[int]) -> str:
    """Name trajectories."""
    numbers = [str(seen.indices[one]) for one in sorted(which)]
    more = f" and {len(numbers) - MOST_NAMED} more" if len(numbers) > MOST_NAMED else ""
    return f"trajector{'ies' if len(numbers) > 1 else 'y'} {', '.join(numbers[:MOST_NAMED])}{more} alone"


def nearest_unit(kind: str, size: float, taken: float) -> str | None:
    """Return the unit of a quantity that has a size in SI, which may be off by a factor of `GUESS`; None without any.

    Of several that are as likely it is the most usual; never the one that the log's was taken for, of the size `taken`.
    """
    away = {unit: abs(math.log(size / one)) for unit, one in UNITS[kind].items() if one != taken}
    nearest = min(away, key=lambda one: away[one])
    if away[nearest] < math.log(CLOSE):
        return nearest
    usual = [unit for unit, distance in away.items() if distance < math.log(GUESS) / 2]
    return (usual or [nearest])[0] if away[nearest] < math.log(GUESS) else None


def _directions(speed: Array) -> Array:
    """Return velocities (n, 3) as unit vectors; shorter ones where a body hardly moves."""
    return np.asarray(speed / np.maximum(np.linalg.norm(speed, axis=1, keepdims=True), STILL))


def _in_body_axes(seen: Evidence, chosen: NDArray[np.bool_], pull: Array, along: Array) -> float:
    """Return the correlation of accelerations along the ground with forces as if these were in the body's axes."""
    k = seen.kinematics.of(chosen)
    turn = np.full((len(k.frame), 4), np.nan)
    for trajectory in np.unique(k.trajectory):
        here, pose = k.trajectory == trajectory, seen.recordings[int(trajectory)].pose
        if pose is not None:
            turn[here] = pose[k.frame[here], k.body[here], 3:]
    push = rotate(turn, k.force) / seen.masses[chosen][:, None] @ along
    known = np.isfinite(push).all(1)
    sizes = float(np.sqrt(np.square(push[known]).sum() * np.square(pull[known]).sum()))
    return float((push[known] * pull[known]).sum()) / sizes if sizes else 0.0


def _other_unit(ratio: float, taken: float) -> Finding:
    """Name the unit of the log's forces that explains mass times acceleration over force, as masses are known roughly.

    Args:
        ratio: Mass times acceleration over force.
        taken: What one of the log's unit was taken for [N].
    """
    fitting = [unit for unit, newtons in UNITS["force"].items() if 1 / GUESS < ratio * taken / newtons < GUESS]
    unit = fitting[0] if len(fitting) == 1 else None
    return Finding(
        f"mass times acceleration is {ratio:.3g} of the force: "
        + (f"forces seem to be in {unit}" if unit else "one of them is in another unit")
        + (", or masses in grams" if ratio > 1 else ""),
        (f"import with units.force={unit}; or " if unit else "") + "check units.force (N, mN, kN) and the mass (kg)",
    )


def _mirrored(seen: Evidence, push: Array, pull: Array) -> Finding | None:
    """Accelerations that point against the forces along one axis alone."""
    share = np.square(push).sum(0) / np.square(push).sum()
    sizes = np.sqrt(np.square(push).sum(0) * np.square(pull).sum(0))
    match = (push * pull).sum(0) / np.where(sizes > 0, sizes, 1.0)
    pushed = share > SHARE
    axes = np.flatnonzero(pushed & (match < WRONG))
    with_them = pushed & (match > OTHER)
    if len(axes) != 1 or not with_them.any() or (pushed & ~with_them).sum() > 1:
        return None
    axis = int(axes[0])
    other = seen.origin.forces(np.diag([-1.0 if each == axis else 1.0 for each in range(3)]))
    return Finding(
        f"along {'xyz'[axis]} accelerations point against the forces (correlation {match[axis]:.2f}), along others "
        "with them: poses or forces are in a left-handed frame",
        f"import with the axes of the log (axes=left-handed-z-up, left-handed-y-up), or {other} if only these are "
        "mirrored",
    )


def _best_axes(cross: Array) -> tuple[Array, float]:
    """Return the signed permutation of force axes that goes best with the accelerations."""
    found: list[tuple[float, int, Array]] = []
    for order in permutations(range(3)):
        for signs in product((1, -1), repeat=3):
            change = np.zeros((3, 3))
            change[range(3), order] = signs
            found.append((round(float((change * cross.T).sum()), 9), -signs.count(-1), change))
    value, _, change = max(found, key=lambda one: one[:2])
    return change, value


def _known_mass(seen: Evidence, push: Array, pull: Array, way: Array) -> Finding | None:
    """Masses that are known, times accelerations, against the forces on bodies that are clearly pushed.

    a = s F / m - c v / |v|: friction is taken out. A clock that runs k times too fast makes s = k^2.
    """
    if seen.guesses_masses:
        return None
    size = np.linalg.norm(push, axis=1)
    clear = size >= np.quantile(size, CLEAR)
    both = np.stack([push[clear].ravel(), way[clear].ravel()], 1)
    slope = float(np.linalg.lstsq(both, pull[clear].ravel(), rcond=None)[0][0])
    if slope <= 0 or KNOWN[0] < slope < KNOWN[1]:
        return None
    factor, rate, taken = slope**0.5, 1 / seen.scene.time_step, seen.origin.newtons
    for unit, newtons in UNITS["force"].items():
        if newtons != taken and abs(slope * taken / newtons - 1) < SAME_UNIT:
            return Finding(
                f"mass times acceleration is {slope:.3g} of the force, and masses are known: forces seem to be in "
                f"{unit}",
                f"import with units.force={unit}; or check the mass, and the rate ({rate / factor:.4g} would fit)",
            )
    return Finding(
        f"mass times acceleration is {slope:.3g} of the force, and masses are known: the frame rate seems to be "
        f"{factor:.3g} times the true one, or the mass, or the unit of the forces, is another",
        f"import with the rate at which it was recorded (rate={rate / factor:.4g} would fit), or check mass and "
        "units.force; if the mass is a first guess, say so: unknown=[BODY.mass]",
    )
