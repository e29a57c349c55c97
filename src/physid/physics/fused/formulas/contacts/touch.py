"""What is common to all patches: frame, contact rule, redundant modes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from operator import and_, or_

from physid.compiler.graph import Value, least, most, root, size, total, where
from physid.compiler.section import Record
from physid.physics.contact import FLATNESS, SEVERAL
from physid.physics.contact_problem.rows import FAR, REACH
from physid.physics.fused.formulas.algebra import (
    Matrix,
    Vector,
    add,
    apply,
    cross,
    decay,
    dot,
    scale,
    subtract,
    transpose,
    unit,
)
from physid.physics.fused.formulas.schemes.impact import Contact, demand, slip, stuck
from physid.physics.fused.formulas.schemes.turning import friction_before_impact, share_before_impact, turned, turning
from physid.physics.schemes.turning import NO_IMPACT


def frame_of(normal: Sequence[Value]) -> Matrix:
    """Complete a unit normal to a frame, from the axis that is least along it."""
    x, y, z = (size(component) for component in normal)
    first, second = (x <= y) & (x <= z), y <= z
    axis = [where(first, 1.0, 0.0), where(first, 0.0, where(second, 1.0, 0.0)), where(first | second, 0.0, 1.0)]
    tangent = unit(subtract(axis, scale(dot(axis, normal), normal)))
    return [list(normal), tangent, cross(normal, tangent)]


@dataclass(frozen=True)
class Material:
    """Of what touches: friction, restitution, compliance in units of the solver, and 1 / (1 / c + t / h) of its damper.

    c is the share of a rigid overlap that a step takes back, and t the time of the damper.
    """

    friction: Value
    restitution: Value
    compliance: Value
    correction: Value


def rule(gap: Value, speed: Value, free_speed: Value, material: Material, constants: Record) -> tuple[Value, Value]:
    """Return the offset c of eq. (3) [m/s] and whether the contact exists, by the contact rule of the world."""
    restitution = material.restitution
    h = constants.one("step")
    single = constants.one("single_step")
    several = (single > 0.0) & (h > SEVERAL * single)  # steps of a simulator: contacts begin within this one
    within = several & (gap >= 0.0)
    speculative, split = (constants.one("speculative") > 0.5) | within, (constants.one("split") > 0.5) & ~within
    overlap = constants.one("correction") * gap / h
    apart = where(gap > 0.0, gap / h, most(overlap, -constants.one("speed_limit")))
    hits = (speed < 0.0) & (restitution > 0.0)
    impact = hits & ((gap + h * free_speed < 0.0) | ~speculative)
    reach = REACH + 2.0 * h * size(free_speed)
    exists = (speculative & (gap < reach)) | (~speculative & (gap < 0.0))
    bounce = restitution * speed
    rigid = where(impact, where(split, bounce, least(apart, bounce)), where(split, 0.0, apart))
    spring = material.correction * (gap + constants.one("slop")) / h + restitution * least(speed, 0.0)
    return where((material.compliance > 0.0) & (gap < 0.0), spring, rigid), exists


def flatness(gaps: Sequence[Value], length: Value) -> Value:
    """Weigh whether four contacts lie flat, exp(-(spread of their gaps / (FLATNESS length))^2)."""
    mean = 0.25 * total(list(gaps))
    spread = 0.25 * total([(gap - mean) * (gap - mean) for gap in gaps])
    width = FLATNESS * length
    return decay(spread / (width * width))


def warp(points: Sequence[Vector], frame: Matrix, length: Value, flat: Value) -> Vector:
    """Return how the normal impulses of four contacts would twist a face out of its plane (see `Patch.warp`)."""
    mean = scale(0.25, [total(list(column)) for column in zip(*points, strict=True)])
    within = [[dot(subtract(point, mean), axis) / length for axis in frame[1:]] for point in points]

    def area(i: int, j: int, k: int) -> Value:
        first, second = subtract(within[j], within[i]), subtract(within[k], within[i])
        return first[0] * second[1] - second[0] * first[1]

    areas = [area(1, 2, 3), -area(0, 2, 3), area(0, 1, 3), -area(0, 1, 2)]
    return scale(flat / root(dot(areas, areas) + 1e-12), areas)


@dataclass(frozen=True)
class Touch:
    """Where four contacts lie.

    Attributes:
        points: World frame [m].
        gaps: Distances along the normal [m].
        normal: From the first body, or the ground, to the second.
        active: Which may exist.
        scale: A length of the touching face [m].
    """

    points: list[Vector]
    gaps: Vector
    normal: Vector
    active: list[Value]
    scale: Value


def write_patch(
    patch: Record,
    constants: Record,
    touch: Touch,
    material: Material,
    bodies: Sequence[Record],
    *,
    midpoint: bool = False,
    beside: Sequence[Record] = (),
) -> list[Value]:
    """Write a patch but for its lever, and return which of its contacts exist; of two bodies the second comes first.

    Of one body on the ground its momentum is written too, given the patches `beside` this, with other bodies.
    """
    frame = frame_of(touch.normal)
    arms = [[subtract(point, body["centre"]) for point in touch.points] for body in bodies]
    together, compliance, friction = touch.scale.like(0.0), material.compliance, material.friction
    if midpoint:
        rule = _midpoint_rule(patch, constants, touch, material, bodies, frame, beside)
        offsets, exists, together, friction = rule.offsets, rule.exists, rule.together, rule.friction
        compliance = where(rule.hit > 0.5, 0.0, compliance)
    else:
        offsets, exists = _rules(constants, touch, material, bodies, arms)
        if len(bodies) == 1:
            bodies[0]["momentum"] = bodies[0]["free_momentum"]
    unit_ = constants.one("unit")
    offsets = [where(there, offset / unit_, FAR) for there, offset in zip(exists, offsets, strict=True)]
    flat = where(reduce(and_, touch.active), flatness(touch.gaps, touch.scale), 0.0)
    flat = most(flat, together) if midpoint else flat
    twist = warp(touch.points, frame, touch.scale, flat)
    patch["frame"] = [value for row in frame for value in row]
    for field, body_arms in zip(("arm", "other_arm"), arms, strict=False):
        patch[field] = [value for arm in body_arms for value in arm]
    patch["gap"], patch["offset"], patch["flatness"] = touch.gaps, offsets, [flat]
    patch["friction"] = [where(there, friction, 0.0) for there in exists]
    patch["compliance"] = [where(there, compliance, 0.0) for there in exists]
    patch["warp"] = [where(there, value, 0.0) for there, value in zip(exists, twist, strict=True)]
    patch["exists"] = [where(there, 1.0, 0.0) for there in exists]
    return exists


def _rules(
    constants: Record, touch: Touch, material: Material, bodies: Sequence[Record], arms: Sequence[Sequence[Vector]]
) -> tuple[Vector, list[Value]]:
    """Return c of every contact [m/s] and whether it exists, by the contact rule of the world."""
    offsets, exists = [], []
    for c, (gap, active) in enumerate(zip(touch.gaps, touch.active, strict=True)):
        at = [body_arms[c] for body_arms in arms]
        free_speed = constants.one("unit") * _normal_speed("free", bodies, at, touch.normal)
        speed = _normal_speed("velocity", bodies, at, touch.normal)
        offset, there = rule(gap, speed, free_speed, material, constants)
        offsets.append(offset)
        exists.append(there & active)
    return offsets, exists


@dataclass(frozen=True)
class _Rule:
    """What contacts demand under `Midpoint` (see `physid.physics.schemes.impact`)."""

    offsets: Vector
    exists: list[Value]
    together: Value
    hit: Value
    friction: Value


def _midpoint_rule(
    patch: Record,
    constants: Record,
    touch: Touch,
    material: Material,
    bodies: Sequence[Record],
    frame: Matrix,
    beside: Sequence[Record],
) -> _Rule:
    """Return what contacts demand under `Midpoint`, and write slip, share, and whether they are reached and hit."""
    h, unit_ = constants.one("step"), constants.one("unit")
    contacts = []
    for gap, active, point in zip(touch.gaps, touch.active, touch.points, strict=True):
        at = [subtract(point, body["centre"]) for body in bodies]
        free = unit_ * dot(_relative("free", bodies, at), touch.normal)
        velocity, bend = apply(frame, _relative("velocity", bodies, at)), [gap.like(0.0)] * 3
        if len(bodies) == 1:  # between two bodies the normal turns too
            spin = bodies[0]["velocity"][:3]
            bend = apply(frame, cross(spin, cross(spin, at[0])))
        exists = (gap < REACH + 2.0 * h * size(free)) & active
        contacts.append(Contact(gap, velocity, free, bend, exists))
    width = FLATNESS * touch.scale
    yielding = material.compliance, material.correction
    offsets, share, hit, together = demand(contacts, material.restitution, yielding, constants, width)
    reached = [each.exists & (each.gap + 0.5 * h * each.free < 0.0) for each in contacts]
    patch["reached"] = [where(reduce(or_, reached), 1.0, 0.0)]
    before, friction, opposes_end = touch.scale.like(0.0), material.friction, hit
    if len(bodies) == 1:
        (body,) = bodies
        lies = reduce(and_, reached)
        if beside:
            before = share_before_impact(beside)
            is_struck = lies & (before < NO_IMPACT)
            before, opposes_end = where(is_struck, before, 0.0), where(is_struck, 1.0, hit)
        friction = friction * (1.0 - before)
    slips = [slip(contact, opposes_end, constants) for contact in contacts]
    if len(bodies) == 1:
        velocities = apply(frame, body["velocity"][3:]), apply(frame, scale(unit_, body["free"][3:]))
        spinning = dot(body["velocity"][:3], touch.normal) * touch.scale
        alone = reduce(and_, [other.one("reached") < 0.5 for other in beside], lies)
        turns = turning(velocities, spinning, material.friction, alone, constants)
        slips = [turned(s, stuck(c, constants), turns, hit) for s, c in zip(slips, contacts, strict=True)]
        body["momentum"] = body["free_momentum"]
        if beside:
            arms = [subtract(point, body["centre"]) for point in touch.points]
            rubs = friction_before_impact([c.velocity[1:] for c in contacts], velocities, material.friction, before)
            pushes = [apply(transpose(frame), [before.like(0.0), *rub]) for rub in rubs]
            wrenches = [[*cross(arm, push), *push] for arm, push in zip(arms, pushes, strict=True)]
            gained = [total(list(each)) for each in zip(*wrenches, strict=True)]
            body["momentum"] = add(body["free_momentum"], scale(body.one("share") / unit_, gained))
    slips = [scale(1.0 / unit_, values) for values in slips]
    patch["share"], patch["hit"] = [share], [hit]
    patch["slip"] = [where(c.exists, x, 0.0) for c, values in zip(contacts, slips, strict=True) for x in values]
    return _Rule(offsets, [contact.exists for contact in contacts], together, hit, friction)


def _relative(field: str, bodies: Sequence[Record], arms: Sequence[Vector]) -> Vector:
    """Return the velocity of the second body relative to the first."""
    velocities = [add(body[field][3:], cross(body[field][:3], arm)) for body, arm in zip(bodies, arms, strict=True)]
    return velocities[0] if len(bodies) == 1 else subtract(*velocities)


def _normal_speed(field: str, bodies: Sequence[Record], arms: Sequence[Vector], normal: Vector) -> Value:
    """Return its speed along the normal."""
    return dot(_relative(field, bodies, arms), normal)
