"""Energy that comes from nowhere."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physid.inspection.evidence import Evidence
from physid.inspection.finding import Finding

GAIN = 0.2  # share of the largest energy of a trajectory that noise and rotation may seem to add
SHARE = 0.2  # of trajectories, from which on it is no accident
FACTORS = (0.1, 0.25, 0.5, 2.0, 4.0, 10.0)  # of the first guess of a mass, which are tried
AWAY = 5  # windows that one bad frame is to count little among
NOISES = 10.0  # times the energy of the noise alone, below which a motion is not judged


def energy(seen: Evidence) -> Finding | None:
    """Translational energy that grows by more than gravity and the forces give.

    E = m v^2 / 2 - m g x changes by the work of the commanded forces, and contact only takes. What spins may give to
    what flies, so that only gains of many windows count; bodies that push each other are left out. A mass that is
    unknown is a guess: energy comes from nowhere if it does for each that is tried.
    """
    if len(seen.scene.bodies) > 1:
        return None
    (body,) = seen.scene.bodies
    guessed = f"{body.name}.mass" in seen.scene.unknown
    gained = _gains(seen, body.mass)
    if _few(gained) or (guessed and any(_few(_gains(seen, factor * body.mass)) for factor in FACTORS)):
        return None
    return Finding(
        f"in {int(np.sum(gained > GAIN))} of {len(gained)} trajectories energy comes from nowhere: up to "
        f"{100 * gained.max():.0f} % of what there is, beyond gravity and the work of the forces",
        f"are forces missing, too small (units.force), or late; {'is' if guessed else 'are mass and'} gravity "
        "right; does a hand push?",
        wrong=not seen.kinematics.force.any(),  # with forces it may be their measure; without, something pushed
    )


def _few(gained: NDArray[np.float64]) -> bool:
    """Return whether trajectories gain energy by accident at most."""
    return not len(gained) or bool(np.mean(gained > GAIN) < SHARE)


def _gains(seen: Evidence, mass: float) -> NDArray[np.float64]:
    """Return what the energy of each trajectory of a body of such a mass gains, relative to the largest part of it."""
    k, gained = seen.kinematics, []
    heavy = float(np.linalg.norm(seen.weight))
    unseen = max(NOISES * mass * (0.5 * seen.slowest**2 + heavy * seen.noise.position), np.finfo(float).tiny)
    for trajectory in np.unique(k.trajectory):
        here = k.trajectory == trajectory
        one, smooth = k.of(here), seen.smooth[here]
        if smooth.sum() < 4 * AWAY:
            continue
        recording = seen.recordings[int(trajectory)]
        assert recording.pose is not None
        place = recording.pose[one.frame, 0, :3]
        kinetic, potential = 0.5 * mass * np.square(one.velocity).sum(1), -mass * place @ seen.weight
        between = 0.5 * (one.force[1:] + one.force[:-1])
        work = np.append(0.0, np.cumsum((between * np.diff(place, axis=0)).sum(1)))
        free = (kinetic + potential - work)[smooth]  # a window with an impact in it has no velocity
        # Medians over some windows, so that one bad frame counts little.
        calm = np.median(np.lib.stride_tricks.sliding_window_view(free, AWAY), 1)
        rise = float((calm - np.minimum.accumulate(calm)).max())
        scale = max(float(np.ptp(part[smooth])) for part in (kinetic, potential, work))
        gained.append(rise / max(scale, unseen))
    return np.array(gained)


def energy_over_time(seen: Evidence) -> str:
    """Say how the translational energy of the bodies goes from the beginning of a trajectory to its end."""
    k, ground = seen.kinematics, np.array(seen.scene.ground.normal) * seen.scene.ground.offset
    poses = [one.pose for one in seen.recordings if one.pose is not None]
    place = np.array([poses[t][f, b, :3] for t, f, b in zip(k.trajectory, k.frame, k.body, strict=True)])
    whole = seen.masses * (0.5 * np.square(k.velocity).sum(1) - (place - ground) @ seen.weight)
    first, most, last = list[float](), list[float](), list[float]()
    for trajectory in np.unique(k.trajectory):
        one = k.trajectory == trajectory
        # All bodies together, at the moments at which all of them have a window.
        frames, moment, bodies = np.unique(k.frame[one], return_inverse=True, return_counts=True)
        total = np.bincount(moment, whole[one], len(frames))[bodies == bodies.max()]
        first.append(float(total[0]))
        most.append(float(total.max()))
        last.append(float(total[-1]))
    low, high = np.median(first), np.median(last)
    return f"{low:.3g} J at the beginning, {high:.3g} J at the end (medians, without spin), at most {max(most):.3g} J"
