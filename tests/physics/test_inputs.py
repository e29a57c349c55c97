"""What a simulation is made of: states, parameters, worlds, inputs of steps and sizes of effects."""

from __future__ import annotations

import dataclasses
import math

import pytest
import torch
from torch import Tensor

from physics.worlds import boxes, forces, repeat, state
from physid.effects.dynamics.viscous_drag import ViscousDrag
from physid.effects.perception.camera_offset import CameraOffset
from physid.physics import Effect, Parameters, PhysicsLayer, Plane, SolverError, State, StepInputs, World, quantity
from physid.physics.case import nominal_inputs
from physid.physics.contact import Penetrating, Speculative
from physid.physics.contact_problem.lcp import SolverSettings
from physid.physics.effect import ENDLESS, Quantity, widths_of, with_sizes
from physid.physics.fused.backend import Backend
from physid.physics.schemes.integration import Midpoint
from physid.physics.shapes.box import Box
from physid.physics.shapes.sphere import Sphere
from physid.physics.state import QUATERNION_TOLERANCE, check_shape

DTYPE = torch.float64


def tensor(*values: float) -> Tensor:
    return torch.tensor(values, dtype=DTYPE)


def test_a_shape_fits_where_each_axis_has_its_length_or_may_have_any() -> None:
    value = torch.zeros(2, 3)
    for shape in ((2, 3), (None, 3), (2, None), (None, None)):
        check_shape("x", value, shape)
    for shape in ((2, 4), (3, 3), (None, 2), (2,), (None, None, None)):
        with pytest.raises(ValueError, match=r"x must have shape \(.*\), got \(2, 3\)"):
            check_shape("x", value, shape)
    for bad, count in ((tensor(1, math.inf, math.nan), 2), (tensor(math.nan), 1)):
        with pytest.raises(ValueError, match=f"x must be finite, got {count} of {len(bad)} values"):
            check_shape("x", bad, (None,))


@pytest.mark.parametrize("sign", [-1, 1])
def test_quaternions_of_a_batch_may_be_off_unit_length_by_the_tolerance_and_no_more(sign: int) -> None:
    pose = repeat(state([[0, 0, 0.1], [1, 0, 0.1]]), 3).pose.clone()
    pose[1, 1, 6] = 1 + sign * 0.99 * QUATERNION_TOLERANCE
    assert torch.equal(State.at_rest(pose).pose, pose)
    pose[1, 1, 6] = 1 + sign * 1.01 * QUATERNION_TOLERANCE
    with pytest.raises(ValueError, match=f"got one of length {float(pose[1, 1, 6]):.6g};"):
        State.at_rest(pose)


def test_a_state_is_read_by_its_parts() -> None:
    pose, twist = torch.arange(14, dtype=DTYPE).view(1, 2, 7), torch.arange(12, dtype=DTYPE).view(1, 2, 6)
    now = State(pose, twist)
    assert now.position.tolist() == [[[0, 1, 2], [7, 8, 9]]]
    assert now.quaternion.tolist() == [[[3, 4, 5, 6], [10, 11, 12, 13]]]
    assert now.angular_velocity.tolist() == [[[0, 1, 2], [6, 7, 8]]]
    assert now.velocity.tolist() == [[[3, 4, 5], [9, 10, 11]]]
    assert not bool(State.at_rest(state([[0, 0, 1.0]]).pose).twist.any())
    assert torch.equal(now.replace(twist=twist + 1).twist, twist + 1)


def test_parameters_default_to_uniform_boxes_that_do_not_bounce() -> None:
    size, mass, friction = tensor(0.1, 0.2, 0.3).expand(2, 1, 3), tensor(3.0, 4.0)[:, None], tensor(0.3, 0.5)[:, None]
    known = Parameters.of_boxes(size, mass, friction)
    assert torch.equal(known.inertia, Box().inertia(mass, size))
    assert torch.equal(known.restitution, torch.zeros_like(friction))
    given = Parameters.of_boxes(size, mass, friction, friction + 0.1, size)
    assert torch.equal(given.inertia, size)
    assert torch.equal(given.restitution, friction + 0.1)


def test_bodies_of_several_shapes_have_the_moments_of_each() -> None:
    size, mass = tensor(0.1, 0.1, 0.1).expand(2, 2, 3), tensor(3.0, 4.0).expand(2, 2)
    known = Parameters.of_shapes((Box(), Sphere()), size, mass, 0 * mass, 0 * mass + 0.5)
    for n, shape in enumerate((Box(), Sphere())):
        assert torch.equal(known.inertia[:, n], shape.inertia(mass[:, n], size[:, n]))
    assert torch.equal(known.restitution, 0 * mass + 0.5)


def test_parameters_may_be_zero_where_that_is_possible_and_nowhere_else() -> None:
    fine = boxes().replace(friction=torch.zeros(1, 1, dtype=DTYPE), restitution=torch.zeros(1, 1, dtype=DTYPE))
    assert not bool(fine.friction.any())
    for name in ("size", "mass", "inertia"):
        with pytest.raises(ValueError, match=f"{name} must be positive, got 0"):
            boxes().replace(**{name: 0 * getattr(boxes(), name)})
    for name in ("friction", "restitution"):
        with pytest.raises(ValueError, match=f"{name} must be zero or positive, got -0.5"):
            boxes().replace(**{name: 0 * getattr(boxes(), name) - 0.5})
    two = Parameters.of_boxes(torch.ones(1, 2, 3, dtype=DTYPE), tensor(1.0, 2.0)[None], tensor(1.0, 2.0)[None])
    with pytest.raises(ValueError, match="mass must be positive, got -3"):
        two.replace(mass=tensor(1.0, -3.0)[None])


def test_every_tensor_of_parameters_is_mapped_under_its_name_sizes_of_effects_too() -> None:
    known = boxes().replace(sizes={"viscous_drag.coefficient": tensor(0.5)})
    names: list[str] = []

    def doubled(name: str, value: Tensor) -> Tensor:
        names.append(name)
        return 2 * value

    found = known.map(doubled)
    assert names == ["size", "mass", "inertia", "friction", "restitution", "viscous_drag.coefficient"]
    assert torch.equal(found.mass, 2 * known.mass)
    assert float(found.sizes["viscous_drag.coefficient"]) == 1.0
    with pytest.raises(ValueError, match=r"viscous_drag.coefficient must have shape \(any\)"):
        boxes().replace(sizes={"viscous_drag.coefficient": torch.zeros(1, 1)})


def test_the_normal_of_a_plane_is_made_a_unit_vector() -> None:
    assert Plane((0.0, 3.0, -4.0), 0.5).normal == pytest.approx((0.0, 0.6, -0.8))
    assert Plane((1.0, 2.0, -2.0)).normal == pytest.approx((1 / 3, 2 / 3, -2 / 3))
    assert Plane().normal == (0.0, 0.0, 1.0)
    assert Plane().offset == 0.0
    for normal in ((0.0, 0.0, 0.0), (math.nan, 0.0, 1.0), (math.inf, 0.0, 0.0)):
        with pytest.raises(ValueError, match="normal must be a finite vector other than zero"):
            Plane(normal)


def test_a_world_is_cut_into_steps_and_refuses_what_makes_no_sense() -> None:
    assert World(time_step=0.1, substeps=4).step == pytest.approx(0.025)
    assert World(time_step=0.1, substeps=4).velocity_unit == pytest.approx(9.81 * 0.025)
    assert World(time_step=1e-4, integration=Midpoint()).velocity_unit == pytest.approx(9.81 * 1e-3)
    assert World(substeps=1).substeps == 1
    assert (World().midpoint, World(integration=Midpoint()).midpoint) == (False, True)
    for step in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(ValueError, match=r"time_step must be positive \[s\]"):
            World(time_step=step)
    with pytest.raises(ValueError, match="substeps must be at least 1, got 0"):
        World(substeps=0)
    with pytest.raises(ValueError, match="contact must be left out"):
        World(integration=Midpoint(), contact=Penetrating())
    assert World(integration=Midpoint(), contact=Speculative()).contact == Speculative()


@pytest.mark.parametrize(
    ("low", "high", "typical", "null", "largest"),
    [
        (0.0, 5.0, 1.0, 0.0, 5.0),
        (-7.0, 5.0, 1.0, 0.0, 7.0),
        (0.0, math.inf, 0.5, 0.0, 0.5 * ENDLESS),
        (0.5, math.inf, 1.5, 1.0, 0.5 * ENDLESS),
        (-math.inf, 2.0, -3.0, 1.0, 4.0 * ENDLESS),
        (0.5, 3.0, 0.8, 1.0, 2.0),
    ],
)
def test_the_largest_size_of_an_effect_is_the_further_end_of_its_range_or_many_typical_ones(
    low: float, high: float, typical: float, null: float, largest: float
) -> None:
    assert Quantity("m", low, high, typical, null).largest == pytest.approx(largest)


def test_a_quantity_is_its_null_value_until_it_is_given() -> None:
    @dataclasses.dataclass(frozen=True)
    class Scaled(Effect):
        name = "scaled"
        site = "dynamics"
        factor: Tensor = quantity("1", 0.5, 2.0, 1.2, null=1.0)
        other: Tensor = quantity("m", 0.0, 2.0, 1.2)

    assert (float(Scaled().factor), float(Scaled().other)) == (1.0, 0.0)
    assert Scaled().factor.shape == (1,)
    assert Scaled().factor.dtype == DTYPE
    assert Scaled.quantities()["factor"] == Quantity("1", 0.5, 2.0, 1.2, 1.0)
    now, inputs = given()
    effect = Scaled(tensor(1.5))
    assert effect.act(now, inputs) is inputs
    times = torch.zeros(1, 3, dtype=DTYPE)
    assert effect.elapse(times) is times
    assert effect.actuate(times, times) is times
    assert effect.observe(times, times) is times
    assert effect.to(torch.zeros(1)).factor.dtype == torch.float32


def given(bodies: int = 2, batch: int = 3) -> tuple[State, StepInputs]:
    places = [[0.3 * n, 0, 0.1] for n in range(bodies)]
    now = repeat(state(places), batch)
    wrench = torch.arange(batch * bodies * 6, dtype=DTYPE).view(batch, 1, bodies, 6)
    return now, nominal_inputs(now, wrench, boxes(mass=[1.0] * bodies), World(ground=Plane((0, 0, 2.0), 0.25)))


def test_forces_and_torques_are_added_where_they_belong() -> None:
    _, inputs = given()
    push = torch.ones(3, 2, 3, dtype=DTYPE)
    zero = 0 * push
    torch.testing.assert_close(inputs.add_force(push).wrench - inputs.wrench, torch.cat([zero, push], -1))
    torch.testing.assert_close(inputs.add_torque(push).wrench - inputs.wrench, torch.cat([push, zero], -1))


def test_inputs_that_are_not_given_are_nominal_and_all_have_the_shapes_of_their_kinds() -> None:
    now, inputs = given()
    ones, zeros = ("ground_friction", "body_friction"), ("ground_restitution", "body_restitution", "compliance", "time")
    assert all(bool((getattr(inputs, name) == 1).all()) for name in ones)
    assert all(not bool(getattr(inputs, name).any()) for name in (*zeros, "centre_of_mass"))
    for kind, axes in (("body", (3, 2)), ("world", (3,)), ("instant", (3,))):
        for name, width in widths_of(kind).items():
            lead = (3, 2) if name == "wrench" else axes
            assert getattr(inputs, name).shape == (lead if width == 1 else (*lead, width)), name
    assert inputs.ground_normal.tolist() == [0, 0, 1]
    assert float(inputs.ground_offset) == 0.25
    assert inputs.gravity.tolist() == [[[0, 0, -9.81]] * 2] * 3
    assert bool((inputs.mass == 1).all())
    assert inputs.wrench[:, 0, 0].tolist() == [0, 12, 24]
    none = nominal_inputs(now, torch.zeros(3, 1, 2, 6, dtype=DTYPE), boxes(mass=[1.0, 1.0]), World(ground=None))
    assert float(none.ground_offset) == -math.inf
    assert none.ground_normal.tolist() == [0, 0, 1]
    kept = inputs.tensors(but=("ground", "instant"))
    assert {"ground_normal", "ground_offset", "time", "wrench"}.isdisjoint(kept)
    assert {"mass", "body_friction"} <= kept.keys()
    assert {"time", "ground_normal"} <= inputs.tensors().keys()


def test_sizes_of_effects_are_replaced_by_name_and_the_others_are_left() -> None:
    effects = (ViscousDrag(tensor(0.2)), CameraOffset(*(tensor(0.1),) * 3))
    assert with_sizes(effects, {}) == effects
    several = tensor(0.5, 0.7)
    drag, camera = with_sizes(effects, {"viscous_drag.coefficient": several})
    assert torch.equal(drag.coefficient, several)  # type: ignore[attr-defined]
    assert camera is effects[1]
    name = next(iter(effects[1].values()))
    drag, camera = with_sizes(effects, {f"{camera.name}.{name}": several})
    assert drag is effects[0]
    values = camera.values()
    assert torch.equal(values[name], several)
    assert all(value.tolist() == [0.1, 0.1] for key, value in values.items() if key != name)
    with pytest.raises(ValueError, match="expected an effect that is at work, found viscous_drag"):
        with_sizes(effects[:1], {"tether.stiffness": several})
    with pytest.raises(ValueError, match="found none"):
        with_sizes((), {"tether.stiffness": several})


def test_a_layer_reports_true_poses_unless_an_effect_of_the_camera_is_at_work() -> None:
    pose = repeat(state([[0, 0, 0.1]]), 2).pose[:, None].expand(2, 4, 1, 7)
    plain = PhysicsLayer(World(), [ViscousDrag(tensor(0.2))])
    assert plain.observe(pose) is pose
    assert not plain.distorts
    off = PhysicsLayer(World(), [CameraOffset(*(tensor(0.1),) * len(CameraOffset.quantities()))])
    assert off.distorts
    assert not torch.equal(off.observe(pose), pose)
    name = f"camera_offset.{next(iter(CameraOffset.quantities()))}"
    other = off.observe(pose, None, boxes().replace(sizes={name: tensor(0.4)}))
    assert float((other - off.observe(pose)).abs().max()) == pytest.approx(0.3)


@pytest.mark.parametrize("backend", ["reference", "fused"])
def test_one_world_that_is_not_solved_is_an_error_that_names_it(backend: Backend) -> None:
    start = State(torch.cat([state([[0, 0, z]]).pose for z in (0.1, 5.0, 0.1)]), torch.zeros(3, 1, 6, dtype=DTYPE))
    given = start, torch.zeros(3, 2, 1, 6, dtype=DTYPE), boxes()
    easy, hard, _ = PhysicsLayer(World(), backend="reference").rollout(*given).status.newton_steps[:, 0].tolist()
    assert easy < hard
    layer = PhysicsLayer(World(), solver=SolverSettings(max_steps=easy, compliance=(1e-6,)), backend=backend)
    with pytest.raises(SolverError, match=r"1 of 3 contact problems .* at step 0: .* \(first sample: 1\)") as error:
        layer.rollout(*given)
    assert error.value.samples == (1,)


def test_a_rollout_begins_with_the_given_state_and_tells_how_each_step_was_solved() -> None:
    start = state([[0, 0, 0.1]], [[0.5, 0, 0]])
    rollout = PhysicsLayer(World()).rollout(start, forces(4, [[0.0, 0, 0]]), boxes())
    assert torch.equal(rollout.pose[:, 0], start.pose)
    assert torch.equal(rollout.twist[:, 0], start.twist)
    assert rollout.pose.shape == (1, 5, 1, 7)
    assert rollout.impulse.shape == (1, 4, 4, 3)
    assert rollout.status.residual.shape == rollout.status.newton_steps.shape == (1, 4)
    assert rollout.status.newton_steps.dtype == torch.long
    load = rollout.impulse[0, :, :, 0].sum(1)
    torch.testing.assert_close(load, torch.full((4,), 9.81 / 240, dtype=DTYPE), rtol=1e-5, atol=0)


def test_parameters_of_another_number_of_worlds_or_bodies_are_refused_by_name_and_shape() -> None:
    start, push = repeat(state([[0, 0, 0.1]]), 3), torch.zeros(3, 2, 1, 6, dtype=DTYPE)
    layer = PhysicsLayer(World())
    for known, got in ((boxes(mass=[1.0, 2.0]), "1, 2"), (boxes().map(lambda _, x: x.expand(2, *x.shape[1:])), "2, 1")):
        with pytest.raises(ValueError, match=rf"parameters.size must have shape \(1 or 3, 1, \.\.\.\), got \({got}\)"):
            layer.rollout(start, push, known)
    sizes = {"viscous_drag.coefficient": tensor(0.1, 0.2)}
    with pytest.raises(ValueError, match=r"viscous_drag.coefficient must have shape \(1 or 3, \.\.\.\), got \(2,\)"):
        PhysicsLayer(World(), [ViscousDrag(tensor(0.1))]).rollout(start, push, boxes().replace(sizes=sizes))
    shared = layer.rollout(start, push, boxes())
    each = layer.rollout(start, push, boxes().map(lambda _, x: x.expand(3, *x.shape[1:])))
    assert torch.equal(shared.pose, each.pose)
