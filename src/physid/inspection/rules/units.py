"""Positions in another unit than the sizes, where nothing falls: with the right one, bodies lie on the ground."""

from __future__ import annotations

import numpy as np

from physid.inspection.evidence import Evidence
from physid.inspection.finding import Finding
from physid.inspection.rules.falls import SCALES
from physid.inspection.rules.ground import AWAY, THERE, Carried
from physid.inspection.rules.sizes import FAR

GRIP = 3.0  # g: no friction slows a body on the ground by more; in 225 sets in metres it was 0.23 at most


def positions(seen: Evidence) -> tuple[Finding, Evidence] | None:
    """Positions in another unit.

    Two things have to speak for it: accelerations of more than 3 g that follow no force, which no friction causes, and
    bodies that touch the ground in this unit alone. Either may come about otherwise: by an
    impact, or on a table whose height the set does not know.

    Args:
        seen: The recordings.

    Returns:
        What looks wrong, and the recordings in metres; None where nothing does.
    """
    k, g = seen.kinematics, float(np.linalg.norm(seen.weight))
    if not g or not len(k.frame) or np.mean(seen.touching) > 1 - AWAY or _beyond_forces(seen) < GRIP * g:
        return None
    for scale, unit in SCALES.items():
        if scale < FAR:
            continue
        metres = seen.scaled(1 / scale)
        lying = Carried.of(metres)
        share = 0.0 if lying is None else lying.touching(lying.pose, seen.scene.ground.normal)
        if share >= THERE and _beyond_forces(metres) < GRIP * g:
            finding = Finding(
                f"the lowest corner of bodies is {float(np.median(k.height)):.3g} m over the ground (median), and they "
                f"accelerate by {_beyond_forces(seen):.3g} m/s^2 beyond gravity and the forces; in {unit} they would "
                f"lie on the ground in {100 * share:.0f} % of the moments without a fall: positions seem to be in "
                f"{unit}",
                f"import with the unit of the log (units.position), or divide positions by {scale:g}",
            )
            return finding, metres
    return None


def _beyond_forces(seen: Evidence) -> float:
    """Return how much bodies accelerate along the ground by what no force explains, in whatever unit it is [m/s^2].

    The median over windows of |a - g - s f|, s by least squares, without what noise adds to its square.
    """
    k, normal = seen.kinematics, np.array(seen.scene.ground.normal)
    along = np.eye(3) - np.outer(normal, normal)
    pull, push = (k.acceleration - seen.weight) @ along, k.force @ along
    scale = float((pull * push).sum() / max(float(np.square(push).sum()), np.finfo(float).tiny))
    size = float(np.median(np.square(pull - scale * push).sum(1)))
    return float(np.sqrt(max(size - 2 * seen.acceleration_noise**2, 0.0)))
