"""The contact problem of a step, as the compiled formulas write it and as the reference does, number by number."""

from __future__ import annotations

import dataclasses
import itertools
import math

import pytest
import torch
from tests.physics.compiled_step import BATCH, WORLDS, Compiled, placed, uniform
from tests.physics.formulas import constants, evaluate, run
from torch import Tensor
from torch.nn.functional import pad

from physics.worlds import boxes
from physid.physics import State, StepInputs, World
from physid.physics.case import nominal_inputs
from physid.physics.contact import ContactRule, Penetrating, Speculative, Split
from physid.physics.contact_problem.formulation import Formulation, formulate
from physid.physics.contact_problem.lcp import ContactProblem
from physid.physics.contact_problem.rows import REACH, patches_of
from physid.physics.fused import sections
from physid.physics.fused.formulas.contacts import patch as compiled_patch
from physid.physics.fused.formulas.contacts import touch
from physid.physics.fused.formulas.layouts import CONSTANTS
from physid.physics.fused.packing import shape_of
from physid.physics.rotations import exponential
from physid.physics.schemes.motion import drifted
from physid.physics.shapes.shape import frame_of

EXACT = 1e-11


def formulated(state: State, inputs: StepInputs, world: World) -> Formulation:
    h = torch.tensor([world.step], dtype=torch.float64)
    at = drifted(state, inputs, h / 2, gyroscopic=world.gyroscopic) if world.midpoint else state
    return formulate(at, state, inputs, world, h)


def assert_close(found: Tensor, expected: Tensor, tolerance: float = EXACT) -> None:
    scale = max(float(expected.abs().max()), 1.0)
    torch.testing.assert_close(found, expected.expand_as(found), rtol=0, atol=tolerance * scale)


def assert_same_velocities(compiled: Compiled, problem: ContactProblem) -> None:
    """J v of bodies and modes, and J^T of impulses, are those of the reference, contact by contact."""
    shape, batch = shape_of(compiled.world, compiled.bodies), len(problem.mass)
    v = uniform(batch, problem.mass.shape[1], low=-1, high=1, seed=20)
    impulse = uniform(*problem.offset.shape, 3, low=-1, high=1, seed=21)
    u = torch.einsum("bckn,bn->bck", problem.jacobian, v)
    pulled = torch.einsum("bckn,bck->bn", problem.jacobian, impulse)
    twists = v[:, : 6 * compiled.bodies].unflatten(1, (-1, 6))
    column, found = 6 * compiled.bodies, torch.zeros_like(pulled)
    for p, touching in shape.touching:
        count = len(touching)
        width = count if compiled.world.ground else 1  # without a ground there is no lever
        modes, own = v[:, column : column + width], slice(4 * p, 4 * p + 4)

        def formula(patch, contact, lane, given, out) -> None:  # noqa: ANN001
            whole = compiled_patch.Patch(patch, contact, lane, len(touching))  # noqa: B023
            velocities = [given["v"][6 * k : 6 * k + 6] for k in range(count)]  # noqa: B023
            out["u"] = [x for c in range(4) for x in whole.velocity(c, velocities, given["modes"])]
            pushes = [given["impulse"][3 * c : 3 * c + 3] for c in range(4)]
            parts = [whole.wrenches(c, pushes[c]) for c in range(4)]
            sums = [sum(part[k][i] for part in parts) for k in range(count) for i in range(6)]  # noqa: B023
            out["f"] = [*sums, *whole.on_modes([push[0] for push in pushes])]

        layout = sections.Layout
        layouts = {
            **sections._PATCH,
            "given": layout(v=6 * count, modes=count, impulse=12),
            "out": layout(u=12, f=7 * count),
        }
        given = {
            "patch": compiled.records.of[f"patch{p}"],
            "given": {
                "v": twists[:, touching].flatten(1),
                "modes": pad(modes, (0, count - width)),
                "impulse": impulse[:, own].flatten(1),
            },
        }
        out = run(formula, layouts, given)["out"]
        assert_close(out["u"], u[:, own].flatten(1))
        for k, body in enumerate(touching):
            found[:, 6 * body : 6 * body + 6] += out["f"][:, 6 * k : 6 * k + 6]
        found[:, column : column + width] = out["f"][:, 6 * count :][:, :width]
        assert not bool(out["f"][:, 6 * count + width :].any())
        column += width
    assert_close(found, pulled)


@pytest.mark.parametrize(("name", "bodies"), [*itertools.product(list(WORLDS)[:-1], [1, 2]), ("no ground", 2)])
def test_both_engines_write_the_same_contact_problem(name: str, bodies: int) -> None:
    world = WORLDS[name]
    state, inputs = placed(bodies, world)
    compiled, wanted = Compiled.of(state, inputs, world), formulated(state, inputs, world)
    problem, units = wanted.problem, wanted.units
    touching = (problem.jacobian != 0).any(-1).any(-1)
    assert float(touching.double().mean()) > 0.2
    assert_close(compiled.field("exists"), touching.double())
    for name in ("offset", "friction", "compliance"):
        assert_close(compiled.field(name), getattr(problem, name))
    assert_close(torch.where(touching, compiled.field("gap"), 0.0), torch.where(touching, wanted.gap, 0.0))
    if world.midpoint:
        slip = compiled.field("slip").unflatten(1, (-1, 2))
        assert_close(slip, problem.slip)
        share = compiled.field("share").repeat_interleave(4, 1)
        assert_close(share, wanted.share)
        assert 0 < float(compiled.field("hit").mean()) < 1
    assert_same_velocities(compiled, problem)
    for n in range(bodies):
        body = compiled.records.of[f"body{n}"]
        xx, xy, xz, yy, yz, zz = body["world_inertia"].unbind(1)
        inertia = torch.stack([xx, xy, xz, xy, yy, yz, xz, yz, zz], 1).unflatten(1, (3, 3))
        own = slice(6 * n, 6 * n + 6)
        assert_close(inertia, problem.mass[:, own, own][:, :3, :3])
        assert_close(body["share"], problem.mass[:, 6 * n + 5, 6 * n + 5, None])
        assert_close(body["momentum"], problem.momentum[:, own])
        without = (
            body["free_momentum"] if world.ground is not None else body["momentum"]
        )  # what friction gives before an impact
        assert_close(body["free"], torch.linalg.solve(problem.mass[:, own, own], without))
    assert_close(compiled.records.of["shared"]["mean_mass"], units.mass[:, None])


def test_three_bodies_that_land_and_strike_each_other_in_one_step_have_the_same_contact_problem_in_both_engines() -> (
    None
):
    """Upright cubes in a row, side by side or on top, of which some land, some are struck, and some both."""
    batch, world = BATCH, WORLDS["midpoint"]
    near = uniform(batch, 3, 3, low=-1e-3, high=1e-3, seed=31)
    place = near + torch.tensor([[0, 0, 0.1], [0.2, 0, 0.1], [0.4, 0, 0.1]], dtype=torch.float64)
    place[batch // 2 :, 2] += torch.tensor([-0.2, 0, 0.2], dtype=torch.float64)  # on top of the second
    pose = torch.cat([place, torch.tensor([0, 0, 0, 1.0], dtype=torch.float64).expand(batch, 3, 4)], -1)
    twist = uniform(batch, 3, 6, low=-1, high=1, seed=32)
    twist[..., :2] = 0
    twist[::3, :, 2] = 0
    twist[::4, 1] = 0
    inputs = dataclasses.replace(placed(3, world)[1], size=torch.full((batch, 3, 3), 0.2, dtype=torch.float64))
    state, given = State(pose, twist), inputs.friction * inputs.ground_friction
    compiled, wanted = Compiled.of(state, inputs, world), formulated(state, inputs, world)
    rubs = wanted.problem.friction[:, :12:4]
    assert 0.02 < float(((rubs > 0) & (rubs < (1 - 1e-9) * given)).double().mean()) < 0.98, "some are struck"
    for name in ("offset", "friction", "compliance"):
        assert_close(compiled.field(name), getattr(wanted.problem, name))
    assert_close(compiled.field("slip").unflatten(1, (-1, 2)), wanted.problem.slip)
    for n in range(3):
        assert_close(compiled.records.of[f"body{n}"]["momentum"], wanted.problem.momentum[:, 6 * n : 6 * n + 6])


RULES: tuple[ContactRule, ...] = (
    Speculative(correction=0.25, speed_limit=2.0),
    Penetrating(correction=0.25, speed_limit=2.0),
    Split(correction=0.25, slop=0.125),
)


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: type(rule).__name__)
def test_a_rule_of_contact_is_the_same_in_both_engines_at_each_of_its_edges(rule: ContactRule) -> None:
    """Gaps, speeds and coefficients are halves and quarters, so that sums are exact and the limits are met exactly."""
    h, quarters = 0.25, [-4.0, -1.0, -0.25, 0.0, 0.25, 1.0]
    values = torch.tensor(
        list(
            itertools.product(
                [-4.0, *quarters], [-2.0, -1.0, 0.0, 0.5, 1.5], [-4.0, -1.0, 0.0, 1.0], [0.0, 0.5], [0.0, 0.25]
            )
        ),
        dtype=torch.float64,
    )
    gap, speed, free, restitution, compliance = values.unbind(1)
    reach = REACH + 2 * h * free.abs()
    edge = torch.stack([reach[:80], *values[:80, 1:].unbind(1)], 1)
    values = torch.cat([values, edge])
    values = values[rule.exists(values[:, 0], reach.new_tensor(math.inf))]
    gap, speed, free, restitution, compliance = values.unbind(1)
    step = torch.tensor(h, dtype=torch.float64)
    rigid, spring = (
        rule.offset(gap, speed, free, restitution, step),
        rule.spring(gap, speed, restitution, torch.full_like(gap, 0.5 / h)),
    )
    expected = torch.where((compliance > 0) & (gap < 0), spring, rigid)
    exists = rule.exists(gap, REACH + 2 * h * free.abs())

    def formula(given, numbers, out) -> None:  # noqa: ANN001
        gap, speed, free, restitution, compliance = given["values"]
        half = gap.like(0.5)
        material = touch.Material(friction=gap, restitution=restitution, compliance=compliance, correction=half)
        offset, there = touch.rule(gap, speed, free, material, numbers)
        out["offset"], out["exists"] = [offset], [touch.where(there, 1.0, 0.0)]

    layouts = {"given": sections.Layout(values=5), "numbers": CONSTANTS, "out": sections.Layout(offset=1, exists=1)}
    world = World(time_step=h, contact=rule)
    given = {"given": {"values": values}, "numbers": constants(world)}
    out = run(formula, layouts, given)["out"]
    assert torch.equal(out["exists"][:, 0] > 0.5, exists)
    assert torch.equal(out["offset"][:, 0], expected)


def test_frames_of_contacts_are_the_same_in_both_engines_where_axes_lie_evenly_too() -> None:
    every = [n for n in itertools.product([-1.0, 0.0, 0.5, 1.0], repeat=3) if any(n)]
    normals = torch.nn.functional.normalize(torch.tensor(every, dtype=torch.float64), dim=-1)
    found = evaluate(lambda x: [value for row in touch.frame_of(x) for value in row], normals)
    distinct = normals.abs().sort(1).values.diff(dim=1)[:, 0] > 1e-9  # else either axis may be the first
    assert_close(found[distinct], frame_of(normals)[distinct].flatten(1), 1e-14)
    frames = found.unflatten(1, (3, 3))
    eye = torch.eye(3, dtype=torch.float64).expand_as(frames)
    assert_close(frames @ frames.mT, eye, 1e-14)
    assert_close(torch.linalg.det(frames), torch.ones(len(frames), dtype=torch.float64), 1e-14)


@pytest.mark.parametrize("sizes", [(0.25, 0.25), (0.25, 0.5), (0.5, 0.25)])
def test_both_engines_choose_the_same_points_of_boxes_that_are_placed_evenly(sizes: tuple[float, float]) -> None:
    """One stands on the middle of the other, turned by parts of a right angle: several candidates lie equally far."""
    yaw = torch.linspace(0, math.pi / 2, 7, dtype=torch.float64)
    turn = torch.stack([0 * yaw, 0 * yaw, yaw], 1)
    pose = torch.zeros(7, 2, 7, dtype=torch.float64)
    pose[:, 0, 6], pose[:, 1, 2], pose[:, 1, 3:] = 1.0, sum(sizes) / 2, exponential(turn)
    size = torch.tensor(sizes, dtype=torch.float64)[:, None].expand(7, 2, 3)
    state = State.at_rest(pose)
    world = World(ground=None)
    inputs = nominal_inputs(state, torch.zeros(7, 1, 2, 6, dtype=torch.float64), boxes(mass=[1.0, 1.0]), world)
    inputs = inputs.replace(size=size)
    (expected,) = patches_of(pose, inputs, world)
    compiled = Compiled.of(state, inputs, world)
    points = compiled.field("arm").unflatten(1, (4, 3)) + pose[:, None, 1, :3]
    assert_close(points, expected.point, 1e-9)
    assert_close(compiled.field("exists"), (expected.active & (expected.gap < REACH)).double(), 0.0)
