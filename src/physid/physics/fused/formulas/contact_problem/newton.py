"""Where Newton's method starts, how far it is from the solution, and how it moves."""

from __future__ import annotations

from collections.abc import Sequence

from physid.compiler.graph import Value, most, size, total, where
from physid.compiler.section import Record
from physid.physics.fused.formulas.algebra import Vector, add, apply, scale, subtract
from physid.physics.fused.formulas.body import symmetric
from physid.physics.fused.formulas.contact_problem.cone import begin, impulse_of, slide
from physid.physics.fused.formulas.contacts.patch import STIFFNESS, Patch, accumulate, padded


def recall(patch: Record, contact: Record, lane: Record) -> None:
    """Sort the previous solution to the contacts that it belongs to; mark those that are new, begin or cease."""
    distance = lane.one("distance")
    for offset in patch["offset"]:
        distance = most(distance, size(offset))
    lane["distance"] = [distance]
    labels = [label + 1000.0 * exists for label, exists in zip(patch["label"], patch["exists"], strict=True)]
    fresh: Vector = []
    kept: dict[str, Vector] = {"z": [], "w": []}
    for label in labels:
        same = [label.equals(before) for before in contact["label"]]
        fresh.append(where(same[0] | same[1] | same[2] | same[3], 0.0, 1.0))
        for field, values in kept.items():
            chosen = contact.part(field, 3)
            for k in range(3):
                part = contact.part(field, k)
                chosen = [where(same[k], new, old) for new, old in zip(part, chosen, strict=True)]
            values += chosen
    contact["z"], contact["w"] = kept["z"], kept["w"]
    contact["fresh"], contact["label"], contact["slides"] = fresh, labels, [0.0] * 4


def _ratio(lane: Record, constants: Record) -> Value:
    """Return the unit of velocities of the previous solution in that of this step."""
    known, unit = lane.one("known"), constants.one("unit")
    return where(known > 0.0, known, unit) / unit


def rescale_body(body: Record, lane: Record, constants: Record) -> None:
    """Keep the velocity of the previous solution where their unit has changed."""
    body["v"] = scale(_ratio(lane, constants), body["v"])


def rescale(contact: Record, lane: Record, constants: Record) -> None:
    """Keep the velocities among the unknowns, slacks and modes of a patch; impulses stay in proportion to the load."""
    ratio = _ratio(lane, constants)
    z, w = contact["z"], contact["w"]
    contact["z"] = [ratio * x if k % 5 == 1 else x for k, x in enumerate(z)]
    contact["w"] = [x if k % 5 == 1 else ratio * x for k, x in enumerate(w)]
    contact["modes"] = scale(ratio, contact["modes"])


def start(patch: Patch, bodies: Sequence[Record], lane: Record) -> None:
    """Start afresh, from free motion, in the worlds and contacts that are told to."""
    again = lane.one("restart") > 0.5
    z, w = [], []
    for c in range(4):
        contact, restart = patch[c], again | (patch.contact["fresh"][c] > 0.5)
        u = patch.slip(c, [body["free"] for body in bodies], [again.like(0.0)] * patch.bodies)
        new_z, new_w = begin(u, patch.patch["offset"][c], contact.friction)
        z += [where(restart, new, old) for new, old in zip(new_z, contact.z, strict=True)]
        w += [where(restart, new, old) for new, old in zip(new_w, contact.w, strict=True)]
    patch.contact["z"], patch.contact["w"] = z, w
    patch.contact["modes"] = [where(again, 0.0, old) for old in patch.contact["modes"]]
    patch.contact["fresh"] = [0.0] * 4


def start_body(body: Record, lane: Record) -> None:
    """Start afresh, from free motion, in the worlds that are told to."""
    restart = lane.one("restart") > 0.5
    body["v"] = [where(restart, new, old) for new, old in zip(body["free"], body["v"], strict=True)]


def evaluate_body(body: Record, motion: Record) -> None:
    """Write M v - p."""
    angular = apply(symmetric(body["world_inertia"]), body["v"][:3])
    motion["force"] = subtract([*angular, *scale(body.one("share"), body["v"][3:])], body["momentum"])


def worse(worst: Value, error: Value) -> Value:
    """Return the larger size; what is not a number stays so if it comes last."""
    error = size(error)
    return where(error <= worst, worst, error)


def evaluate(
    patch: Patch, bodies: Sequence[Record], motions: Sequence[Record], constants: Record, lane: Record
) -> None:
    """Write slack errors, add the impulses to the force errors, and track the largest error and the gap z.w.

    Worlds that start from the previous solution first have the friction of sliding contacts solved (see `slide`).
    """
    allowed = lane.one("allowed_products")
    tau, lost, warm = constants.one("tau"), lane.one("lost"), lane.one("rung") < 0.0
    modes = patch.contact["modes"][: patch.bodies]
    kept: dict[str, Vector] = {"z": [], "w": [], "r": [], "slides": []}
    impulses, gaps, errors = [], [], []
    for c in range(4):
        contact = patch[c]
        u = patch.slip(c, [body["v"] for body in bodies], modes)
        new_z, new_w, sliding = slide(contact, u, tau)
        sliding = sliding & warm
        z = [where(sliding, new, old) for new, old in zip(new_z, contact.z, strict=True)]
        w = [where(sliding, new, old) for new, old in zip(new_w, contact.w, strict=True)]
        lost = where((patch.contact["slides"][c] > 0.5) & ~sliding, 1.0, lost)
        contact = patch.with_solution(c, z, w)
        slack_error, (pairs, zeros) = contact.slack_error(u, patch.patch["offset"][c]), contact.products()
        errors += [*slack_error, *scale(allowed, [*[pair - tau for pair in pairs], *zeros])]
        gaps += pairs
        impulses.append(impulse_of(z))
        for field, values in (("z", z), ("w", w), ("r", slack_error), ("slides", [where(sliding, 1.0, 0.0)])):
            kept[field] += values
    pressed = patch.on_modes([impulse[0] for impulse in impulses])
    mode_force = [STIFFNESS * v - load for v, load in zip(modes, pressed, strict=True)]
    worst = lane.one("worst")
    for error in errors + mode_force:
        worst = worse(worst, error)
    accumulate(motions, "force", [patch.wrenches(c, impulses[c]) for c in range(4)], -1.0)
    for field, values in kept.items():
        patch.contact[field] = values
    patch.contact["mode_force"] = padded(mode_force, 2)
    lane["lost"], lane["worst"], lane["gap"] = [lost], [worst], [lane.one("gap") + total(gaps)]


def judge(motion: Record, lane: Record) -> None:
    """Take the force errors of a body into account."""
    worst = lane.one("worst")
    for error in motion["force"]:
        worst = worse(worst, error)
    lane["worst"] = [worst]


def move(contact: Record, lane: Record) -> None:
    """Take the step."""
    length = lane.one("length")
    for field, change in (("z", "dz"), ("w", "dw"), ("modes", "dmodes")):
        contact[field] = add(contact[field], scale(length, contact[change]))


def move_body(body: Record, motion: Record, lane: Record) -> None:
    """Take the step."""
    body["v"] = add(body["v"], scale(lane.one("length"), motion["dv"]))
