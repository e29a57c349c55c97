"""The Newton direction of all contacts, one patch at a time.

Bodies exchange impulses through contacts only, so that the Newton matrix is A = M + sum X K X^T with K = F^T W F of
each contact and X = (arm x; 1) of each body, after the redundant modes of every patch are eliminated too.
"""

from __future__ import annotations

from collections.abc import Sequence

from physid.compiler.graph import Value, most, root, total, where
from physid.compiler.section import Record
from physid.physics.fused.formulas.algebra import (
    Matrix,
    Vector,
    cross,
    dot,
    invert,
    multiply_matrices,
    rows,
    scale,
    transpose,
)  # fmt: skip
from physid.physics.fused.formulas.contact_problem.cone import impulse_of
from physid.physics.fused.formulas.contacts.patch import STIFFNESS, Patch, accumulate, padded


def eliminate(patch: Patch, blocks: Sequence[Sequence[Record]]) -> None:
    """Add J^T W J of a patch, its modes eliminated, to the blocks of the Newton matrix."""
    count = patch.bodies
    responses = [patch[c].response()[0] for c in range(4)]
    left, right, inner = _modes(patch, responses)
    contacts = [_between_bodies(patch, c, responses[c]) for c in range(4)]
    for i in range(count):
        for j in range(count):
            block = _sum([contact[i][j] for contact in contacts])
            sign = 1.0 if i == j else -1.0
            schur = [total([left[i][k][x] * right[j][k][y] for k in range(count)]) for x in range(6) for y in range(6)]
            old = blocks[i][j]["entries"]
            blocks[i][j]["entries"] = [o + sign * b - s for o, b, s in zip(old, block, schur, strict=True)]
    for field, parts in (("left", left), ("right", right)):
        patch.contact[field] = padded([value for part in parts for vector in part for value in vector], 24)
    patch.contact["inner"] = [inner[i][k] if max(i, k) < count else 0.0 for i in range(2) for k in range(2)]


def _between_bodies(patch: Patch, c: int, response: Matrix) -> list[list[Vector]]:
    """Return X_i K X_j^T of a contact, for every two of its bodies, as 36 numbers."""
    within = multiply_matrices(transpose(patch.frame), multiply_matrices(response, patch.frame))
    within = [scale(patch.exists(c), row) for row in within]
    arms = patch.arms(c)
    blocks = []
    for arm in arms:
        torque = transpose([cross(arm, column) for column in transpose(within)])
        blocks.append([[x for row in torque + within for x in [*cross(other, row), *row]] for other in arms])
    return blocks


def _modes(patch: Patch, responses: Sequence[Matrix]) -> tuple[list[list[Vector]], list[list[Vector]], Matrix]:
    """Return A_bm A_mm^-1 and A_mb per body and mode, and A_mm^-1."""
    count = patch.bodies
    stiff = [response[0][0] for response in responses]
    inner = [[dot(a, [x * s for x, s in zip(b, stiff, strict=True)]) for b in patch.modes] for a in patch.modes]
    inner = invert([[x + (STIFFNESS if i == j else 0.0) for j, x in enumerate(row)] for i, row in enumerate(inner)])
    given = [patch.wrenches(c, [row[0] for row in response]) for c, response in enumerate(responses)]
    taken = [patch.wrenches(c, response[0]) for c, response in enumerate(responses)]

    def along(parts: list[list[Vector]], body: int, mode: Vector) -> Vector:
        return _sum([scale(mode[c], parts[c][body]) for c in range(4)])

    columns = [[along(given, i, mode) for mode in patch.modes] for i in range(count)]
    left = [[_sum([scale(inner[m][k], c[m]) for m in range(count)]) for k in range(count)] for c in columns]
    return left, [[along(taken, i, mode) for mode in patch.modes] for i in range(count)], inner


def begin_direction(motion: Record) -> None:
    """Start the right-hand side of the Newton equations."""
    motion["dv"] = [-f for f in motion["force"]]


def gather(patch: Patch, motions: Sequence[Record], lane: Record) -> None:
    """Add the patch's part of the right-hand side of the Newton equations."""
    target, still = lane.one("target"), [patch.compliance.like(0.0)] * 3
    pushes = [impulse_of(patch[c].direction(patch.contact.part("r", c), target, still)[0]) for c in range(4)]
    pressed = patch.on_modes([push[0] for push in pushes])
    rest = [load - force for load, force in zip(pressed, patch.contact["mode_force"], strict=False)]
    left = patch.mode_vectors("left")
    terms = [patch.wrenches(c, pushes[c]) for c in range(4)]
    terms += [[scale(-rest[k], left[i][k]) for i in range(patch.bodies)] for k in range(patch.bodies)]
    accumulate(motions, "dv", terms)
    patch.contact["dmodes"] = padded(rest, 2)


def expand(patch: Patch, motions: Sequence[Record], lane: Record) -> None:
    """Write the direction of all unknowns of a patch, the longest step along it, and how the gap changes."""
    target, longest, count = lane.one("target"), _Longest(lane), patch.bodies
    right, inner = patch.mode_vectors("right"), rows(patch.contact["inner"], 2)
    rest = [
        patch.contact["dmodes"][k] - total([dot(right[i][k], motions[i]["dv"]) for i in range(count)])
        for k in range(count)
    ]
    modes = [dot(inner[k][:count], rest) for k in range(count)]
    all_dz: Vector = []
    all_dw: Vector = []
    slope, curve = [], []
    for c in range(4):
        contact = patch[c]
        du = patch.velocity(c, [motion["dv"] for motion in motions], modes)
        dz, dw = contact.direction(patch.contact.part("r", c), target, du)
        sticks = patch.contact["slides"][c] < 0.5
        for value, change in ((contact.z, dz), (contact.w, dw)):
            longest.limit(change[0] < 0.0, value[0], -change[0])
            longest.limit((change[1] < 0.0) & sticks, value[1], -change[1])
            longest.stay_in_cone(value[2:], change[2:], sticks)
        slope += [dot(contact.z, dw), dot(contact.w, dz)]
        curve.append(dot(dz, dw))
        all_dz, all_dw = all_dz + dz, all_dw + dw
    patch.contact["dz"], patch.contact["dw"], patch.contact["dmodes"] = all_dz, all_dw, padded(modes, 2)
    lane["numerator"], lane["denominator"] = [longest.numerator], [longest.denominator]
    lane["slope"], lane["curve"] = [lane.one("slope") + total(slope)], [lane.one("curve") + total(curve)]


class _Longest:
    """The longest step that keeps all in the cones, as a fraction: comparing fractions needs no division."""

    def __init__(self, lane: Record) -> None:
        self.numerator, self.denominator = lane.one("numerator"), lane.one("denominator")

    def limit(self, valid: Value, numerator: Value, denominator: Value) -> None:
        """Take a limit into account where it is valid."""
        shorter = valid & (numerator * self.denominator < self.numerator * denominator)
        self.numerator = where(shorter, numerator, self.numerator)
        self.denominator = where(shorter, denominator, self.denominator)

    def stay_in_cone(self, x: Sequence[Value], dx: Sequence[Value], matters: Value) -> None:
        """Stay in the second-order cone: the first root of a quadratic (see `cones.cone_length`)."""
        a = dx[0] * dx[0] - dot(dx[1:], dx[1:])
        b = x[0] * dx[0] - dot(x[1:], dx[1:])
        c = most(x[0] * x[0] - dot(x[1:], x[1:]), 0.0)
        divisor = root(most(b * b - a * c, 0.0)) - b
        self.limit(matters & (divisor > 0.0) & ~((a >= 0.0) & (b >= 0.0)), c, divisor)


def _sum(vectors: Sequence[Vector]) -> Vector:
    return [total(list(column)) for column in zip(*vectors, strict=True)]
