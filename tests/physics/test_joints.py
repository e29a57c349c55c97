"""Equality joints against the pendulum and the rail."""

import itertools
import math

import pytest
import torch

from physics.worlds import boxes, forces, state
from physid.physics import PhysicsLayer, State, World
from physid.physics.joints import Axis, Fixed, Joint, Point, Slider
from physid.physics.rotations import exponential, rotate
from physid.physics.schemes.integration import Midpoint

G = 9.81


@pytest.mark.parametrize("joint", [Point(0, (0, 0, 0.5), (0, 0, 0)), Axis(0, (0, 0, 0.5), (0, 0, 0), (0, 1, 0))])
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
