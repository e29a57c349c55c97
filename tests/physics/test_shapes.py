"""Shapes beside the box: spheres against closed forms, and what a new shape has to say."""

from __future__ import annotations

import ast
import logging
import math
from dataclasses import dataclass
from pathlib import Path

import pytest
import torch
from tests.physics.worlds import DTYPE, forces, state
from torch import Tensor

from physid.effects.touch import lowest_gap
from physid.physics import Parameters, PhysicsLayer, Plane, Rollout, State, World
from physid.physics.case import nominal_inputs
from physid.physics.contact import Patch
from physid.physics.fused import backend
from physid.physics.schemes.integration import Integration, Midpoint, SemiImplicit
from physid.physics.shapes.box import Box
from physid.physics.shapes.shape import Finder, Placed, Shape
from physid.physics.shapes.sphere import Sphere

G = 9.81
SCHEMES = pytest.mark.parametrize(
    "scheme",
    [pytest.param(SemiImplicit(), id="semi-implicit", marks=pytest.mark.slow), pytest.param(Midpoint(), id="midpoint")],
)


def balls(
    radius: float, mass: list[float], friction: float = 0.5, restitution: float = 0.0, shapes: tuple[Shape, ...] = ()
) -> Parameters:
    masses = torch.tensor([mass], dtype=DTYPE)
    size = torch.full((1, len(mass), 3), 2 * radius, dtype=DTYPE)
    one = torch.ones_like(masses)
    return Parameters.of_shapes(shapes or (Sphere(),) * len(mass), size, masses, friction * one, restitution * one)


def roll(world: World, start: State, parameters: Parameters, steps: int) -> Rollout:
    layer = PhysicsLayer(world, backend="reference")
    return layer.rollout(start, torch.zeros(1, steps, start.pose.shape[1], 6, dtype=DTYPE), parameters)


def slope(angle: float) -> Plane:
    return Plane((math.sin(angle), 0.0, math.cos(angle)))


@SCHEMES
def test_a_ball_rolls_down_a_slope_at_five_sevenths_of_g_sin_alpha(scheme: Integration) -> None:
    angle, radius = 0.3, 0.05
    ground = slope(angle)
    start = state([[radius * x for x in ground.normal]])
    world = World(ground=ground, shapes=(Sphere(),), integration=scheme)
    rollout = roll(world, start, balls(radius, [0.7]), 40)
    downhill = torch.tensor([math.cos(angle), 0.0, -math.sin(angle)], dtype=DTYPE)
    speed = rollout.twist[0, :, 0, 3:] @ downhill
    expected = 5 / 7 * G * math.sin(angle) * torch.arange(41, dtype=DTYPE) * world.time_step
    torch.testing.assert_close(speed, expected, rtol=1e-3, atol=1e-4)
    torch.testing.assert_close(rollout.twist[0, -1, 0, 1] * radius, speed[-1], rtol=1e-3, atol=1e-6)


@SCHEMES
def test_on_a_slope_too_steep_to_roll_a_ball_slides_as_a_block_does(scheme: Integration) -> None:
    angle, friction, radius = 0.6, 0.1, 0.05  # tan(alpha) > 7/2 mu
    ground = slope(angle)
    start = state([[radius * x for x in ground.normal]])
    world = World(ground=ground, shapes=(Sphere(),), integration=scheme)
    rollout = roll(world, start, balls(radius, [1.0], friction), 30)
    distance = rollout.twist[0, -1, 0, 3:].norm()
    assert float(distance) == pytest.approx(G * (math.sin(angle) - friction * math.cos(angle)) * 30 / 240, rel=2e-3)
    assert float(rollout.twist[0, -1, 0, 1]) == pytest.approx(
        5 / 2 * friction * G * math.cos(angle) / radius * 30 / 240, rel=2e-3
    )


@SCHEMES
def test_a_sliding_ball_ends_rolling_at_five_sevenths_of_its_speed(scheme: Integration) -> None:
    start = state([[0, 0, 0.05]], velocity=[[1.0, 0, 0]])
    rollout = roll(World(shapes=(Sphere(),), integration=scheme), start, balls(0.05, [0.3], friction=0.4), 30)
    assert float(rollout.twist[0, -1, 0, 3]) == pytest.approx(5 / 7, rel=1e-3)
    assert float(rollout.twist[0, -1, 0, 1]) == pytest.approx(5 / 7 / 0.05, rel=1e-3)
    assert float((rollout.pose[0, :, 0, 2] - 0.05).abs().max()) < 1e-5


@SCHEMES
def test_a_ball_leaves_the_ground_with_its_restitution_times_the_speed_of_its_fall(scheme: Integration) -> None:
    speed, restitution, gap = 3.0, 0.7, 0.02
    start = state([[0, 0, 0.05 + gap]], velocity=[[0, 0, -speed]])
    world = World(time_step=1 / 1000, shapes=(Sphere(),), integration=scheme)
    rollout = roll(world, start, balls(0.05, [1.0], restitution=restitution), 12)
    allowed = 1e-3 if isinstance(scheme, Midpoint) else 2e-2  # which lets impacts be up to a step early
    energy = rollout.twist[0, -1, 0, 5] ** 2 / 2 + G * (rollout.pose[0, -1, 0, 2] - 0.05)
    assert float(energy) == pytest.approx(restitution**2 * (speed**2 / 2 + G * gap), rel=allowed)


@pytest.mark.slow
@pytest.mark.parametrize("masses", [(1.0, 1.0), (1.0, 3.0)])
def test_balls_that_meet_head_on_exchange_momentum_as_newton_says(masses: tuple[float, float]) -> None:
    world = World(gravity=(0, 0, 0), ground=None, shapes=(Sphere(), Sphere()))
    start = state([[0, 0, 0], [0.25, 0, 0]], velocity=[[2.0, 0, 0], [0, 0, 0]])
    after = roll(world, start, balls(0.05, list(masses), friction=0.0, restitution=math.sqrt(0.8)), 40).twist[
        0, -1, :, 3
    ]
    restitution, (m, n) = 0.8, masses
    common = 2 * m / (m + n)
    expected = [common - restitution * 2 * n / (m + n), common + restitution * 2 * m / (m + n)]
    torch.testing.assert_close(after, torch.tensor(expected, dtype=DTYPE), rtol=1e-4, atol=1e-4)


@pytest.mark.slow
def test_balls_hit_off_centre_part_along_the_line_between_their_centres() -> None:
    world = World(time_step=1 / 2000, gravity=(0, 0, 0), ground=None, shapes=(Sphere(), Sphere()))
    start = state([[0, 0, 0], [0.1, 0.06, 0]], velocity=[[2.0, 0, 0], [0, 0, 0]])
    rollout = roll(world, start, balls(0.05, [1.0, 1.0], friction=0.0, restitution=1.0), 40)
    one, other = rollout.twist[0, -1, :, 3:5]
    assert abs(float(one @ other)) < 2e-2  # equal masses part at right angles (Huygens)
    assert float(other[1] / other[0]) == pytest.approx(0.6 / 0.8, rel=2e-2)


@pytest.mark.slow
def test_a_ball_comes_to_rest_on_a_box_and_falls_off_its_edge() -> None:
    shapes: tuple[Shape, ...] = (Box(), Sphere())
    for x, rests in ((0.05, True), (0.13, False)):
        start = state([[0, 0, 0.05], [x, 0, 0.15]])
        one = torch.ones(1, 2, dtype=DTYPE)
        size = torch.tensor([[[0.2, 0.2, 0.1], [0.1, 0.1, 0.1]]], dtype=DTYPE)
        parameters = Parameters.of_shapes(shapes, size, one, 0.5 * one)
        height = float(roll(World(shapes=shapes), start, parameters, 40).pose[0, -1, 1, 2])
        assert (abs(height - 0.15) < 1e-3) is rests
        assert rests or height < 0.1


@pytest.mark.slow
def test_it_does_not_matter_which_of_two_bodies_is_the_ball() -> None:
    ends = []
    for order in ((0, 1), (1, 0)):
        shapes = tuple((Box(), Sphere())[n] for n in order)
        places, speeds = [[0, 0, 0.05], [-0.13, 0.02, 0.05]], [[0, 0, 0], [2.0, 0, 0]]
        start = state([places[n] for n in order], [speeds[n] for n in order])
        one = torch.ones(1, 2, dtype=DTYPE)
        parameters = Parameters.of_shapes(shapes, 0.1 * one[..., None].expand(1, 2, 3), one, 0.5 * one)
        ends.append(roll(World(shapes=shapes), start, parameters, 20).pose[0, -1, list(order)])
    torch.testing.assert_close(ends[0], ends[1], rtol=0, atol=1e-7)
    assert float(ends[0][0, 0]) > 0.01


@SCHEMES
def test_gradients_of_a_ball_are_those_of_differences(scheme: Integration) -> None:
    start = state([[0, 0, 0.05]], velocity=[[1.0, 0.2, 0]])
    world = World(shapes=(Sphere(),), integration=scheme)

    def end(values: Tensor) -> Tensor:
        one = torch.ones(1, 1, dtype=DTYPE)
        size = (values[0] * one)[..., None].expand(1, 1, 3)
        parameters = Parameters.of_shapes((Sphere(),), size, values[1] * one, values[2] * one)
        lifted = State(start.pose + torch.eye(7, dtype=DTYPE)[2] * (values[0] / 2 - 0.05), start.twist)
        layer = PhysicsLayer(world, backend="reference")
        return layer.rollout(lifted, forces(6, [[0.3, 0, 0]]), parameters).pose[0, -1, 0, :2].sum()

    at = torch.tensor([0.1, 0.5, 0.2], dtype=DTYPE)
    exact = torch.autograd.functional.jacobian(end, at)
    for k in range(3):
        step = 1e-6 * at[k] * torch.eye(3, dtype=DTYPE)[k]
        slope_k = (end(at + step) - end(at - step)) / (2e-6 * at[k])
        torch.testing.assert_close(exact[k], slope_k, rtol=1e-4, atol=1e-7)


def test_effects_see_how_far_each_shape_is_from_the_ground() -> None:
    shapes: tuple[Shape, ...] = (Box(), Sphere())
    turned = State.at_rest(
        torch.tensor([[[0, 0, 0.2, 0, math.sin(math.pi / 8), 0, math.cos(math.pi / 8)]] * 2], dtype=DTYPE)
    )
    parameters = balls(0.1, [1.0, 1.0], shapes=shapes)
    inputs = nominal_inputs(turned, torch.zeros(1, 1, 2, 6, dtype=DTYPE), parameters, World(shapes=shapes))
    expected = torch.tensor([[0.2 - 0.1 * math.sqrt(2), 0.1]], dtype=DTYPE)
    torch.testing.assert_close(lowest_gap(turned, inputs), expected)


@pytest.mark.slow
def test_boxes_named_as_such_are_those_that_need_not_be_named() -> None:
    start = state([[0, 0, 0.11], [0.25, 0, 0.1]], velocity=[[1.0, 0, 0], [0, 0, 0]])
    ends = [
        PhysicsLayer(World(shapes=shapes), backend=kind)  # type: ignore[arg-type]
        .rollout(start, torch.zeros(1, 30, 2, 6, dtype=DTYPE), balls(0.1, [1.0, 2.0], shapes=(Box(), Box())))
        .pose
        for kind in ("reference", "fused")
        for shapes in ((), (Box(), Box()))
    ]
    assert torch.equal(ends[0], ends[1])
    assert torch.equal(ends[2], ends[3])


def test_what_is_not_compiled_runs_in_the_reference_and_says_so(caplog: pytest.LogCaptureFixture) -> None:
    start, parameters = state([[0, 0, 0.05]]), balls(0.05, [1.0])
    layer = PhysicsLayer(World(shapes=(Sphere(),)))
    backend._say_once.cache_clear()
    with caplog.at_level(logging.WARNING):
        layer.rollout(start, torch.zeros(1, 1, 1, 6, dtype=DTYPE), parameters)
    assert "contacts of a Sphere with the ground are not compiled" in caplog.text
    with pytest.raises(ValueError, match="Sphere"):
        PhysicsLayer(World(shapes=(Sphere(),)), backend="fused").rollout(
            start, torch.zeros(1, 1, 1, 6, dtype=DTYPE), parameters
        )
    pair = World(ground=None, shapes=(Box(), Sphere()))
    with pytest.raises(ValueError, match="contacts of Box and Sphere are not compiled"):
        PhysicsLayer(pair, backend="fused").rollout(
            state([[0, 0, 0], [1, 0, 0]]), torch.zeros(1, 1, 2, 6, dtype=DTYPE), balls(0.05, [1.0, 1.0])
        )


def test_each_body_has_a_shape() -> None:
    with pytest.raises(ValueError, match=r"world\.shapes .* 1 bodies, .* got 2"):
        roll(World(shapes=(Sphere(), Sphere())), state([[0, 0, 0.05]]), balls(0.05, [1.0]), 1)


@dataclass(frozen=True)
class Pin(Shape):
    """A point mass on a stiff needle: touches in the point at its tip, and knows no other shape."""

    def inertia(self, mass: Tensor, size: Tensor) -> Tensor:
        return mass[..., None] * size**2

    def reach(self, quaternion: Tensor, size: Tensor, normal: Tensor) -> Tensor:
        return size[..., 2] / 2

    def on_plane(self, body: Placed, normal: Tensor, offset: Tensor) -> Patch:
        return Sphere().on_plane(body, normal, offset)

    def meets(self, other: Shape) -> Finder | None:
        return None


def test_a_shape_of_ones_own_runs_and_one_that_no_other_knows_is_named_before_anything_runs() -> None:
    rollout = roll(World(shapes=(Pin(),)), state([[0, 0, 0.05]]), balls(0.05, [1.0], shapes=(Pin(),)), 10)
    assert abs(float(rollout.pose[0, -1, 0, 2]) - 0.05) < 1e-5
    with pytest.raises(ValueError, match="no contacts are known between Sphere and Pin"):
        World(shapes=(Sphere(), Pin()))


def test_the_engine_names_no_shape_outside_its_table() -> None:
    """A new shape is one file: nothing of the step, of the contact problem or of the schemes knows which there are."""
    physics = Path(backend.__file__).parent.parent
    allowed = {"shapes/box.py", "shapes/sphere.py", "shapes/table.py", "fused/backend.py", "parameters.py"}
    for path in physics.rglob("*.py"):
        named = [node.module for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.ImportFrom)]
        shapes = [name for name in named if name in ("physid.physics.shapes.box", "physid.physics.shapes.sphere")]
        assert not shapes or path.relative_to(physics).as_posix() in allowed, path
