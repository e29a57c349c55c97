"""Effects of the dynamics against closed forms."""

import math

import torch
from torch import Tensor

from physid.effects import CATALOGUE, from_values
from physid.effects.probe import draw_probe
from physid.physics import Parameters, PhysicsLayer, State, StepInputs, World

PROBE = draw_probe()
SMALL_STEP = 1e-3


def acted(name: str, values: dict[str, float]) -> StepInputs:
    """Return the inputs of a step under an effect."""
    return from_values(name, values).act(PROBE.state, PROBE.inputs)


def added_force(name: str, values: dict[str, float]) -> Tensor:
    """Return the force that an effect adds, (B, N, 3)."""
    return acted(name, values).wrench[..., 3:] - PROBE.inputs.wrench[..., 3:]


def free_flight(name: str, values: dict[str, float], twist: list[float], steps: int) -> Tensor:
    """Return the last twist (6,) of a block of 2 kg in free space without gravity."""
    start = State(torch.tensor([[[0.0, 0, 0, 0, 0, 0, 1]]]).double(), torch.tensor([[twist]]).double())
    size = torch.tensor([[[0.3, 0.2, 0.1]]]).double()
    body = Parameters.of_boxes(size, torch.tensor([[2.0]]).double(), torch.tensor([[0.2]]).double())
    world = World(time_step=SMALL_STEP, gravity=(0, 0, 0), ground=None)
    layer = PhysicsLayer(world, [from_values(name, values)])
    return layer.rollout(start, torch.zeros(1, steps, 1, 6).double(), body).twist[0, -1, 0]


def test_viscous_drag_slows_a_body_exponentially() -> None:
    velocity = free_flight("viscous_drag", {"coefficient": 4.0}, [0, 0, 0, 3.0, 0, 0], 100)[3]
    assert math.isclose(float(velocity), 3.0 * math.exp(-4.0 / 2 * 0.1), rel_tol=1e-3)


def test_quadratic_drag_slows_a_body_hyperbolically() -> None:
    velocity = free_flight("quadratic_drag", {"coefficient": 4.0}, [0, 0, 0, 3.0, 0, 0], 100)[3]
    assert math.isclose(float(velocity), 3.0 / (1 + 4.0 / 2 * 3.0 * 0.1), rel_tol=2e-3)


def test_quadratic_drag_is_a_force_of_c_v_squared_however_slow_a_body_is() -> None:
    for speed in (0.0, 1e-6, 0.01, 0.5, 30.0):
        twist = torch.tensor([0.0, 0.0, 0.0, 0.6 * speed, -0.8 * speed, 0.0], dtype=torch.float64).expand(3, 2, 6)
        inputs = PROBE.inputs.replace(wrench=torch.zeros_like(PROBE.inputs.wrench))
        drag = from_values("quadratic_drag", {"coefficient": 2.0}).act(PROBE.state.replace(twist=twist), inputs)
        assert torch.allclose(drag.wrench[..., 3:], -2.0 * speed * twist[..., 3:], rtol=1e-12, atol=0)


def test_a_constant_force_pulls_all_bodies_alike() -> None:
    wanted = torch.tensor([1.0, -2.0, 0.0]).double().expand(3, 2, 3)
    assert torch.allclose(added_force("constant_force", {"x": 1.0, "y": -2.0}), wanted)


def test_gravity_on_tilted_ground_keeps_its_size_and_leans_downhill() -> None:
    gravity = acted("ground_tilt", {"x": 0.1}).gravity
    wanted = 9.81 * torch.tensor([0.0, -math.sin(0.1), -math.cos(0.1)]).double()
    assert torch.allclose(gravity, wanted.expand(3, 2, 3))
    about_y = 9.81 * torch.tensor([math.sin(0.1), 0.0, -math.cos(0.1)]).double()
    assert torch.allclose(acted("ground_tilt", {"y": 0.1}).gravity, about_y.expand(3, 2, 3))


def test_a_gravity_error_scales_gravity() -> None:
    assert torch.allclose(acted("gravity_error", {"change": 0.1}).gravity, 1.1 * PROBE.inputs.gravity)


def test_a_tether_pulls_in_proportion_to_the_distance_from_the_origin() -> None:
    assert torch.allclose(added_force("tether", {"stiffness": 3.0}), -3.0 * PROBE.state.position)


def test_a_push_at_the_middle_turns_a_body_about_its_centre_of_mass() -> None:
    """m a = f and I a_w = -c x f for a centre of mass at c, free of gravity and ground."""
    start = State.at_rest(torch.tensor([[[0.0, 0, 0, 0, 0, 0, 1]]]).double())
    size = torch.tensor([[[0.3, 0.2, 0.1]]]).double()
    body = Parameters.of_boxes(size, torch.tensor([[2.0]]).double(), torch.tensor([[0.2]]).double())
    layer = PhysicsLayer(World(gravity=(0, 0, 0), ground=None), [from_values("com_offset", {"x": 0.05})])
    push = torch.tensor([0.0, 0, 0, 0, 4.0, 0]).double().expand(1, 1, 1, 6)
    spin, speed = layer.rollout(start, push, body).twist[0, 1, 0, [2, 4]]
    wanted = -0.05 * 4.0 / body.inertia[0, 0, 2] / 240
    assert torch.allclose(spin, wanted, rtol=1e-6)
    # The middle of the box is 0.05 m behind the centre of mass, which gains f / m.
    assert torch.allclose(speed, 4.0 / 2.0 / 240 - 0.05 * wanted, rtol=1e-3)


def test_an_inertia_scale_leaves_the_mass() -> None:
    after = acted("inertia_scale", {"change": 0.5})
    assert torch.allclose(after.inertia, 1.5 * PROBE.inputs.inertia)
    assert torch.equal(after.mass, PROBE.inputs.mass)


def test_no_box_turns_harder_than_with_its_mass_in_its_corners() -> None:
    size, one = torch.tensor([[[0.3, 0.2, 0.05]]]).double(), torch.ones(1, 1).double()
    body = Parameters.of_boxes(size=size, mass=0.8 * one, friction=one)
    corners = torch.cartesian_prod(*[torch.tensor([-0.5, 0.5]).double()] * 3) * size[0, 0]
    x, y, z = (0.8 / 8 * corners.square().sum(0)).tolist()
    known = next(kind for kind in CATALOGUE if kind.name == "inertia_scale").quantities()["change"]
    assert torch.allclose(torch.tensor([y + z, x + z, x + y]).double(), (1 + known.high) * body.inertia[0, 0])


def test_a_drifting_mass_grows_in_proportion_to_time_with_its_moments_and_never_vanishes() -> None:
    inputs = PROBE.inputs.replace(time=torch.tensor([0.0, 1.0, 9.0]).double())
    for rate, shares in ((0.5, [1.0, 1.5, 5.5]), (-0.4, [1.0, 0.6, 0.05])):
        after, share = from_values("mass_drift", {"rate": rate}).act(PROBE.state, inputs), torch.tensor(shares).double()
        assert torch.allclose(after.mass, PROBE.inputs.mass * share[:, None])
        assert torch.allclose(after.inertia, PROBE.inputs.inertia * share[:, None, None])
