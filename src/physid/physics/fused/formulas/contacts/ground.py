"""A box on the ground."""

from __future__ import annotations

from functools import reduce
from itertools import product

from physid.compiler.graph import Value, most, root, total, where
from physid.compiler.section import Record
from physid.physics.fused.formulas.algebra import add, apply, dot, rows, scale, transpose
from physid.physics.fused.formulas.contacts.touch import Material, Touch, write_patch
from physid.physics.schemes.impact import BRIEF

NO_GROUND = -1e300
"""A ground lower than this is none [m]."""

CORNERS = tuple(product((-1.0, 1.0), repeat=3))


def choose_corners(body: Record, shared: Record, patch: Record) -> None:
    """Write the signs of the four lowest corners, from the lowest up."""
    downwards = apply(transpose(rows(body["axes"])), shared["ground_normal"])
    reach = [0.5 * m * s for m, s in zip(downwards, body["size"], strict=True)]
    heights = [total([sign * r for sign, r in zip(signs, reach, strict=True)]) for signs in CORNERS]
    zero = heights[0].graph.constant(0.0)
    ranks = [zero] * 8
    for j in range(8):
        for i in range(j):
            later = heights[j] < heights[i]
            ranks[i] = ranks[i] + where(later, 1.0, 0.0)
            ranks[j] = ranks[j] + where(later, 0.0, 1.0)
    signs: list[Value] = []
    for k in range(4):
        here = [rank.equals(float(k)) for rank in ranks]
        for axis in range(3):
            positive = [mask for mask, corner in zip(here, CORNERS, strict=True) if corner[axis] > 0]
            signs.append(where((positive[0] | positive[1]) | (positive[2] | positive[3]), 1.0, -1.0))
    patch["choice"] = [*signs, *[0.0] * (29 - len(signs))]
    patch["label"] = [total([2.0**axis * s for axis, s in enumerate(signs[3 * k : 3 * k + 3])]) for k in range(4)]


def touch_ground(
    body: Record, shared: Record, constants: Record, patch: Record, *beside: Record, midpoint: bool = False
) -> None:
    """Write the patch of the four lowest corners of a box and the ground, given those `beside` it, with other boxes.

    Also written is the momentum of the box, with what friction gives before another one strikes.
    """
    axes, half, (ground,) = rows(body["axes"]), scale(0.5, body["size"]), shared["ground_offset"]
    points = []
    for k in range(4):
        signs = patch["choice"][3 * k : 3 * k + 3]
        points.append(add(body["pose"][:3], apply(axes, [s * h for s, h in zip(signs, half, strict=True)])))
    h = constants.one("step")
    yields = body.one("compliance")
    time = root(yields * body.one("mass") + BRIEF**2) - BRIEF
    correction = h / (h / constants.one("correction") + time)
    compliance = yields * correction * shared.one("mean_mass") / (h * h)
    touch = Touch(
        points=points,
        gaps=[dot(point, shared["ground_normal"]) - ground for point in points],
        normal=shared["ground_normal"],
        active=[ground > NO_GROUND] * 4,
        scale=reduce(most, body["size"]),
    )
    material = Material(
        friction=body.one("friction") * body.one("ground_friction"),
        restitution=most(body.one("restitution") + body.one("ground_restitution"), 0.0),
        compliance=compliance,
        correction=correction,
    )
    write_patch(patch, constants, touch, material, [body], midpoint=midpoint, beside=beside)
    patch["other_arm"], patch["lever"] = [0.0] * 12, [0.0] * 4
