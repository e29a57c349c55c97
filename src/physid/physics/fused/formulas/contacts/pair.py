"""Two boxes: the contacts between them, for the axis and the points that were chosen."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce

from physid.compiler.graph import Value, least, most, root, total, where
from physid.compiler.section import Record
from physid.physics.fused.formulas.algebra import Vector, add, apply, cross, dot, scale, subtract, transpose
from physid.physics.fused.formulas.contacts.axis import axes_of, half_of, pick
from physid.physics.fused.formulas.contacts.face import Face
from physid.physics.fused.formulas.contacts.ground import NO_GROUND
from physid.physics.fused.formulas.contacts.touch import Material, Touch, write_patch


def touch_boxes(
    first: Record, second: Record, shared: Record, constants: Record, patch: Record, *, midpoint: bool = False
) -> None:
    """Write the patch of two boxes, for the axis and the points that were chosen."""
    length = reduce(least, [*first["size"], *second["size"]])
    face, edge = _face_contacts(first, second, patch, length), _edge_contact(first, second, patch, length)
    by_edge = patch["choice"][0] >= 6.0

    def pick_of(a: Sequence[Value], b: Sequence[Value]) -> Vector:
        return [where(by_edge, x, y) for x, y in zip(a, b, strict=True)]

    touch = Touch(
        points=[pick_of(a, b) for a, b in zip(edge.points, face.points, strict=True)],
        gaps=pick_of(edge.gaps, face.gaps),
        normal=pick_of(edge.normal, face.normal),
        active=[(by_edge & edge.active[0]) | (~by_edge & face.active[0]), *[~by_edge & on for on in face.active[1:]]],
        scale=length,
    )
    restitution = first.one("restitution") * second.one("restitution") + shared.one("body_restitution")
    material = Material(
        friction=first.one("friction") * second.one("friction") * shared.one("body_friction"),
        restitution=most(restitution, 0.0),
        compliance=length.like(0.0),
        correction=length.like(1.0),
    )
    exists = write_patch(patch, constants, touch, material, [second, first], midpoint=midpoint)
    tip = _lever(touch, shared["ground_normal"], exists)
    patch["tip"] = [where(there, value, 0.0) for there, value in zip(exists, tip, strict=True)]


def stand_boxes(shared: Record, first_ground: Record, second_ground: Record, patch: Record) -> None:
    """Write the lever of two boxes, as far as both stand on the ground."""
    flat = first_ground.one("flatness") * second_ground.one("flatness")
    standing = where(shared.one("ground_offset") > NO_GROUND, flat, 0.0)
    patch["lever"] = scale(standing, patch["tip"])


def _face_contacts(first: Record, second: Record, patch: Record, length: Value) -> Touch:
    """Return the contacts between two faces."""
    face = Face(first, second, patch["choice"][0])
    points, gaps, active = [], [], []
    for k in range(4):
        code = patch["choice"][1 + 7 * k : 8 + 7 * k]
        height, x, y = face.candidate(code)
        gaps.append(height - face.reach[0])
        points.append(add(face.centre, apply(transpose(face.frame), [height - 0.5 * gaps[k], x, y])))
        active.append(code[6] > 0.5)
    return Touch(points, gaps, [where(face.swap, -n, n) for n in face.frame[0]], active, length)


def _edge_contact(first: Record, second: Record, patch: Record, length: Value) -> Touch:
    """Return the contact at the closest points of two edges, unless they are parallel; all four are the same."""
    index = patch["choice"][0]
    axes, half = (axes_of(first), axes_of(second)), (half_of(first), half_of(second))
    between = subtract(second["pose"][:3], first["pose"][:3])
    row = [index < 9.0, (index >= 9.0) & (index < 12.0), index >= 12.0]
    column = [index.equals(6.0 + k) | index.equals(9.0 + k) | index.equals(12.0 + k) for k in range(3)]
    along = pick(row, axes[0]), pick(column, axes[1])
    across = cross(*along)
    square = dot(across, across)
    usable = square > 1e-12
    safe = where(usable, square, 1.0)
    normal = scale(1.0 / root(safe), across)
    normal = scale(where(dot(normal, between) < 0.0, -1.0, 1.0), normal)
    ends = []
    for body, sign, masks in ((first, 1.0, row), (second, -1.0, column)):
        which = 0 if sign > 0 else 1
        facing = [sign * dot(axis, normal) for axis in axes[which]]
        reach = [where(f > 0.0, h, -h) for f, h in zip(facing, half[which], strict=True)]
        reach = [where(mask, 0.0, r) for mask, r in zip(masks, reach, strict=True)]
        ends.append(add(body["pose"][:3], [dot(reach, [axis[i] for axis in axes[which]]) for i in range(3)]))
    away = subtract(ends[1], ends[0])
    gap = dot(away, normal)
    t = dot(cross(away, along[1]), across) / safe
    point = add(add(ends[0], scale(t, along[0])), scale(0.5 * gap, normal))
    return Touch([point] * 4, [gap] * 4, normal, [usable] * 4, length)


def _lever(touch: Touch, up: Sequence[Value], exists: Sequence[Value]) -> Vector:
    """Return how the contacts would tip the bodies, heights above their mean (see `Patch.lever`)."""
    heights = [where(there, dot(point, up), 0.0) for there, point in zip(exists, touch.points, strict=True)]
    count = total([where(there, 1.0, 0.0) for there in exists])
    mean = total(heights) / most(count, 1.0)
    deviation = [where(there, (h - mean) / touch.scale, 0.0) for there, h in zip(exists, heights, strict=True)]
    return scale(1.0 / root(dot(deviation, deviation) + 1e-6), deviation)
