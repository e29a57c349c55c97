"""Energy that comes from nowhere."""

from __future__ import annotations

import numpy as np

from physid.inspection.evidence import Evidence
from physid.inspection.finding import Finding

GAIN = 0.2  # share of the largest energy of a trajectory that noise and rotation may seem to add
SHARE = 0.2  # of trajectories, from which on it is no accident
AWAY = 5  # windows beside an impact, which parabolas smear


def energy(seen: Evidence) -> Finding | None:
    """Translational energy that grows by more than gravity and the forces give.

    E = m v^2 / 2 - m g x changes by the work of the commanded forces, and contact only takes. What spins may give to
    what flies, so that only gains of many windows count; bodies that push each other are left out.
    """
    k, gained = seen.kinematics, []
    if len(seen.scene.bodies) > 1:
        return None
    for trajectory in np.unique(k.trajectory):
        one = k.of(k.trajectory == trajectory)
        if len(one.frame) < 4 * AWAY:
            continue
        recording, mass = seen.recordings[int(trajectory)], seen.scene.bodies[0].mass
        assert recording.pose is not None
        place = recording.pose[one.frame, 0, :3]
        kinetic, potential = 0.5 * mass * np.square(one.velocity).sum(1), -mass * place @ seen.weight
        between = 0.5 * (one.force[1:] + one.force[:-1])
        work = np.append(0.0, np.cumsum((between * np.diff(place, axis=0)).sum(1)))
        free = kinetic + potential - work
        # Medians over some windows, so that one bad frame counts little.
        calm = np.median(np.lib.stride_tricks.sliding_window_view(free, AWAY), 1)
        rise = float((calm - np.minimum.accumulate(calm)).max())
        scale = max(float(np.ptp(part)) for part in (kinetic, potential, work))
        gained.append(rise / scale if scale > 0 else 0.0)
    if not gained or np.mean(np.array(gained) > GAIN) < SHARE:
        return None
    many = int(np.sum(np.array(gained) > GAIN))
    return Finding(
        f"in {many} of {len(gained)} trajectories energy comes from nowhere: up to {100 * max(gained):.0f} % of what "
        "there is, beyond gravity and the work of the forces",
        "are forces missing, too small (units.force), or late; are mass and gravity right; does a hand push?",
        wrong=not k.force.any(),  # with forces it may be their measure; without, something pushed
    )


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
