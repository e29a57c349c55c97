"""The derivative of a solved contact problem by what enters it (see `physid.physics.contact_problem.implicit`)."""

from __future__ import annotations

from collections.abc import Sequence

from physid.compiler.adjoint import slopes
from physid.compiler.graph import Value, stop, total
from physid.compiler.section import Record
from physid.physics.fused.formulas.algebra import add, apply, dot, rows, scale, subtract, transpose
from physid.physics.fused.formulas.body import symmetric
from physid.physics.fused.formulas.contact_problem.cone import impulse_of
from physid.physics.fused.formulas.contacts.patch import Patch, accumulate, padded


def seed(contact: Record, impulse_bar: Record, shared: Record, shared_bar: Record, constants: Record) -> None:
    """Turn the derivative by impulses in N s into that by the solver's, of unit g h times the mean mass."""
    unit, mean = constants.one("unit"), shared.one("mean_mass")
    impulses = [value for c in range(4) for value in impulse_of(contact.part("z", c))]
    given = impulse_bar["total"]
    shared_bar["mean_mass"] = [shared_bar.one("mean_mass") + unit * dot(given, impulses)]
    contact["impulse_bar"] = scale(unit * mean, given)


def begin(body_bar: Record, motion: Record) -> None:
    """Start the right-hand side of the transposed system with the derivative by the new velocity."""
    motion["dv"] = body_bar["v"]


def pull(patch: Patch, motions: Sequence[Record]) -> None:
    """Add -J^T W^T impulse_bar to the right-hand side, and eliminate the modes."""
    pulled = []
    for c in range(4):
        w, _ = patch[c].response()
        pulled.append(apply(transpose(w), [-x for x in patch.contact.part("impulse_bar", c)]))
    rest = patch.on_modes([part[0] for part in pulled])
    inner = transpose([row[: patch.bodies] for row in rows(patch.contact["inner"], 2)[: patch.bodies]])
    rest = apply(inner, rest)
    right = patch.mode_vectors("right")
    terms = [patch.wrenches(c, pulled[c]) for c in range(4)]
    for k in range(patch.bodies):
        terms.append([scale(-rest[k], right[i][k]) for i in range(patch.bodies)])
    accumulate(motions, "dv", terms)
    patch.contact["dmodes"] = padded(rest, 2)


def push(patch: Patch, bar: Record, bodies: Sequence[Record], motions: Sequence[Record], *, adds: bool = False) -> None:
    """Write the derivative by what a patch contributes to the problem, from the solution y of the transposed system.

    It is that of y.(J^T impulse) + to_u.(J v + c + k ln) + q.(d impulse / d mu) mu with all but J, c, k and mu held,
    where q = J y + impulse_bar and to_u = -W^T q. With `adds`, it is added to what is written already.
    """
    left, count = patch.mode_vectors("left"), patch.bodies
    y, v, modes = [m["dv"] for m in motions], [b["v"] for b in bodies], patch.contact["modes"][:count]
    y_modes = [patch.contact["dmodes"][k] - total([dot(left[i][k], y[i]) for i in range(count)]) for k in range(count)]
    terms = []
    for c in range(4):
        contact = patch[c]
        w, by_friction = contact.response()
        moved = patch.velocity(c, y, [stop(mode) for mode in y_modes])
        q = [stop(value) for value in add(moved, patch.contact.part("impulse_bar", c))]
        to_u = [stop(-value) for value in apply(transpose(w), q)]
        impulse, offset = impulse_of(contact.z), patch.patch["offset"][c] + contact.compliance * contact.z[0]
        terms.append(dot(impulse, moved) + dot(to_u, patch.slip(c, v, modes)))
        terms.append(to_u[0] * offset + stop(dot(q[1:], by_friction[1:])) * contact.friction)
    _write_slopes(total(terms), patch.patch, bar, adds=adds)


def push_body(body: Record, body_bar: Record, motion: Record, *, adds: bool = False) -> None:
    """Write the derivative by momentum and inertia of a body, that of y.(p - M v), or add it (see `push`)."""
    y, v = motion["dv"], body["v"]
    inertial = [*apply(symmetric(body["world_inertia"]), v[:3]), *scale(body.one("share"), v[3:])]
    _write_slopes(dot(y, subtract(body["momentum"], inertial)), body, body_bar, adds=adds)


def _write_slopes(outcome: Value, record: Record, bar: Record, *, adds: bool = False) -> None:
    """Write the derivative by the fields of a record to its adjoint record, or add it."""
    by_slot = slopes(outcome)
    for field, first in record.layout.offsets.items():
        slots = range(first, first + record.layout.widths[field])
        values = [by_slot.get((record.name, slot)) for slot in slots if slot not in record.layout.constant]
        if any(value is not None for value in values) and field != "v":
            slopes_ = [0.0 if value is None else value for value in values]
            bar[field] = [old + new for old, new in zip(bar[field], slopes_, strict=True)] if adds else slopes_
