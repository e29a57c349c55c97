"""Torques that angular accelerations do not follow: of another sign, as of inverse rotations, or in another unit."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physid.inspection.evidence import Evidence
from physid.inspection.finding import Finding
from physid.inspection.rules.clocks import FEW, beside
from physid.inspection.rules.falls import ENOUGH
from physid.inspection.rules.forces import (
    GUESS,
    OTHER,
    RATIO,
    WRONG,
    along_the_ground,
    forces,
    nearest_unit,
    odd_trajectories,
)
from physid.inspection.rules.sizes import masses
from physid.scenes.rotations import conjugate, rotate

Array = NDArray[np.float64]
FLAT = 0.02  # [rad] beside noise, by which a body may lean within a window, and still turn about the normal alone
NOISES = 4.0  # deviations of the noise of a rotation, the same
SURE = 4.0  # standard deviations of the correlation, as a jackknife over trajectories knows them


def forces_and_torques(seen: Evidence) -> Finding | None:
    """What is wrong with the forces (see `forces`); where nothing is, with the torques."""
    return forces(seen) or torques(seen)


def torques(seen: Evidence) -> Finding | None:
    """Angular accelerations about the ground's normal, of bodies that slide, against the torques about it.

    a = s t / J - c w / |w|: friction, which opposes the turning, is taken out of both sides. Where a mass is unknown, a
    torque's unit is judged beside that of the forces: both give a mass.

    In 20 sets of four sealed banks and 25 of pushes by closed forms that have such moments and no mistake, the
    correlation is -0.02 (21 windows) to 0.92, and s 0.4 to 1.75 where it is above 0.6.
    """
    k, normal = seen.kinematics, np.array(seen.scene.ground.normal)
    torque, turning = k.torque @ normal, k.spin @ normal
    slowest = NOISES * seen.noise.rotation / seen.scene.time_step / seen.kinematics_window
    flat = k.lean < FLAT + NOISES * seen.noise.rotation
    chosen = seen.smooth & seen.touching & flat & (torque != 0) & (np.abs(turning) > slowest)
    if np.count_nonzero(chosen) < ENOUGH or len(np.unique(k.trajectory[chosen])) < FEW:
        return None
    push, pull = torque[chosen] / _inertia(seen)[chosen], (k.angular @ normal)[chosen]
    slope, match, deviation = _beside_friction(push, pull, np.sign(turning[chosen]), k.trajectory[chosen])
    if match < WRONG and -match > SURE * deviation:
        return Finding(
            f"bodies turn against the torques (correlation {match:.2f}): quaternions seem to be the inverse rotations "
            "(world to body), or torques have the other sign",
            f"import with {seen.origin.inverse()}; or with the other sign of the torque",
        )
    of_forces = _of_forces(seen)
    ratio = slope / (of_forces or 1.0)
    if masses(seen):
        return None
    low, high = RATIO if of_forces is None and seen.guesses_masses else (1 / GUESS, GUESS)
    if match < OTHER or low < ratio < high:
        way = np.sign(turning[chosen])
        return odd_trajectories(seen, "torque", push, pull, way, k.trajectory[chosen])
    metres, newtons = seen.origin.newton_metres, seen.origin.newtons
    unit = nearest_unit("torque", ratio * metres, metres)
    other = nearest_unit("force", newtons / ratio, newtons) if of_forces else None
    return Finding(
        f"inertia times angular acceleration is {ratio:.2g} of the torque"
        + (", with the mass that the forces show" if of_forces else "")
        + f": torques seem to be in {unit or 'another unit'}"
        + (f", or forces in {other}" if other else ""),
        (f"import with units.torque={unit}; or " if unit else "")
        + (f"with units.force={other}; or " if other else "")
        + "check units.torque, size and mass",
    )


def _inertia(seen: Evidence) -> Array:
    """Return the inertia of bodies about the ground's normal n in each window, sum_i J_i n_i^2 in the body's axes."""
    k, found = seen.kinematics, np.ones(len(seen.kinematics.frame))
    normal, moments = np.array(seen.scene.ground.normal), np.array([one.moments() for one in seen.scene.bodies])
    for index, one in enumerate(seen.recordings):
        here = k.trajectory == index
        assert one.pose is not None
        q = one.pose[k.frame[here], k.body[here], 3:]
        found[here] = (moments[k.body[here]] * np.square(rotate(conjugate(q), normal))).sum(1)
    return found


def _beside_friction(push: Array, pull: Array, way: Array, trajectory: NDArray[np.int64]) -> tuple[float, float, float]:
    """Regress accelerations on torques beside the direction of the turning, which friction follows.

    Returns:
        Slope, partial correlation, and its standard deviation by a jackknife over trajectories.
    """
    own = [np.stack([push, pull, way])[:, trajectory == one] for one in np.unique(trajectory)]
    moments = np.array([each @ each.T for each in own])
    slope, match = beside(np.concatenate([moments.sum(0)[None], moments.sum(0) - moments]))
    return float(slope[0]), float(match[0]), float(np.sqrt((len(own) - 1) * np.var(match[1:])))


def _of_forces(seen: Evidence) -> float | None:
    """Return mass times acceleration over force where a mass is unknown and forces say it; else None."""
    chosen = seen.smooth & ~seen.still & ~seen.unforced
    if not seen.guesses_masses or np.count_nonzero(chosen) < ENOUGH:
        return None
    push, pull = along_the_ground(seen, chosen)
    both = float((push * pull).sum())
    return both / float(np.square(push).sum()) if both > 0 else None
