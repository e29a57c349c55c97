"""Random contact problems far beyond what recordings hold: laws of the solutions. More in benchmarks/stress.py."""

from __future__ import annotations

import dataclasses
import importlib.util
import math
import sys
from pathlib import Path
from types import ModuleType

import pytest
import torch

from physics.worlds import DTYPE, boxes, forces, state
from physid.physics import Parameters, PhysicsLayer, SolverError, State, World
from physid.physics.contact_problem.lcp import SolverSettings
from physid.physics.rotations import conjugate, rotate
from physid.physics.schemes.impact import LARGEST, late
from physid.physics.schemes.integration import Midpoint, SemiImplicit
from physid.physics.schemes.motion import drift
from physid.physics.shapes.table import find_patches

SCRIPT = Path(__file__).parents[2] / "benchmarks" / "stress.py"
SCHEMES = [SemiImplicit(), Midpoint()]


@pytest.fixture(scope="module")
def stress() -> ModuleType:
    specification = importlib.util.spec_from_file_location("stress", SCRIPT)
    assert specification
    assert specification.loader
    module = importlib.util.module_from_spec(specification)
    sys.modules["stress"] = module
    specification.loader.exec_module(module)
    module.BATCH, module.SAMPLE = 400, 8  # type: ignore[attr-defined]
    return module


@pytest.mark.parametrize("scene", ["flat box", "tumbling box", "two boxes, upright", "two boxes, tumbling"])
@pytest.mark.parametrize("scheme", ["semi-implicit", "midpoint"])
@pytest.mark.slow
def test_what_is_called_solved_obeys_the_laws_of_contact_and_creates_no_energy(
    stress: ModuleType, scene: str, scheme: str
) -> None:
    torch.manual_seed(7)
    case = stress.Case()
    for _ in range(2):
        stress.examine(case, stress.SCENES[scene](), World(integration=stress.SCHEMES[scheme]))
    assert case.problems == 800
    assert case.failed == 0
    assert case.wrong == 0
    assert case.apart == 0
    assert case.repeated < 0.03 * case.problems


def test_the_checks_of_a_solution_see_what_is_wrong(stress: ModuleType) -> None:
    torch.manual_seed(3)
    problems, world = stress.SCENES["flat box"](), World()
    step = stress.solve(problems, world, SolverSettings(), compiled=True)
    touching = step.impulse[..., 0].amax(1) > 1e-3 * step.impulse[..., 0].amax()
    for factor in (1.01, -1.0):
        pushed = step.__class__(step.state, factor * step.impulse, step.residual, step.newton_steps, step.converged)
        solved = stress.Solved.of(problems, world, pushed)
        worst = solved.violation(step.state, torch.ones(400, dtype=torch.bool), midpoint=False)
        assert float(worst[touching].min()) > stress.HONEST


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize("limit", [12, 15, 18])
@pytest.mark.slow
def test_what_the_last_allowed_step_solves_is_not_softened(stress: ModuleType, limit: int, *, compiled: bool) -> None:
    torch.manual_seed(7)
    problems, ladder = stress.SCENES["flat box"](), SolverSettings().compliance
    once, more = (
        stress.solve(problems, World(), SolverSettings(max_steps=limit, compliance=some), compiled=compiled)
        for some in (ladder[:1], ladder)
    )
    solved = once.converged
    assert 40 < int(solved.sum()) < 360
    assert bool(more.converged[solved].all())
    apart = (once.state.twist - more.state.twist).abs().amax((1, 2)) / (1 + once.state.twist.abs().amax((1, 2)))
    assert float(apart[solved].max()) < 1e-9


@pytest.mark.slow
def test_stacks_that_land_at_a_million_times_the_speed_of_a_step_are_hardly_softened(stress: ModuleType) -> None:
    # Contacts that stick are so stiff that what rounding leaves of a velocity is a force: 20 of 400 jammed by that.
    torch.manual_seed(5)
    drawn, step = stress.SCENES["stack of three"](), 1e-3
    twist = torch.zeros_like(drawn.state.twist)
    twist[..., 3], twist[..., 5] = (share * 1e6 * stress.STANDARD_GRAVITY * step for share in (-0.1, -1))
    known = dataclasses.replace(
        drawn.parameters,
        friction=torch.full_like(drawn.parameters.friction, 1.5),
        restitution=torch.zeros_like(drawn.parameters.restitution),
    )
    problems = stress.Problems(State(drawn.state.pose, twist), known, torch.full_like(drawn.step, step))
    once = SolverSettings(compliance=SolverSettings().compliance[:1])
    assert int((~stress.solve(problems, World(), once, compiled=False).converged).sum()) < 8


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_fast_spin_at_a_short_step_is_solved_to_rounding(scheme: Midpoint | SemiImplicit) -> None:
    # A point moves with 500 m/s, 5e5 times g h: no absolute tolerance of 1e-11 can be met.
    start = state([[0, 0, 4.9999]], spin=[[30.0, 0, 95]])
    layer = PhysicsLayer(World(time_step=1e-4, integration=scheme))
    rollout = layer.rollout(start, forces(20, [[0, 0, 0]]), boxes(friction=2.0, size=10.0))
    assert bool(rollout.pose.isfinite().all())
    reference = PhysicsLayer(layer.world, backend="reference").rollout(
        start, forces(20, [[0, 0, 0]]), boxes(friction=2.0, size=10.0)
    )
    torch.testing.assert_close(rollout.twist, reference.twist, rtol=1e-6, atol=1e-6)


def test_impulses_that_balance_do_not_part_a_body_from_its_place() -> None:
    # Pressed by 1000 from both sides with different shares of the step: it stays where it is.
    mass = torch.eye(6, dtype=DTYPE)[None]
    up = torch.tensor([0, 0, 0, 0, 0, 1.0], dtype=DTYPE)
    jacobian = torch.zeros(1, 2, 3, 6, dtype=DTYPE)
    jacobian[0, 0, 0], jacobian[0, 1, 0] = up, -up
    impulse = torch.zeros(1, 2, 3, dtype=DTYPE)
    impulse[0, :, 0] = torch.tensor([1000.5, 1000.0])
    moved = late(mass, jacobian, impulse, torch.tensor([[1.0, 0.3]], dtype=DTYPE), 1)
    assert float(moved.norm()) <= (LARGEST - 0.5) * 0.5 + 1e-12
    alone = late(mass, jacobian[:, :1], impulse[:, :1], torch.tensor([[1.7]], dtype=DTYPE), 1)
    assert float(alone[0, 0, 5]) == pytest.approx(1.2 * 1000.5)


@pytest.mark.parametrize("backend", ["fused", "reference"])
def test_a_body_between_two_impacts_stays_between_them(backend: str) -> None:
    # A light plate on the ground under a heavy box that falls on it: both are reached in one step, at different times.
    size = torch.tensor([[[0.2, 0.2, 0.02], [0.2, 0.2, 0.2]]], dtype=DTYPE)
    parameters = Parameters.of_boxes(
        size, torch.tensor([[0.02, 50.0]], dtype=DTYPE), torch.full((1, 2), 0.5, dtype=DTYPE)
    )
    start = state([[0, 0, 0.02], [0.01, 0, 0.14]], velocity=[[0, 0, -1.0], [0, 0, -3.0]])
    layer = PhysicsLayer(World(time_step=1 / 60, integration=Midpoint()), backend=backend)  # type: ignore[arg-type]
    pose = layer.rollout(start, forces(10, [[0, 0, 0], [0, 0, 0]]), parameters).pose
    way = 3.0 / 60  # of the faster body in a step
    assert float((pose[0, 1:, 0, :3] - torch.tensor([0, 0, 0.01])).abs().max()) < way


def test_a_turn_of_radians_in_a_step_leaves_momentum_and_numbers() -> None:
    torch.manual_seed(0)
    inertia = torch.tensor([[[1.0, 3.0, 3.5]]], dtype=DTYPE)
    upright = torch.tensor([[[0, 0, 0, 1.0]]], dtype=DTYPE)
    for speed in (1.0, 3.0, 10.0, 30.0):
        twist = torch.zeros(1, 1, 6, dtype=DTYPE)
        twist[..., :3] = speed * torch.nn.functional.normalize(torch.randn(3, dtype=DTYPE), dim=0)
        _, quaternion, after = drift(
            upright[..., :3], upright, twist, inertia, torch.ones(1, dtype=DTYPE), gyroscopic=True
        )
        momentum = inertia * twist[..., :3]
        turned = state([[0, 0, 0]]).replace(pose=torch.cat([upright[..., :3], quaternion], -1))
        own = rotate(conjugate(turned.quaternion), after[..., :3])
        now = rotate(turned.quaternion, inertia * own)
        torch.testing.assert_close(now, momentum, rtol=1e-9, atol=1e-9)


def test_a_rollout_that_ends_in_no_number_is_an_error() -> None:
    start = state([[0, 0, 5.0]], velocity=[[0, 0, 1e308]])
    with pytest.raises(SolverError, match="at step 0"):
        PhysicsLayer(World(time_step=10.0, ground=None)).rollout(start, forces(1, [[0, 0, 0]]), boxes())


def test_resting_stacks_stay_where_they_are(stress: ModuleType) -> None:
    for scheme in SCHEMES:
        torch.manual_seed(0)
        stacks, moving, _, way, turn = stress.rest(2, World(integration=scheme), 500, 8)
        assert (stacks, moving) == (8, 0)
        assert max(way, turn) < 1e-5


UPPER = pytest.mark.parametrize("upper", [(0.1, 0.1, 0.05), (0.2, 0.04, 0.03)], ids=["square", "long"])


def turned_stacks(upper: tuple[float, float, float], yaw: torch.Tensor, turn: torch.Tensor) -> tuple[State, Parameters]:
    """Put a box in the middle of a slab that is turned by `turn`, itself turned by `yaw` beyond that."""
    worlds = len(yaw)
    size = torch.tensor([[(0.6, 0.3, 0.05), upper]], dtype=DTYPE).expand(worlds, 2, 3)
    one = torch.ones(worlds, 2, dtype=DTYPE)
    angle = torch.stack([turn, turn + yaw], 1) / 2
    pose = torch.zeros(worlds, 2, 7, dtype=DTYPE)
    pose[:, 0, 2], pose[:, 1, 2] = 0.025, 0.05 + upper[2] / 2
    pose[..., 5], pose[..., 6] = angle.sin(), angle.cos()
    return State(pose, torch.zeros(worlds, 2, 6, dtype=DTYPE)), Parameters.of_boxes(size, one, 0.5 * one)


@UPPER
@pytest.mark.parametrize(
    ("backend", "steps"),
    [
        ("fused", 1000),
        pytest.param("fused", 10_000, marks=pytest.mark.slow),
        pytest.param("reference", 40, marks=pytest.mark.slow),
    ],
)
def test_a_box_on_a_slab_rests_at_any_yaw(backend: str, steps: int, upper: tuple[float, float, float]) -> None:
    # tan(yaw) from 1/2 to 2: two corners of a long box are each the furthest towards two corners of this 2 : 1 slab.
    yaw = torch.linspace(0, torch.pi, 73, dtype=DTYPE)[:: 1 if backend == "fused" else 9]
    start, parameters = turned_stacks(upper, yaw, torch.zeros_like(yaw))
    layer = PhysicsLayer(World(), backend=backend)  # type: ignore[arg-type]
    with torch.no_grad():
        pose = layer.rollout(start, torch.zeros(len(yaw), steps, 2, 6, dtype=DTYPE), parameters).pose
    torch.testing.assert_close(pose[:, -1], start.pose, rtol=0, atol=1e-7)


@UPPER
def test_where_two_boxes_touch_does_not_depend_on_how_both_are_turned(upper: tuple[float, float, float]) -> None:
    # A push on the upper box: it slides, and all that it does turns with the whole.
    yaw = torch.linspace(0.01, 3.1, 12, dtype=DTYPE)
    turn = torch.linspace(-3, 3, 12, dtype=DTYPE)
    ways = []
    for turned in (torch.zeros_like(turn), turn):
        start, parameters = turned_stacks(upper, yaw, turned)
        wrench = torch.zeros(12, 50, 2, 6, dtype=DTYPE)
        wrench[:, :, 1, 3], wrench[:, :, 1, 4] = 8 * turned.cos()[:, None], 8 * turned.sin()[:, None]
        with torch.no_grad():
            pose = PhysicsLayer(World()).rollout(start, wrench, parameters).pose
        x, y = pose[:, -1, 1, 0], pose[:, -1, 1, 1]
        ways.append(torch.stack([x * turned.cos() + y * turned.sin(), y * turned.cos() - x * turned.sin()], 1))
    assert float(ways[0].norm(dim=1).min()) > 0.01
    torch.testing.assert_close(ways[1], ways[0], rtol=1e-5, atol=1e-7)


@UPPER
def test_rounding_does_not_decide_which_corners_carry_a_box_that_stands_evenly(
    upper: tuple[float, float, float],
) -> None:
    start, parameters = turned_stacks(upper, torch.full((64,), math.pi / 4, dtype=DTYPE), torch.zeros(64, dtype=DTYPE))
    generator = torch.Generator().manual_seed(0)
    nudged = start.pose.clone()
    nudged[1:, :, :3] += 1e-14 * torch.randn(63, 2, 3, generator=generator, dtype=DTYPE)
    (patch,) = find_patches((), nudged, parameters.size, None)
    assert torch.equal(patch.active[1:], patch.active[:1].expand(63, -1))
    torch.testing.assert_close(patch.point[1:], patch.point[:1].expand(63, -1, -1), rtol=0, atol=1e-9)
