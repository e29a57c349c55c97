"""Motion of the scheme `Midpoint`: to the midpoint, what impacts add there, and on to the end."""

from __future__ import annotations

from collections.abc import Sequence

from physid.compiler.graph import Value, most, root, stop, total, where
from physid.compiler.section import Record
from physid.physics.fused.formulas.algebra import (
    Vector,
    add,
    apply,
    conjugate,
    cross,
    dot,
    exponential,
    invert,
    multiply,
    rotate,
    scale,
    subtract,
    to_matrix,
    transpose,
    unit,
)  # fmt: skip
from physid.physics.fused.formulas.body import symmetric
from physid.physics.fused.formulas.contact_problem.cone import impulse_of
from physid.physics.fused.formulas.contacts.patch import Patch, accumulate
from physid.physics.schemes.impact import LARGEST
from physid.physics.schemes.motion import DIVERGED, NEWTON_STEPS, TANGENT

HALF_TURN = 4
"""Doublings of the angle by which a body turns in half a step (see `exponential`): exact below 16 rad."""


def drift(
    quaternion: Vector, spin: Vector, moments: Sequence[Value], time: Value, gyroscopic: Value
) -> tuple[Vector, Vector]:
    """Turn a body on which nothing acts; return attitude and angular velocity (see `physid.physics.schemes.motion`)."""
    own = rotate(conjugate(quaternion), spin)
    mean, keeps = _mean_spin(own, moments, time), gyroscopic > 0.5
    mean = [where(keeps, new, old) for new, old in zip(mean, own, strict=True)]
    turn = exponential(scale(time, mean), HALF_TURN)
    carried = rotate(conjugate(turn), [m * w for m, w in zip(moments, own, strict=True)])
    after = [where(keeps, x / m, old) for x, m, old in zip(carried, moments, own, strict=True)]
    quaternion = unit(multiply(quaternion, turn))
    return quaternion, rotate(quaternion, after)


def _mean_spin(spin: Vector, moments: Sequence[Value], time: Value) -> Vector:
    """Return the mean angular velocity of a free body in its frame (see `physid.physics.schemes.motion`)."""
    i, j, k = moments
    half, mean = 0.5 * time, list(spin)
    a, b, c = half * (j - k), half * (k - i), half * (i - j)
    square = half * half
    for steps in NEWTON_STEPS:
        x, y, z = mean
        inverse = invert([[i, -(a * z), -(a * y)], [-(b * z), j, -(b * x)], [-(c * y), -(c * x), k]])
        inverse = [[stop(entry) for entry in row] for row in inverse]
        for _ in range(steps):
            x, y, z = mean
            angle = square * dot(mean, mean)
            above, below = (p + angle * (q + angle * (r + angle * s)) for p, q, r, s in TANGENT)
            ratio = above / below
            turned = [a * ratio * (y * z), b * ratio * (z * x), c * ratio * (x * y)]
            error = [m * (w - v) - t for m, w, v, t in zip(moments, mean, spin, turned, strict=True)]
            mean = subtract(mean, apply(inverse, error))
    energy, most_ = (total([m * w * w for m, w in zip(moments, each, strict=True)]) for each in (mean, spin))
    return [where(energy > DIVERGED * most_, old, new) for old, new in zip(spin, mean, strict=True)]


def to_midpoint(body: Record, constants: Record) -> None:
    """Write pose and twist after half the step in which nothing acts."""
    half, quaternion = 0.5 * constants.one("step"), body["start_pose"][3:]
    spin, linear = body["start_twist"][:3], body["start_twist"][3:]
    arm = rotate(quaternion, body["centre_of_mass"])
    linear = add(linear, cross(spin, arm))
    centre = add(add(body["start_pose"][:3], arm), scale(half, linear))
    quaternion, spin = drift(quaternion, spin, body["inertia"], half, constants.one("gyroscopic"))
    arm = rotate(quaternion, body["centre_of_mass"])
    body["pose"] = [*subtract(centre, arm), *quaternion]
    body["twist"] = [*spin, *subtract(linear, cross(spin, arm))]


def to_end(body: Record, shared: Record, constants: Record) -> None:
    """Write pose and twist at the end: what late impulses move at once, and half the step with the new velocity."""
    h, velocity_unit = constants.one("step"), constants.one("unit")
    quaternion, late = body["pose"][3:], body["late"]
    axes = to_matrix(quaternion)
    pushed = apply(transpose(axes), late[:3])
    turned = [x / m for x, m in zip(pushed, body["inertia"], strict=True)]
    mean = shared.one("mean_mass")
    reach = (
        velocity_unit
        * h
        * mean
        * _shortened(body, mean * (dot(pushed, turned) + dot(late[3:], late[3:]) / body.one("mass")))
    )
    moved = scale(reach, [*apply(axes, turned), *scale(1.0 / body.one("mass"), late[3:])])
    after = scale(velocity_unit, body["v"])
    arm = apply(axes, body["centre_of_mass"])
    centre = add(add(body["pose"][:3], arm), add(moved[3:], scale(0.5 * h, after[3:])))
    quaternion = unit(multiply(exponential(moved[:3]), quaternion))
    quaternion, spin = drift(quaternion, after[:3], body["inertia"], 0.5 * h, constants.one("gyroscopic"))
    arm = rotate(quaternion, body["centre_of_mass"])
    body["next_pose"] = [*subtract(centre, arm), *quaternion]
    body["next_twist"] = [*spin, *subtract(after[3:], cross(spin, arm))]


def _shortened(body: Record, moved: Value) -> Value:
    """Return by how much what impacts move at once is shortened (see `physid.physics.schemes.impact.late`)."""
    change, most_share = subtract(body["v"], body["free"]), LARGEST - 0.5
    turning = dot(change[:3], apply(symmetric(body["world_inertia"]), change[:3]))
    allowed = most_share * most_share * (turning + body.one("share") * dot(change[3:], change[3:]))
    far = moved > allowed
    return where(far, root(where(far, allowed, 1.0) / where(far, moved, 1.0)), 1.0)


def note_impact(patch: Record, lane: Record) -> None:
    """Note the worlds with an impact."""
    lane["touches"] = [most(lane.one("touches"), patch.one("hit"))]


def read_impulses(contact: Record, pressed: Record) -> None:
    """Write the impulses of a patch, in units of the solver."""
    pressed["total"] = [value for c in range(4) for value in impulse_of(contact.part("z", c))]


def late(patch: Patch, pressed: Record, bodies: Sequence[Record], *, adds: bool) -> None:
    """Write the impulses of a patch, times W - 1/2, to what moves its bodies at once, or add them."""
    weight = patch.patch.one("share") - 0.5
    terms = [patch.wrenches(c, scale(weight, pressed.part("total", c))) for c in range(4)]
    if adds:
        accumulate(bodies, "late", terms)
        return
    for k, body in enumerate(bodies):
        body["late"] = [total([term[k][i] for term in terms]) for i in range(6)]


def add_impulse_bar(contact: Record, pressed_bar: Record) -> None:
    """Add the derivative by the impulses to what the reverse of the solver starts from."""
    contact["impulse_bar"] = add(contact["impulse_bar"], pressed_bar["total"])
