"""The layer as a whole: invariances, energy, gradients per contact mode, and its errors."""

import importlib.util
import math
from pathlib import Path
from types import ModuleType

import pytest
import torch

from physics.worlds import boxes, forces, repeat, state
from physid.effects.actuation.force_gain import ForceGain
from physid.effects.dynamics.viscous_drag import ViscousDrag
from physid.effects.perception.observation_latency import ObservationLatency
from physid.physics import Parameters, PhysicsLayer, Plane, SolverError, State, World
from physid.physics.contact_problem.lcp import SolverSettings
from physid.physics.rotations import exponential, multiply, rotate


def _benchmark(name: str) -> ModuleType:
    path = Path(__file__).parents[2] / "benchmarks" / f"{name}.py"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    import sys

    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


GRADIENTS = _benchmark("gradients")


@pytest.mark.parametrize("case", GRADIENTS.CASES, ids=lambda case: case.name)
@pytest.mark.parametrize("steps", [1, 30])
def test_gradients_agree_with_central_differences_in_every_contact_mode(case, steps: int) -> None:  # noqa: ANN001
    errors = GRADIENTS.gradient_error(case, steps)
    assert max(errors.values()) < case.tolerance, errors


def toss(batch: int) -> State:
    generator = torch.Generator().manual_seed(3)
    quaternion = torch.nn.functional.normalize(
        torch.randn(batch, 1, 4, generator=generator, dtype=torch.float64), dim=-1
    )
    place = torch.tensor([0, 0, 0.25], dtype=torch.float64).expand(batch, 1, 3)
    twist = torch.randn(batch, 1, 6, generator=generator, dtype=torch.float64)
    return State(torch.cat([place, quaternion], -1), twist * torch.tensor([3, 3, 3, 1, 1, 0.5]))


def test_a_batch_moves_as_its_members_alone() -> None:
    layer, start = PhysicsLayer(World()), toss(3)
    together = layer.rollout(start, forces(60, [[0.0, 0, 0]]).expand(3, -1, -1, -1), boxes(restitution=0.3))
    for k in range(3):
        alone = layer.rollout(
            State(start.pose[k : k + 1], start.twist[k : k + 1]), forces(60, [[0.0, 0, 0]]), boxes(restitution=0.3)
        )
        torch.testing.assert_close(together.pose[k], alone.pose[0], rtol=0, atol=1e-7)


def test_moving_and_turning_the_world_about_the_vertical_moves_and_turns_the_trajectory() -> None:
    turn = exponential(torch.tensor([0, 0, 0.7], dtype=torch.float64))
    shift = torch.tensor([0.4, -0.3, 0.0], dtype=torch.float64)
    start = toss(4)
    moved = State(
        torch.cat([rotate(turn, start.position) + shift, multiply(turn.expand(4, 1, 4), start.quaternion)], -1),
        torch.cat([rotate(turn, start.angular_velocity), rotate(turn, start.velocity)], -1),
    )
    push = forces(60, [[0.0, 0, 0]]).expand(4, -1, -1, -1)
    here, there = (PhysicsLayer(World()).rollout(s, push, boxes()) for s in (start, moved))
    torch.testing.assert_close(rotate(turn, here.pose[..., :3]) + shift, there.pose[..., :3], rtol=0, atol=1e-7)


def test_contact_and_friction_never_add_energy() -> None:
    rollout = PhysicsLayer(World()).rollout(
        toss(16), forces(150, [[0.0, 0, 0]]).expand(16, -1, -1, -1), boxes(restitution=0.0)
    )
    parameters = boxes()
    inertia = float(parameters.inertia[0, 0, 0])  # a cube's is the same about every axis
    kinetic = 0.5 * rollout.twist[..., 0, 3:].square().sum(-1) + 0.5 * inertia * rollout.twist[..., 0, :3].square().sum(
        -1
    )
    energy = kinetic + 9.81 * rollout.pose[..., 0, 2]
    # Semi-implicit Euler in free flight changes the energy by h^2 g^2 / 2 per step; the removal of overlaps adds less.
    assert float((energy[:, 1:] - energy[:, :-1]).max()) < 2 * (9.81 / 240) ** 2


def test_total_momentum_is_kept_when_two_boxes_collide_in_free_space() -> None:
    layer = PhysicsLayer(World(gravity=(0, 0, 0), ground=None))
    start = state([[0, 0, 0], [0.25, 0.06, 0.02]], [[2, 0, 0], [0, 0, 0]], [[0.3, 0, 1], [0, 0.5, 0]])
    parameters = boxes(mass=[1.0, 2.0], restitution=0.4)
    rollout = layer.rollout(start, forces(40, [[0.0, 0, 0]] * 2), parameters)
    momentum = (rollout.twist[0, :, :, 3:] * parameters.mass[0, :, None]).sum(1)
    assert float(rollout.impulse.abs().max()) > 0.1
    torch.testing.assert_close(momentum, momentum[:1].expand_as(momentum), rtol=0, atol=1e-9)


def test_substeps_refine_a_frame_whose_force_is_held() -> None:
    coarse = PhysicsLayer(World(time_step=1 / 60, substeps=4)).rollout(
        state([[0, 0, 0.1]]), forces(10, [[5.0, 0, 0]]), boxes()
    )
    fine = PhysicsLayer(World(time_step=1 / 240)).rollout(state([[0, 0, 0.1]]), forces(40, [[5.0, 0, 0]]), boxes())
    torch.testing.assert_close(coarse.pose[:, 1:], fine.pose[:, 4::4], rtol=0, atol=1e-9)


def test_checkpointing_over_time_changes_neither_values_nor_gradients() -> None:
    results = []
    for every in (None, 7):
        force = forces(20, [[5.0, 0, 0]]).requires_grad_()
        layer = PhysicsLayer(World(), checkpoint_every=every)
        rollout = layer.rollout(state([[0, 0, 0.1]]), force, boxes())
        rollout.pose[0, -1, 0, 0].backward()
        results.append((rollout.pose.detach(), force.grad))
    for one, other in zip(*results, strict=True):
        torch.testing.assert_close(one, other, rtol=0, atol=1e-12)


def test_viscous_drag_slows_a_free_body_as_the_closed_form_says() -> None:
    drag = ViscousDrag(torch.tensor([0.6], dtype=torch.float64))
    layer = PhysicsLayer(World(gravity=(0, 0, 0), ground=None), effects=[drag])
    rollout = layer.rollout(state([[0, 0, 0]], [[1.0, 0, 0]]), forces(240, [[0.0, 0, 0]]), boxes(mass=1.2))
    assert float(rollout.twist[0, -1, 0, 3]) == pytest.approx(math.exp(-0.6 / 1.2), rel=2e-3)


def test_an_effect_may_have_another_size_in_each_world_of_a_batch() -> None:
    gain = ForceGain(torch.tensor([0.0, 0.5], dtype=torch.float64))
    layer = PhysicsLayer(World(), effects=[gain])
    rollout = layer.rollout(repeat(state([[0, 0, 0.1]]), 2), forces(5, [[4.0, 0, 0]]).expand(2, -1, -1, -1), boxes())
    expected = torch.tensor([4.0 - 0.3 * 9.81, 6.0 - 0.3 * 9.81], dtype=torch.float64) * 5 / 240
    torch.testing.assert_close(rollout.twist[:, -1, 0, 3], expected, rtol=0, atol=1e-7)


def test_single_precision_follows_double_precision() -> None:
    poses = []
    for dtype in (torch.float32, torch.float64):
        start, wrench, b = state([[0, 0, 0.1]]), forces(60, [[5.0, 0, 0]]), boxes()
        single = Parameters(*(getattr(b, n).to(dtype) for n in ("size", "mass", "inertia", "friction", "restitution")))
        rollout = PhysicsLayer(World()).rollout(
            State(start.pose.to(dtype), start.twist.to(dtype)), wrench.to(dtype), single
        )
        assert rollout.pose.dtype == dtype
        poses.append(rollout.pose.double())
    torch.testing.assert_close(*poses, rtol=0, atol=2e-4)  # the smoothing of 1e-4 acts on every step


def test_an_unsolved_step_raises_an_error_that_says_what_to_do() -> None:
    layer = PhysicsLayer(World(), solver=SolverSettings(max_steps=2, compliance=(1e-6,)))
    with pytest.raises(
        SolverError, match=r"2 of 2 contact problems were not solved at step 0: worst residual .* raise solver"
    ):
        layer.rollout(repeat(state([[0, 0, 0.1]]), 2), forces(3, [[5.0, 0, 0]]).expand(2, -1, -1, -1), boxes())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"mass": torch.tensor([[-1.0]])}, "mass must be positive, got -1"),
        ({"friction": torch.tensor([[-0.1]])}, "friction must be zero or positive, got -0.1"),
        ({"inertia": torch.tensor([[[1.0, 0.0, 1.0]]])}, "inertia must be positive, got 0"),
        ({"restitution": torch.tensor([[float("nan")]])}, "restitution must be finite"),
        ({"mass": torch.tensor([[1.0, 2.0]])}, r"mass must have shape \(any, 1\), got \(1, 2\)"),
    ],
)
def test_impossible_parameters_are_refused_by_name(change: dict[str, torch.Tensor], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        boxes().replace(**{name: value.double() for name, value in change.items()})


def test_a_quaternion_of_the_wrong_length_is_refused() -> None:
    with pytest.raises(ValueError, match="unit quaternions"):
        State.at_rest(torch.tensor([[[0, 0, 0, 0, 0, 0, 2.0]]]))


def test_a_wrench_that_is_not_finite_or_of_the_wrong_shape_is_refused() -> None:
    layer, start = PhysicsLayer(World()), state([[0, 0, 0.1]])
    with pytest.raises(ValueError, match="wrenches must be finite"):
        layer.rollout(start, forces(3, [[math.nan, 0, 0]]), boxes())
    with pytest.raises(ValueError, match=r"wrenches must have shape \(1, any, 1, 6\)"):
        layer.rollout(start, forces(3, [[0.0, 0, 0]] * 2), boxes())
    with pytest.raises(ValueError, match="at least one step"):
        layer.rollout(start, forces(0, [[0.0, 0, 0]]), boxes())


@pytest.mark.parametrize("build", [lambda: World(time_step=0.0), lambda: World(substeps=0), lambda: Plane((0, 0, 0))])
def test_impossible_worlds_are_refused(build) -> None:  # noqa: ANN001
    with pytest.raises(ValueError, match="must be"):
        build()


def test_without_times_a_camera_sees_frames_a_time_step_apart() -> None:
    """A block that moves at one metre per second is seen where it was by a latency of two and a half frames before."""
    step, frames, late = 1 / 50, 9, 2.5
    layer = PhysicsLayer(World(time_step=step), [ObservationLatency(torch.tensor([late * step], dtype=torch.float64))])
    time = step * torch.arange(frames, dtype=torch.float64)
    pose = torch.zeros(1, frames, 1, 7, dtype=torch.float64)
    pose[0, :, 0, 0], pose[..., 6] = time, 1.0
    seen = layer.observe(pose)
    assert torch.allclose(seen[0, 3:, 0, 0], time[3:] - late * step, atol=1e-12)
    assert torch.equal(seen, layer.observe(pose, time[None]))
