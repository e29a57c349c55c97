"""The formulas of a step as sections of code, each for one body, one patch, or all bodies."""

from __future__ import annotations

from functools import partial

from physid.compiler.section import Formula, Layout, Record, Section
from physid.physics.fused.formulas import body, lane
from physid.physics.fused.formulas.contact_problem import direction, lift, linear, newton, reverse
from physid.physics.fused.formulas.contact_problem.cone import impulse_of
from physid.physics.fused.formulas.contacts import axis, face, ground, pair
from physid.physics.fused.formulas.contacts.patch import Patch
from physid.physics.fused.formulas.layouts import (
    BLOCK,
    BODY,
    CONSTANTS,
    CONTACT,
    IMPULSE,
    LANE,
    MOTION,
    OUTCOME,
    PATCH,
    SHARED,
)
from physid.physics.fused.formulas.schemes import midpoint
from physid.physics.fused.records import Shape

INTEGRATE = Section("integrate", body.integrate, {"body": BODY, "constants": CONSTANTS})
TO_MIDPOINT = Section("to_midpoint", midpoint.to_midpoint, {"body": BODY, "constants": CONSTANTS})
TO_END = Section("to_end", midpoint.to_end, {"body": BODY, "shared": SHARED, "constants": CONSTANTS})
CHOOSE_CORNERS = Section("choose_corners", ground.choose_corners, {"body": BODY, "shared": SHARED, "patch": PATCH})
CHOOSE_AXIS = Section("choose_axis", axis.choose_axis, {"first": BODY, "second": BODY, "patch": PATCH})
CHOOSE_POINTS = Section("choose_points", face.choose_points, {"first": BODY, "second": BODY, "patch": PATCH})
LIFT_PATCH = Section("lift_patch", lift.lift_patch, {"patch": PATCH, "constants": CONSTANTS, "lifted": PATCH})
LIFT_BODY = Section("lift_body", lift.lift_body, {"body": BODY, "lifted": BODY})


def kinds(shape: Shape) -> list[int]:
    """Return how many bodies a patch can have."""
    return ([1] if shape.ground else []) + ([2] if shape.pairs else [])


def assembly(shape: Shape) -> list[Section]:
    """Return the sections from the states to the contact problem; all have a derivative."""
    layouts = {"shared": SHARED, **_numbered("body", BODY, shape.bodies)}
    one = {"body": BODY, "shared": SHARED, "constants": CONSTANTS}
    two = {"first": BODY, "second": BODY, "shared": SHARED, "constants": CONSTANTS, "patch": PATCH}
    standing = {"shared": SHARED, "first_ground": PATCH, "second_ground": PATCH, "patch": PATCH}

    def section(name: str, formula: Formula, layouts: dict[str, Layout]) -> Section:
        return Section(name, partial(formula, midpoint=shape.midpoint), layouts)

    prepare = partial(body.prepare, grounded=shape.ground)
    used = [Section("average_mass", linear.average_mass, layouts), section("prepare", prepare, one)]
    grounded = {**one, "patch": PATCH, **_numbered("beside", PATCH, shape.bodies - 1)}
    used += [section("touch_ground", ground.touch_ground, grounded)] if shape.ground else []
    if shape.pairs:
        used += [section("touch_boxes", pair.touch_boxes, two), Section("stand_boxes", pair.stand_boxes, standing)]
    return used + ([LIFT_PATCH, LIFT_BODY] if shape.split else [])


def choices(shape: Shape) -> list[Section]:
    """Return the sections that choose what touches; they have no derivative."""
    used = [CHOOSE_CORNERS] if shape.ground else []
    return used + ([CHOOSE_AXIS, CHOOSE_POINTS] if shape.pairs else [])


def lift_sections(*, adjoint: bool) -> list[Section]:
    """Return the other sections of the removal of overlaps without velocity."""
    lanes = {"lane": LANE, "lifted": BODY, "body": BODY}
    used = [
        Section("measure", lift.measure, {"patch": PATCH, "lane": LANE}),
        Section("settle", lift.settle, lanes),
    ]
    bars = {"lane": LANE, "lifted_bar": BODY, "body_bar": BODY}
    return [*used, Section("settle_adjoint", lift.settle_adjoint, bars)] if adjoint else used


def pace(shape: Shape) -> Section:
    """Return the section that sets the unit of velocities of a step of another length."""
    return Section("set_unit", partial(lane.set_unit, midpoint=shape.midpoint), {"constants": CONSTANTS})


def moving_sections(shape: Shape) -> list[Section]:
    """Return the sections that turn velocities into poses; all have a derivative."""
    return [TO_MIDPOINT, TO_END] if shape.midpoint else [INTEGRATE]


def impact_sections(shape: Shape) -> list[Section]:
    """Return the sections of what impacts move at once, under `Midpoint`."""
    used = [
        Section("note_impact", midpoint.note_impact, {"patch": PATCH, "lane": LANE}),
        Section("read_impulses", midpoint.read_impulses, {"contact": CONTACT, "pressed": IMPULSE}),
        Section("add_impulse_bar", midpoint.add_impulse_bar, {"contact": CONTACT, "pressed_bar": IMPULSE}),
    ]
    return used + [_late(count, adds=True) for count in kinds(shape)] if shape.midpoint else []


def late_parts(shape: Shape) -> list[Section]:
    """Return the parts of one patch in what impacts move at once, for their derivative."""
    return [_late(count, adds=False) for count in kinds(shape)] if shape.midpoint else []


def _late(count: int, *, adds: bool) -> Section:
    def formula(patch: Record, contact: Record, lane: Record, pressed: Record, *bodies: Record) -> None:
        midpoint.late(Patch(patch, contact, lane, count), pressed, bodies, adds=adds)

    layouts = {**_PATCH, "pressed": IMPULSE, **_numbered("body", BODY, count)}
    return Section(f"add_late{count}" if adds else f"late_part{count}", formula, layouts)


def outcome_sections() -> list[Section]:
    """Return the sections that write what a frame gave beside the states."""

    def collect(contact: Record, shared: Record, constants: Record, impulse: Record) -> None:
        scale = constants.one("unit") * shared.one("mean_mass")
        values = [scale * value for c in range(4) for value in impulse_of(contact.part("z", c))]
        impulse["total"] = [old + value for old, value in zip(impulse["total"], values, strict=True)]

    layouts = {"contact": CONTACT, "shared": SHARED, "constants": CONSTANTS, "impulse": IMPULSE}
    return [
        Section("collect_impulses", collect, layouts),
        Section("report", lane.report, {"lane": LANE, "outcome": OUTCOME}),
    ]


def world_sections() -> list[Section]:
    """Return the sections of the solver that concern one world, or one body."""
    lanes = {"lane": LANE, "constants": CONSTANTS}
    return [
        Section("begin", lane.begin, lanes),
        Section("rescale_body", newton.rescale_body, {"body": BODY, **lanes}),
        Section("rescale", newton.rescale, {"contact": CONTACT, **lanes}),
        Section("clear", lane.clear, {"lane": LANE}),
        Section("judge", newton.judge, {"motion": MOTION, "lane": LANE}),
        Section("allow", lane.allow, lanes),
        Section("check", lane.check, lanes),
        Section("aim_at_zero", lane.aim_at_zero, lanes),
        Section("aim_at_end", lane.aim_at_end, lanes),
        Section("aim", lane.aim, lanes),
        Section("decide_length", lane.decide_length, {"lane": LANE}),
        Section("gauge", lane.gauge, {"body": BODY, "lane": LANE}),
        Section("recall", newton.recall, {"patch": PATCH, "contact": CONTACT, "lane": LANE}),
        Section("start_body", newton.start_body, {"body": BODY, "lane": LANE}),
        Section("evaluate_body", newton.evaluate_body, {"body": BODY, "motion": MOTION}),
        Section("begin_direction", direction.begin_direction, {"motion": MOTION}),
        Section("move", newton.move, {"contact": CONTACT, "lane": LANE}),
        Section("move_body", newton.move_body, {"body": BODY, "motion": MOTION, "lane": LANE}),
    ]


def matrix_sections(bodies: int, *, transposed: bool) -> list[Section]:
    """Return the sections of the Newton matrix of so many bodies."""
    matrix = {"matrix": Layout(entries=36 * bodies * bodies)}
    motions = _numbered("motion", MOTION, bodies)
    formula = linear.solve_transposed(bodies) if transposed else linear.solve(bodies)
    return [
        Section("fill", linear.fill, {"body": BODY, "block": BLOCK}),
        Section("factor", linear.factor(bodies), matrix),
        Section("solve", formula, {**matrix, **motions}),
    ]


def eliminate(count: int) -> Section:
    """Return the section that eliminates a patch of one or two bodies from the Newton matrix."""

    def formula(patch: Record, contact: Record, lane: Record, *blocks: Record) -> None:
        grid = [blocks[count * i : count * (i + 1)] for i in range(count)]
        direction.eliminate(Patch(patch, contact, lane, count), grid)

    blocks = {f"block{i}{j}": BLOCK for i in range(count) for j in range(count)}
    return Section(f"eliminate{count}", formula, {**_PATCH, **blocks})


def patch_sections(count: int, *, slips: bool) -> list[Section]:
    """Return the sections of the solver that concern a patch between one body and the ground, or two bodies."""

    def start(patch: Record, contact: Record, lane: Record, *bodies: Record) -> None:
        newton.start(Patch(patch, contact, lane, count, slips=slips), bodies, lane)

    def evaluate(patch: Record, contact: Record, lane: Record, constants: Record, *both: Record) -> None:
        newton.evaluate(Patch(patch, contact, lane, count, slips=slips), both[:count], both[count:], constants, lane)

    def gather(patch: Record, contact: Record, lane: Record, *motions: Record) -> None:
        direction.gather(Patch(patch, contact, lane, count), motions, lane)

    def expand(patch: Record, contact: Record, lane: Record, *motions: Record) -> None:
        direction.expand(Patch(patch, contact, lane, count), motions, lane)

    bodies, motions = _numbered("body", BODY, count), _numbered("motion", MOTION, count)
    return [
        Section(f"start{count}", start, {**_PATCH, **bodies}),
        Section(f"evaluate{count}", evaluate, {**_PATCH, "constants": CONSTANTS, **bodies, **motions}),
        Section(f"gather{count}", gather, {**_PATCH, **motions}),
        Section(f"expand{count}", expand, {**_PATCH, **motions}),
    ]


def reverse_sections(count: int, *, midpoint: bool) -> list[Section]:
    """Return the sections of the derivative at the solution that concern a patch."""

    def pull(patch: Record, contact: Record, lane: Record, *motions: Record) -> None:
        reverse.pull(Patch(patch, contact, lane, count), motions)

    def push(patch: Record, contact: Record, lane: Record, bar: Record, *both: Record) -> None:
        whole = Patch(patch, contact, lane, count, slips=midpoint)
        reverse.push(whole, bar, both[:count], both[count:], adds=midpoint)

    bodies, motions = _numbered("body", BODY, count), _numbered("motion", MOTION, count)
    return [
        Section(f"pull{count}", pull, {**_PATCH, **motions}),
        Section(f"push{count}", push, {**_PATCH, "bar": PATCH, **bodies, **motions}),
    ]


def reverse_body_sections(*, midpoint: bool) -> list[Section]:
    """Return the sections of the derivative at the solution that concern impulses or a body."""
    push = partial(reverse.push_body, adds=midpoint)  # to what impacts that move bodies at once add
    impulses = {
        "contact": CONTACT, "impulse_bar": IMPULSE, "shared": SHARED, "shared_bar": SHARED, "constants": CONSTANTS,
    }  # fmt: skip
    return [
        Section("seed", reverse.seed, impulses),
        Section("begin_reverse", reverse.begin, {"body_bar": BODY, "motion": MOTION}),
        Section("push_body", push, {"body": BODY, "body_bar": BODY, "motion": MOTION}),
    ]


_PATCH = {"patch": PATCH, "contact": CONTACT, "lane": LANE}


def _numbered(name: str, layout: Layout, count: int) -> dict[str, Layout]:
    return {f"{name}{k}": layout for k in range(count)}
