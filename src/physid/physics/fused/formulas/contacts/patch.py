"""Four contacts between one body and the ground, or between two bodies, as the solver sees them."""

from __future__ import annotations

from collections.abc import Sequence

from physid.compiler.graph import Value, total
from physid.compiler.section import Record
from physid.physics.contact import WARP_COMPLIANCE
from physid.physics.fused.formulas.algebra import Vector, add, apply, cross, dot, rows, scale, subtract, transpose
from physid.physics.fused.formulas.contact_problem.cone import Contact

STIFFNESS = 1 / WARP_COMPLIANCE


class Patch:
    """Four contacts between `bodies` bodies (1: and the ground); of two, the second body of the pair comes first."""

    def __init__(self, patch: Record, contact: Record, lane: Record, bodies: int, *, slips: bool = False) -> None:
        self.patch, self.contact, self.bodies, self.slips = patch, contact, bodies, slips
        self.compliance = lane.one("compliance")
        self.frame = rows(patch["frame"])
        self.modes = [patch["warp"], patch["lever"]][:bodies]

    def __getitem__(self, c: int) -> Contact:
        return self.with_solution(c, self.contact.part("z", c), self.contact.part("w", c))

    def with_solution(self, c: int, z: Vector, w: Vector) -> Contact:
        """Return a contact with other unknowns."""
        return Contact(z, w, self.patch["friction"][c], self.patch["compliance"][c] + self.compliance)

    def exists(self, c: int) -> Value:
        """Return 1 or 0."""
        return self.patch["exists"][c]

    def arms(self, c: int) -> list[Vector]:
        """Return the arm to a contact from the centre of mass of each body."""
        return [self.patch.part("arm", c), self.patch.part("other_arm", c)][: self.bodies]

    def velocity(self, c: int, velocities: Sequence[Sequence[Value]], modes: Sequence[Value]) -> Vector:
        """Compute u = J v of a contact."""
        points = [add(v[3:], cross(v[:3], arm)) for v, arm in zip(velocities, self.arms(c), strict=True)]
        world = points[0] if self.bodies == 1 else subtract(points[0], points[1])
        u = scale(self.exists(c), apply(self.frame, world))
        return [u[0] + dot([mode[c] for mode in self.modes], modes), *u[1:]]

    def slip(self, c: int, velocities: Sequence[Sequence[Value]], modes: Sequence[Value]) -> Vector:
        """Compute what friction opposes: u and what is added to its tangential part."""
        u = self.velocity(c, velocities, modes)
        return [u[0], *add(u[1:], self.patch.part("slip", c))] if self.slips else u

    def wrenches(self, c: int, impulse: Sequence[Value]) -> list[Vector]:
        """Compute J^T impulse of a contact, for each body."""
        world = apply(transpose(self.frame), scale(self.exists(c), impulse))
        parts = [[*cross(arm, world), *world] for arm in self.arms(c)]
        return parts if self.bodies == 1 else [parts[0], [-x for x in parts[1]]]

    def on_modes(self, normals: Sequence[Value]) -> Vector:
        """Compute J^T impulse of all contacts on each mode, from the normal impulses."""
        return [dot(mode, normals) for mode in self.modes]

    def mode_vectors(self, field: str) -> list[list[Vector]]:
        """Return `left` or `right` of the elimination of the modes, per body and mode."""
        count, values = self.bodies, self.contact[field]
        return [[values[6 * (i * count + k) : 6 * (i * count + k) + 6] for k in range(count)] for i in range(count)]


def accumulate(records: Sequence[Record], field: str, terms: Sequence[list[Vector]], sign: float = 1.0) -> None:
    """Add the sum of terms, each with a vector per body, to a field of each body."""
    for k, record in enumerate(records):
        sums = [total([term[k][i] for term in terms]) for i in range(6)]
        record[field] = add(record[field], scale(sign, sums))


def padded(values: Sequence[Value], width: int) -> list[Value | float]:
    """Fill up with zeros."""
    return [*values, *[0.0] * (width - len(values))]
