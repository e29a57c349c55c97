"""One body against the closed forms of mechanics; tolerances are those that the project promises."""

import itertools
import math

import pytest
import torch

from physics.worlds import boxes, forces, state
from physid.physics import PhysicsLayer, Plane, State, World
from physid.physics.contact import ContactRule, Penetrating, Speculative, Split
from physid.physics.contact_problem.friction import Cone, FrictionLaw, Pyramid
from physid.physics.rotations import to_matrix

H = 1 / 240
G = 9.81
VELOCITY = 1e-7
RELATIVE = 1e-6


@pytest.mark.parametrize("law", [Cone(), Pyramid(4), Pyramid(16)])
def test_a_sliding_step_follows_equation_8_of_the_paper(law: FrictionLaw) -> None:
    rollout = PhysicsLayer(World(friction=law)).rollout(
        state([[0, 0, 0.1]], [[0.5, 0, 0]]), forces(1, [[5.0, 0, 0]]), boxes(mass=2.0, friction=0.2)
    )
    expected = 0.5 + 5.0 / 2.0 * H - 0.2 * G * H
    assert abs(float(rollout.twist[0, 1, 0, 3]) - expected) < VELOCITY
    assert rollout.twist[0, 1, 0, [0, 1, 2, 4]].abs().max() < VELOCITY


def test_300_pushed_steps_follow_the_closed_form() -> None:
    rollout = PhysicsLayer(World()).rollout(state([[0, 0, 0.1]]), forces(300, [[4.0, 0, 0]]), boxes(friction=0.3))
    acceleration = 4.0 - 0.3 * G
    expected = acceleration * H**2 * 300 * 301 / 2
    assert float(rollout.pose[0, -1, 0, 0]) == pytest.approx(expected, rel=RELATIVE)


def test_a_push_below_the_friction_bound_moves_nothing() -> None:
    rollout = PhysicsLayer(World()).rollout(state([[0, 0, 0.1]]), forces(100, [[2.5, 0, 0]]), boxes(friction=0.3))
    assert float(rollout.pose[0, -1, 0, 0].abs()) < 1e-7


def test_a_block_slides_down_an_incline_as_equation_9_of_the_paper_says() -> None:
    angle = math.radians(25)
    normal = (math.sin(angle), 0.0, math.cos(angle))
    pose = torch.tensor(
        [[[0.1 * normal[0], 0, 0.1 * normal[2], 0, math.sin(angle / 2), 0, math.cos(angle / 2)]]], dtype=torch.float64
    )
    layer = PhysicsLayer(World(ground=Plane(normal)))
    rollout = layer.rollout(State.at_rest(pose), forces(120, [[0.0, 0, 0]]), boxes(friction=0.2))
    travelled = float((rollout.pose[0, -1, 0, :3] - pose[0, 0, :3]).norm())
    assert travelled == pytest.approx(
        G * (math.sin(angle) - 0.2 * math.cos(angle)) * H**2 * 120 * 121 / 2, rel=RELATIVE
    )


@pytest.mark.parametrize("heading", [0.0, 0.3, math.pi / 4, 1.0])
def test_the_default_friction_is_as_strong_in_every_direction(heading: float) -> None:
    push = [[5 * math.cos(heading), 5 * math.sin(heading), 0.0]]
    rollout = PhysicsLayer(World()).rollout(state([[0, 0, 0.1]]), forces(20, push), boxes(friction=0.3))
    assert float(rollout.twist[0, -1, 0, 3:].norm()) == pytest.approx(20 * H * (5 - 0.3 * G), rel=RELATIVE)


def test_the_papers_four_directions_lose_friction_between_them() -> None:
    push = [[5 * math.cos(math.pi / 4), 5 * math.sin(math.pi / 4), 0.0]]
    rollout = PhysicsLayer(World(friction=Pyramid(4))).rollout(
        state([[0, 0, 0.1]]), forces(20, push), boxes(friction=0.3)
    )
    expected = 20 * H * (5 - 0.3 * G / math.sqrt(2))
    assert float(rollout.twist[0, -1, 0, 3:].norm()) == pytest.approx(expected, rel=RELATIVE)


@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("rule", [None, Penetrating(), Split()])
def test_an_impact_reverses_the_speed_by_the_restitution(restitution: float, rule: Penetrating | Split | None) -> None:
    world = World(gravity=(0, 0, 0), contact=rule) if rule else World(gravity=(0, 0, 0))
    depth = -1e-9 if rule else 0.0
    rollout = PhysicsLayer(world).rollout(
        state([[0, 0, 0.1 + depth]], [[0, 0, -2.0]]), forces(1, [[0.0, 0, 0]]), boxes(restitution=restitution)
    )
    assert float(rollout.twist[0, 1, 0, 5]) == pytest.approx(2.0 * restitution, abs=2 * RELATIVE)


def test_a_box_that_stops_at_the_ground_stops_where_it_touches() -> None:
    rollout = PhysicsLayer(World()).rollout(
        state([[0, 0, 0.1 + 3e-3]], [[0, 0, -2.0]]), forces(60, [[0.0, 0, 0]]), boxes()
    )
    assert float(rollout.pose[0, -1, 0, 2]) == pytest.approx(0.1, abs=1e-6)
    assert float(rollout.pose[0, :, 0, 2].min()) > 0.1 - 1e-6


def test_equal_boxes_exchange_their_velocities_and_so_do_the_gradients() -> None:
    layer = PhysicsLayer(World(gravity=(0, 0, 0), ground=None))
    start = state([[0, 0, 0], [0.2, 0, 0]], [[1, 0, 0], [0, 0, 0]])
    twist = start.twist.clone().requires_grad_()
    rollout = layer.rollout(
        State(start.pose, twist), forces(1, [[0.0, 0, 0]] * 2), boxes(mass=[1.0, 1.0], restitution=1.0)
    )
    after = rollout.twist[0, 1, :, 3]
    torch.testing.assert_close(after.detach(), torch.tensor([0.0, 1.0], dtype=torch.float64), rtol=0, atol=RELATIVE)
    for body, expected in ((0, [0.0, 1.0]), (1, [1.0, 0.0])):
        (gradient,) = torch.autograd.grad(after[body], twist, retain_graph=True)
        wanted = torch.tensor(expected, dtype=torch.float64)
        torch.testing.assert_close(gradient[0, :, 3], wanted, rtol=0, atol=RELATIVE)


def test_free_flight_converges_with_order_one_to_the_parabola() -> None:
    errors = []
    for substeps in (1, 2, 4, 8):
        layer = PhysicsLayer(World(time_step=0.05, substeps=substeps, ground=None))
        rollout = layer.rollout(state([[0, 0, 0]], [[1.0, 0, 3.0]]), forces(6, [[0.0, 0, 0]]), boxes())
        errors.append(abs(float(rollout.pose[0, -1, 0, 2]) - (3.0 * 0.3 - 0.5 * G * 0.3**2)))
    slopes = [math.log2(a / b) for a, b in itertools.pairwise(errors)]
    assert all(abs(slope - 1) < 0.05 for slope in slopes)


def test_a_free_top_keeps_its_angular_momentum_and_without_the_gyroscopic_term_does_not() -> None:
    drifts = {}
    for gyroscopic in (True, False):
        world = World(time_step=1e-3, gravity=(0, 0, 0), ground=None, gyroscopic=gyroscopic)
        parameters = boxes()
        inertia = torch.tensor([[[0.002, 0.004, 0.005]]], dtype=torch.float64)
        rollout = PhysicsLayer(world).rollout(
            state([[0, 0, 0]], spin=[[1.0, 6.0, 0.5]]), forces(100, [[0.0, 0, 0]]), parameters.replace(inertia=inertia)
        )
        axes = to_matrix(rollout.pose[0, :, 0, 3:])
        momentum = (axes * inertia[0, 0]) @ axes.mT @ rollout.twist[0, :, 0, :3, None]
        drifts[gyroscopic] = float((momentum[-1] - momentum[0]).norm() / momentum[0].norm())
    assert drifts[True] < 2e-3
    assert drifts[False] > 0.05


def test_split_impulses_remove_an_overlap_without_velocity_or_friction() -> None:
    rule = Split(correction=0.2, slop=0.0)
    rollout = PhysicsLayer(World(gravity=(0, 0, 0), contact=rule)).rollout(
        state([[0, 0, 0.1 - 1e-3]], [[0.5, 0, 0]]), forces(3, [[0.0, 0, 0]]), boxes(friction=0.5)
    )
    depth = 0.1 - rollout.pose[0, :, 0, 2]
    torch.testing.assert_close(depth, 1e-3 * 0.8 ** torch.arange(4, dtype=torch.float64), rtol=0, atol=1e-6)
    # A contact without load carries an impulse of sqrt(tau), 1e-4 in units of m g h.
    torch.testing.assert_close(rollout.twist[0, -1, 0], rollout.twist[0, 0, 0], rtol=0, atol=1e-4)


@pytest.mark.parametrize("rule", [Speculative(), Penetrating(), Split()])
def test_an_overlap_is_not_removed_faster_than_a_metre_per_second_however_short_the_step(rule: ContactRule) -> None:
    world = World(time_step=1e-4, gravity=(0, 0, 0), contact=rule)
    rollout = PhysicsLayer(world).rollout(state([[0, 0, 0.09]]), forces(50, [[0.0, 0, 0]]), boxes())
    assert float(rollout.twist.abs().max()) < 1.0 + 1e-3
