"""Overlaps removed without velocity: the second contact problem of the rule `Split`."""

from __future__ import annotations

from physid.compiler.graph import where
from physid.compiler.section import Record
from physid.physics.contact_problem.rows import FAR


def measure(patch: Record, lane: Record) -> None:
    """Note the worlds with a contact."""
    touches = lane.one("touches")
    for exists in patch["exists"]:
        touches = where(exists > 0.5, 1.0, touches)
    lane["touches"] = [touches]


def lift_patch(patch: Record, constants: Record, lifted: Record) -> None:
    """Write the patch of the second problem: no friction, and every contact opens by a share of its depth."""
    scale = constants.one("correction") / (constants.one("unit") * constants.one("step"))
    slop = constants.one("slop")
    for field in ("frame", "arm", "other_arm", "compliance", "warp", "lever", "exists", "label"):
        lifted[field] = patch[field]
    lifted["friction"] = [0.0] * 4
    lifted["offset"] = [
        where((exists > 0.5) & (compliance <= 0.0), (gap + slop) * scale, FAR)
        for gap, exists, compliance in zip(patch["gap"], patch["exists"], patch["compliance"], strict=True)
    ]


def lift_body(body: Record, lifted: Record) -> None:
    """Write the body of the second problem: at rest."""
    lifted["world_inertia"], lifted["share"] = body["world_inertia"], body["share"]
    lifted["size"] = body["size"]
    lifted["momentum"], lifted["free"] = [0.0] * 6, [0.0] * 6


def settle(lane: Record, lifted: Record, body: Record) -> None:
    """Take over the displacement where there is a contact."""
    body["shift"] = [where(lane.one("touches") > 0.5, value, 0.0) for value in lifted["v"]]


def settle_adjoint(lane: Record, lifted_bar: Record, body_bar: Record) -> None:
    """Hand the derivative by the displacement to the second problem."""
    lifted_bar["v"] = [where(lane.one("touches") > 0.5, value, 0.0) for value in body_bar["shift"]]
