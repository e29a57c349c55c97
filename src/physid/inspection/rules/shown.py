"""Which unknown parameters recordings can show at all: what shows them has to happen."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physid.inspection.evidence import Evidence
from physid.inspection.finding import Finding
from physid.inspection.rules.ground import adrift, heights

SLIDING = 0.03  # [m/s] along the ground, from which on a body that touches it slides
HITTING = 0.1  # [m/s] towards the ground, from which on a body that touches it later hits it
FEWEST = 3  # frames
HAPPENS = {"friction": "slides", "mass": "is pushed", "restitution": "falls and lands"}
WANTED = {
    "friction": "let it slide on the ground",
    "mass": "push it with known forces",
    "restitution": "let it fall, and bounce",
}


def shown(seen: Evidence) -> str:
    """Say in how many of the frames that happens which shows an unknown parameter; bodies show each other's."""
    parts = []
    if len(seen.scene.bodies) > 1:
        return ", ".join(seen.scene.unknown)
    for name in seen.scene.unknown:
        body, parameter = seen.scene.locate(name)
        share = _frames(seen, body, parameter).sum() / max(int((seen.kinematics.body == body).sum()), 1)
        parts.append(f"{name} ({HAPPENS[parameter]} in {100 * share:.0f} % of the frames)")
    return ", ".join(parts) or "nothing is unknown"


def hidden(seen: Evidence) -> Finding | None:
    """Unknown parameters that nothing shows, unless it is how poses were imported that hides it."""
    if len(seen.scene.bodies) > 1:
        return None  # bodies show each other's
    floats = heights(seen) is not None or adrift(seen) is not None
    for name in seen.scene.unknown:
        body, parameter = seen.scene.locate(name)
        count = int(_frames(seen, body, parameter).sum())
        if count < FEWEST and parameter == "mass" and (faint := _faint_forces(seen, body)):
            return faint
        if count < FEWEST and not (floats and parameter != "mass"):
            return Finding(
                f"{name} is unknown, and {seen.scene.bodies[body].name} {HAPPENS[parameter]} in {count} frames: "
                "nothing shows it",
                f"{WANTED[parameter]}, or take {name} out of unknown (recording.yaml)",
            )
    return None


def _faint_forces(seen: Evidence, body: int) -> Finding | None:
    """Forces that are there, but far too small beside the weight of a body to move it."""
    k = seen.kinematics
    own = k.body == body
    largest = float(np.linalg.norm(k.force[own], axis=1).max(initial=0.0))
    weight = float(np.linalg.norm(seen.weight)) * seen.scene.bodies[body].mass
    if not largest:
        return None
    name = seen.scene.bodies[body].name
    return Finding(
        f"forces on {name} are {largest:.2g} N at most, {100 * largest / weight:.2g} % of its weight: too small to "
        f"show {name}.mass",
        "check units.force (N, mN, kN) and the mass (kg); or push harder",
    )


def _frames(seen: Evidence, body: int, parameter: str) -> NDArray[np.bool_]:
    """Return the windows of a body in which something happens that shows a parameter, shape (n,)."""
    k, normal = seen.kinematics, np.array(seen.scene.ground.normal)
    own, down = k.body == body, -(k.velocity @ normal)
    along = np.linalg.norm(k.velocity + down[:, None] * normal, axis=1)
    if parameter == "friction":
        return np.asarray(own & seen.touching & (along > max(SLIDING, seen.slowest)))
    if parameter == "mass":
        return np.asarray(own & ~seen.unforced)
    lands = np.isin(k.trajectory, k.trajectory[own & seen.touching])
    return np.asarray(own & lands & (down > max(HITTING, seen.slowest)))
