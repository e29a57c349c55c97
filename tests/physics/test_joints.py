"""Equality joints against the pendulum and the rail."""

import itertools
import math

import pytest
import torch

from physics.worlds import boxes, forces, state
from physid.physics import PhysicsLayer, State, World
from physid.physics.joints import Axis, Fixed, Joint, Point, Slider, equations_of
from physid.physics.rotations import exponential, multiply, rotate
from physid.physics.schemes.integration import Midpoint

G = 9.81


@pytest.mark.parametrize(
    "joint",
    [
        Point(0, (0, 0, 0.5), (0, 0, 0)),
        Axis(0, (0, 0, 0.5), (0, 0, 0), (0, 1, 0)),
    ],
)
@pytest.mark.slow
def test_a_physical_pendulum_swings_with_the_period_of_the_closed_form(joint: Joint) -> None:
    parameters, length = boxes(mass=1.0), 0.5
    inertia = float(parameters.inertia[0, 0, 1]) + length**2
    period = 2 * math.pi * math.sqrt(inertia / (G * length))
    steps = 400
    layer = PhysicsLayer(World(time_step=period / steps, ground=None, joints=(joint,)))
    angle = 0.02
    start = state([[-length * math.sin(angle), 0, -length * math.cos(angle)]])
    tilted = torch.tensor([0, math.sin(angle / 2), 0, math.cos(angle / 2)], dtype=torch.float64)
    start = start.replace(pose=torch.cat([start.position, tilted.expand(1, 1, 4)], -1))
    rollout = layer.rollout(start, forces(steps, [[0.0, 0, 0]]), parameters)
    swing = rollout.pose[0, :, 0, 0] / -length
    assert float(swing[-1]) == pytest.approx(angle, rel=0.02)
    assert float(swing[steps // 2]) == pytest.approx(-angle, rel=0.02)
    distance = rollout.pose[0, :, 0, :3].norm(dim=-1)
    assert float((distance - length).abs().max()) < 1e-6


def test_a_bead_on_an_inclined_rail_falls_with_the_sine_of_the_angle() -> None:
    angle = 0.4
    axis = (math.cos(angle), 0.0, -math.sin(angle))
    layer = PhysicsLayer(World(ground=None, joints=(Slider(0, (0, 0, 0), axis),)))
    rollout = layer.rollout(state([[0, 0, 0]]), forces(100, [[0.0, 0, 0]]), boxes())
    h = 1 / 240
    travelled = rollout.pose[0, -1, 0, :3] @ torch.tensor(axis, dtype=torch.float64)
    assert float(travelled) == pytest.approx(G * math.sin(angle) * h**2 * 100 * 101 / 2, rel=1e-9)
    assert float((rollout.pose[0, :, 0, 3:6]).abs().max()) < 1e-12


def test_a_weld_holds_against_gravity_force_and_torque() -> None:
    layer = PhysicsLayer(World(ground=None, joints=(Fixed(0, (0, 0, 1.0)),)))
    wrench = forces(50, [[3.0, -2.0, 1.0]])
    wrench[..., :3] = 0.5
    rollout = layer.rollout(state([[0, 0, 1.0]]), wrench, boxes())
    torch.testing.assert_close(rollout.pose[:, -1], rollout.pose[:, 0], rtol=0, atol=1e-12)


def test_a_wrong_start_is_pulled_onto_the_joint_in_one_step() -> None:
    layer = PhysicsLayer(World(ground=None, gravity=(0, 0, 0), joints=(Fixed(0, (0, 0, 1.0)),)))
    rollout = layer.rollout(state([[0.01, 0, 1.0]]), forces(1, [[0.0, 0, 0]]), boxes())
    assert float(rollout.pose[0, 1, 0, 0].abs()) < 1e-12


def test_gradients_flow_through_a_joint() -> None:
    layer = PhysicsLayer(World(ground=None, joints=(Point(0, (0, 0, 0.3), (0, 0, 0)),)))
    start = state([[0, 0, -0.3]])

    def swing(force: torch.Tensor) -> torch.Tensor:
        wrench = torch.zeros(1, 10, 1, 6, dtype=torch.float64)
        wrench = wrench + torch.nn.functional.pad(force, (3, 2))
        return layer.rollout(start, wrench, boxes()).pose[0, -1, 0, :3]

    assert torch.autograd.gradcheck(swing, (torch.tensor([2.0], dtype=torch.float64, requires_grad=True),), atol=1e-8)


def test_a_zero_axis_is_refused() -> None:
    layer = PhysicsLayer(World(ground=None, joints=(Slider(0, (0, 0, 0), (0, 0, 0)),)))
    with pytest.raises(ValueError, match="axis must not be zero"):
        layer.rollout(state([[0, 0, 0]]), forces(1, [[0.0, 0, 0]]), boxes())


@pytest.mark.slow
def test_a_pendulum_under_midpoint_converges_with_order_two() -> None:
    turn = exponential(torch.tensor([0, 0.6, 0], dtype=torch.float64))
    place = -rotate(turn, torch.tensor([0, 0, 0.3], dtype=torch.float64))
    start, hinge = State.at_rest(torch.cat([place, turn])[None, None]), Axis(0, (0, 0, 0.3), (0, 0, 0), (0, 1, 0))
    ends = []
    for rate in (30, 60, 120, 240):
        world = World(time_step=1 / rate, ground=None, joints=(hinge,), integration=Midpoint())
        with torch.no_grad():
            ends.append(PhysicsLayer(world).rollout(start, forces(rate, [[0.0, 0, 0]]), boxes()).pose[0, -1, 0])
    changes = [float((a - b).norm()) for a, b in itertools.pairwise(ends)]
    assert min(math.log2(a / b) for a, b in itertools.pairwise(changes)) > 1.9


def joints() -> list[Joint]:
    axis = (0.6, 0.0, 0.8)
    place = (0.1, -0.2, 0.3)
    return [
        Point(1, (0.1, 0.2, -0.3), place),
        Fixed(1, place),
        Axis(1, (0.1, 0, 0), place, axis),
        Slider(1, place, axis),
    ]


def near(joint: Joint, batch: int = 3) -> State:
    """Return two bodies each, of which the second is close to where the joint holds it, and moves."""
    generator = torch.Generator().manual_seed(0)
    turn = exponential(1e-4 * torch.randn(batch, 2, 3, generator=generator, dtype=torch.float64))
    pose = torch.cat([torch.randn(batch, 2, 3, generator=generator, dtype=torch.float64), turn], -1)
    local = torch.tensor(getattr(joint, "local", (0.0, 0, 0)), dtype=torch.float64)
    pose[:, 1, :3] = torch.tensor([0.1, -0.2, 0.3], dtype=torch.float64) - rotate(turn[:, 1], local.expand(batch, 3))
    return State(pose, torch.randn(batch, 2, 6, generator=generator, dtype=torch.float64))


@pytest.mark.parametrize("joint", joints(), ids=lambda joint: type(joint).__name__)
def test_the_rows_of_a_joint_are_the_rate_at_which_its_error_grows(joint: Joint) -> None:
    now, step = near(joint), 1e-6
    rows, error = joint.rows(now)
    assert float(error.abs().max()) < 1e-3, "the body is where the joint holds it"
    spin, velocity = step * now.angular_velocity, step * now.velocity
    later = now.replace(pose=torch.cat([now.position + velocity, multiply(exponential(spin), now.quaternion)], -1))
    rate = (joint.rows(later)[1] - error) / step
    found = (rows @ now.twist[:, joint.body, :, None])[..., 0]
    torch.testing.assert_close(found, rate, rtol=0, atol=1e-3)  # to the first order of turns of 1e-4
    assert float(rate.abs().max()) > 0.5


@pytest.mark.parametrize("joint", joints(), ids=lambda joint: type(joint).__name__)
def test_a_joint_holds_its_own_body_and_removes_the_error_within_a_step(joint: Joint) -> None:
    now, h = near(joint), torch.tensor([[0.5], [0.25], [2.0]], dtype=torch.float64)
    rows, error = joint.rows(now)
    jacobian, wanted = joint.equations(now, h)
    assert torch.equal(jacobian[..., 6:], rows)
    assert not bool(jacobian[..., :6].any())
    torch.testing.assert_close(wanted, -error / h)


def test_joints_demand_at_the_midpoint_what_their_turning_adds_on_the_way_to_the_end() -> None:
    both, h = (joints()[0], joints()[2]), torch.full((1, 1), 0.1, dtype=torch.float64)
    before, now = near(both[0]), near(both[1])
    jacobian, wanted = equations_of(both, now, before, h, midpoint=True)
    plain, at_once = equations_of(both, now, before, h, midpoint=False)
    assert torch.equal(jacobian, plain)
    grown = []
    for each in (now, before):
        rows = torch.cat([joint.equations(each, h)[0] for joint in both], 1)
        grown.append((rows @ each.twist.flatten(1)[..., None])[..., 0])
    torch.testing.assert_close(wanted, at_once - 0.75 * (grown[0] - grown[1]))
    none, nothing = equations_of((), now, before, h, midpoint=True)
    assert (none.shape, nothing.shape) == ((3, 0, 12), (3, 0))


def test_worlds_with_joints_move_as_each_alone() -> None:
    layer = PhysicsLayer(World(ground=None, joints=(joints()[2],)))
    start = near(joints()[2])
    push, known = forces(8, [[0.0, 0, 0], [1.0, 2, 3]]), boxes(mass=[1.0, 2.0])
    together = layer.rollout(start, push.expand(3, -1, -1, -1), known)
    for k in range(3):
        alone = layer.rollout(State(start.pose[k : k + 1], start.twist[k : k + 1]), push, known)
        torch.testing.assert_close(together.pose[k], alone.pose[0], rtol=0, atol=1e-12)


def test_a_hinge_or_a_rail_along_nothing_is_refused() -> None:
    for joint in (Axis(0, (0, 0, 0), (0, 0, 0), (0, 0, 0)), Slider(0, (0, 0, 0), (0, 0, 0))):
        with pytest.raises(ValueError, match="axis must not be zero"):
            joint.rows(state([[0, 0, 0.1]]))
