"""Effects of contact against closed forms, and the smooth measures that they share."""

import math

import pytest
import torch
from torch import Tensor

from physid.effects import from_values
from physid.effects.probe import draw_probe
from physid.effects.touch import FAR, NEAR, lowest_gap, normal_load, slip, touching
from physid.physics import State, StepInputs
from physid.physics.rotations import rotate
from physid.physics.shapes.box import corner_signs

PROBE = draw_probe()
UP = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)


def acted(name: str, values: dict[str, float], state: State = PROBE.state) -> StepInputs:
    """Return the inputs of a step under an effect."""
    return from_values(name, values).act(state, PROBE.inputs)


def lifted(height: float) -> State:
    """Return the probe's state with both bodies flat, this far above the ground."""
    pose = PROBE.state.pose.clone()
    pose[..., 2], pose[..., 3:] = PROBE.inputs.size[..., 2] / 2 + height, UP.new_tensor([0, 0, 0, 1.0])
    return PROBE.state.replace(pose=pose)


def sliding(velocity: list[float]) -> State:
    """Return bodies on the ground that slide without spin."""
    state = lifted(0.0)
    return state.replace(twist=UP.new_tensor([0.0, 0.0, 0.0, *velocity]).expand_as(state.twist))


def test_the_lowest_gap_is_that_of_the_lowest_corner() -> None:
    arms = corner_signs(UP) * PROBE.inputs.size[:, :, None] / 2
    corners = PROBE.state.position[:, :, None] + rotate(PROBE.state.quaternion[:, :, None], arms)
    assert torch.allclose(lowest_gap(PROBE.state, PROBE.inputs), corners[..., 2].amin(-1), atol=1e-12)


def test_touch_is_whole_on_the_ground_and_nothing_above_three_millimetres() -> None:
    for height, wanted in ((-1e-4, 1.0), (NEAR, 1.0), ((NEAR + FAR) / 2, 0.5), (FAR, 0.0), (1.0, 0.0)):
        assert torch.allclose(touching(lifted(height), PROBE.inputs), torch.full((3, 2), wanted).double(), atol=1e-9)


def test_nothing_touches_where_there_is_no_ground() -> None:
    inputs = PROBE.inputs.replace(ground_offset=torch.tensor(-math.inf, dtype=torch.float64))
    assert not touching(PROBE.state, inputs).any()
    across = PROBE.state.velocity * UP.new_tensor([1.0, 1.0, 0.0])
    assert torch.allclose(slip(PROBE.state, inputs), across)


def test_the_load_is_weight_less_what_lifts() -> None:
    lift = torch.tensor([0.0, 0, 0, 0, 0, 3.0]).double().expand(3, 2, 6)
    load = normal_load(PROBE.inputs.replace(wrench=lift))
    assert torch.allclose(load, 9.81 * PROBE.inputs.mass - 3.0)
    assert not normal_load(PROBE.inputs.replace(wrench=100 * lift)).any()


def test_a_rolling_body_does_not_slip() -> None:
    state = lifted(0.0)
    height, twist = state.position[..., 2], torch.zeros(3, 2, 6).double()
    twist[..., 1], twist[..., 3] = 2.0, 2.0 * height
    assert slip(state.replace(twist=twist), PROBE.inputs).abs().max() < 1e-12
    raised = PROBE.inputs.replace(ground_offset=UP.new_tensor(0.3))
    above = torch.cat([state.position + 0.3 * UP, state.quaternion], -1)
    assert slip(state.replace(pose=above, twist=twist), raised).abs().max() < 1e-12


def test_stribeck_friction_is_raised_at_rest_and_bare_at_speed() -> None:
    for speed, rise in ((0.0, 0.5), (0.2, 0.5 / math.e), (2.0, 0.0)):
        factor = acted("stribeck_friction", {"rise": 0.5}, sliding([0.0, speed, 0.0])).ground_friction
        assert torch.allclose(factor, torch.full((3, 2), 1 + rise).double(), atol=1e-9)


def test_anisotropic_friction_is_high_along_the_grain_and_low_across() -> None:
    for heading, wanted in ((0.0, 1.3), (0.5, 0.7), (0.25, 1.0), (1.0, 1.3)):
        velocity = [10 * math.cos(heading * math.pi), 10 * math.sin(heading * math.pi), 0.0]
        factor = acted("anisotropic_friction", {"along": 0.3}, sliding(velocity)).ground_friction
        assert torch.allclose(factor, torch.full((3, 2), wanted).double(), atol=1e-5)
    oblique = acted("anisotropic_friction", {"oblique": 0.3}, sliding([10.0, 10.0, 0.0])).ground_friction
    assert torch.allclose(oblique, torch.full((3, 2), 1.3).double(), atol=1e-5)


@pytest.mark.parametrize("name", ["anisotropic_friction", "body_anisotropic_friction"])
def test_a_grain_fades_out_below_a_centimetre_a_second(name: str) -> None:
    for speed, share in ((0.0, 0.0), (0.005, 0.2), (0.01, 0.5), (0.03, 0.9)):  # v^2 / (v^2 + (0.01 m/s)^2)
        factor = acted(name, {"along": 0.3}, sliding([speed, 0.0, 0.0])).ground_friction
        assert torch.allclose(factor, UP.new_tensor(1 + 0.3 * share).expand(3, 2))


@pytest.mark.parametrize("yaw", [0.0, 0.4, 2.0])
def test_the_grain_of_a_sole_turns_with_the_body(yaw: float) -> None:
    values = {"along": 0.3, "oblique": -0.2}
    for heading in (0.0, 0.9, 1.6, 2.5):
        turned = sliding([10 * math.cos(heading + yaw), 10 * math.sin(heading + yaw), 0.0])
        pose = turned.pose.clone()
        pose[..., 3:] = UP.new_tensor([0, 0, math.sin(yaw / 2), math.cos(yaw / 2)])
        of_body = acted("body_anisotropic_friction", values, turned.replace(pose=pose)).ground_friction
        straight = sliding([10 * math.cos(heading), 10 * math.sin(heading), 0.0])
        assert torch.allclose(of_body, acted("anisotropic_friction", values, straight).ground_friction, atol=1e-9)


def test_a_friction_gradient_follows_the_place() -> None:
    x, y, _ = PROBE.state.position.unbind(-1)
    factor = acted("friction_gradient", {"x": 0.2, "y": -0.3}).ground_friction
    assert torch.allclose(factor, 1 + 0.2 * x - 0.3 * y)


def test_a_friction_drift_follows_the_time() -> None:
    factor = acted("friction_drift", {"rate": 0.4}).ground_friction
    assert torch.allclose(factor, (1 + 0.4 * PROBE.inputs.time)[:, None].expand(3, 2))
    later = PROBE.inputs.replace(time=UP.new_tensor([0.5, 2.0, 9.0]))
    worn = from_values("friction_drift", {"rate": -0.4}).act(PROBE.state, later).ground_friction
    assert torch.allclose(worn, UP.new_tensor([0.8, 0.2, 0.0])[:, None].expand(3, 2))


def test_torsional_friction_opposes_a_fast_spin_with_r_mu_n_on_the_ground_alone() -> None:
    twist = torch.tensor([0.0, 0, 50.0, 0, 0, 0]).double().expand(3, 2, 6)
    inputs = PROBE.inputs
    wanted = -0.02 * inputs.friction * normal_load(inputs)
    torque = acted("torsional_friction", {"radius": 0.02}, lifted(0.0).replace(twist=twist)).wrench - inputs.wrench
    assert torch.allclose(torque[..., 2], wanted)
    slow = acted("torsional_friction", {"radius": 0.02}, lifted(0.0).replace(twist=twist / 500))  # half of 0.2 rad/s
    assert torch.allclose((slow.wrench - inputs.wrench)[..., 2], math.tanh(0.5) * wanted)
    flying = acted("torsional_friction", {"radius": 0.02}, lifted(0.1).replace(twist=twist))
    assert torch.equal(flying.wrench, inputs.wrench)


def test_load_dependent_friction_follows_a_power_of_the_load() -> None:
    factor = acted("load_dependent_friction", {"exponent": -0.3}).ground_friction
    assert torch.allclose(factor, (normal_load(PROBE.inputs) / 10) ** -0.3)


def test_adhesion_presses_with_its_force_where_a_body_touches() -> None:
    def force(state: State) -> Tensor:
        return acted("adhesion", {"force": 2.0}, state).wrench[..., 3:] - PROBE.inputs.wrench[..., 3:]

    assert torch.allclose(force(lifted(0.0)), (-2.0 * UP).expand(3, 2, 3))
    assert not force(lifted(0.1)).any()


def test_each_pair_effect_changes_its_own_pairs() -> None:
    assert torch.allclose(acted("ground_restitution", {"change": 0.2}).ground_restitution, UP.new_tensor(0.2))
    assert torch.allclose(acted("object_restitution", {"change": 0.2}).body_restitution, UP.new_tensor(0.2))
    assert torch.allclose(acted("object_friction", {"change": 0.5}).body_friction, UP.new_tensor(1.5))
    assert torch.allclose(acted("contact_compliance", {"compliance": 1e-4}).compliance, UP.new_tensor(1e-4))
