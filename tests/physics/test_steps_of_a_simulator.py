"""One step that stands for several of a simulator: it ends where these end, as long as forces are constant."""

from __future__ import annotations

import dataclasses
import math

import pytest
import torch
from tests.physics.test_fused import GRADIENT, STATE, Case, draw
from tests.physics.test_grid import roll, uneven

from physics.worlds import boxes, forces, state
from physid.effects.dynamics.viscous_drag import ViscousDrag
from physid.physics import PhysicsLayer, Rollout, State, World
from physid.physics.contact import ContactRule, Penetrating, Speculative, Split
from physid.physics.schemes.integration import SemiImplicit
from physid.scenes import find_setup
from physid.scenes.setup import REST_DEPTH

BACKENDS = [pytest.param("reference", marks=pytest.mark.slow), "fused"]
FRAME, COUNT, SMOOTHING = 1 / 60, 10, 1e-6


def ends(start: State, wrench: list[float], *, ground: bool, backend: str) -> tuple[Rollout, ...]:
    """Return 20 frames in one step each that stands for ten of a simulator, and in these."""
    world = World(FRAME, contact=Split(), integration=SemiImplicit(FRAME / COUNT))
    world = world if ground else dataclasses.replace(world, ground=None)
    push = torch.tensor(wrench, dtype=torch.float64).expand(1, 20, 1, 6)
    parameters = boxes(mass=0.7, friction=0.3)
    layers = [
        PhysicsLayer(dataclasses.replace(world, substeps=count), backend=backend)  # type: ignore[arg-type]
        for count in (1, COUNT)
    ]
    return tuple(layer.rollout(start, push, parameters) for layer in layers)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_flight_ends_where_the_steps_of_the_simulator_end(backend: str) -> None:
    start = state([[0, 0, 1.0]], [[1.0, -0.5, 3.0]], [[0, 0, 7.0]])
    whole, single = ends(start, [0, 0, 0.01, 0.3, 0, 0], ground=False, backend=backend)
    torch.testing.assert_close(whole.pose, single.pose, rtol=0, atol=1e-12)
    torch.testing.assert_close(whole.twist, single.twist, rtol=0, atol=1e-12)
    # Not the parabola, which the simulator's own steps miss by g s t / 2.
    t = 20 * FRAME
    fallen = 1 + 3 * t - 9.81 * t**2 / 2 - 9.81 * (FRAME / COUNT) * t / 2
    assert float(whole.pose[0, -1, 0, 2]) == pytest.approx(fallen, abs=1e-12)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_block_that_slides_on_ends_where_the_steps_of_the_simulator_end(backend: str) -> None:
    start = state([[0, 0, 0.1 - REST_DEPTH]], [[2.0, 0, 0]])
    whole, single = ends(start, [0, 0, 0, 1.0, 0, 0], ground=True, backend=backend)
    torch.testing.assert_close(whole.pose, single.pose, rtol=0, atol=10 * SMOOTHING)
    torch.testing.assert_close(whole.pose[..., :2], single.pose[..., :2], rtol=0, atol=SMOOTHING)
    torch.testing.assert_close(whole.twist, single.twist, rtol=0, atol=20 * SMOOTHING)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_block_that_hovers_by_rounding_does_not_fall_through_the_ground_for_a_whole_step(backend: str) -> None:
    # A contact of Bullet begins in overlap; in a step that stands for ten of its own a block would fall 1.4 mm first.
    whole, _ = ends(state([[0, 0, 0.1 + 1e-9]]), [0.0] * 6, ground=True, backend=backend)
    assert float((whole.pose[0, :, 0, 2] - 0.1).abs().max()) < SMOOTHING


def test_halving_steps_of_a_drag_halves_what_they_miss() -> None:
    start, errors = state([[0, 0, 1.0]], [[3.0, 0, 0]]), []
    drag = ViscousDrag(coefficient=torch.tensor([0.5], dtype=torch.float64))
    world = World(FRAME, integration=SemiImplicit(FRAME / 64), ground=None, gravity=(0.0, 0.0, 0.0))
    push, parameters = forces(20, [[0.0, 0, 0]]), boxes(mass=0.7, friction=0.3)

    def end(substeps: int) -> float:
        layer = PhysicsLayer(dataclasses.replace(world, substeps=substeps), (drag,))
        return float(layer.rollout(start, push, parameters).pose[0, -1, 0, 0])

    errors = [abs(end(count) - end(64)) for count in (1, 2, 4)]
    # The steps of the simulator are 1/64 of a frame themselves: what is missed goes as h - s.
    missed = [1 / count - 1 / 64 for count in (1, 2, 4)]
    assert errors[0] / errors[1] == pytest.approx(missed[0] / missed[1], rel=0.02)
    assert errors[1] / errors[2] == pytest.approx(missed[1] / missed[2], rel=0.02)


@pytest.mark.parametrize("rule", [Speculative(), Split(), pytest.param(Penetrating(), marks=pytest.mark.slow)])
@pytest.mark.parametrize("scene", ["push", pytest.param("collide", marks=pytest.mark.slow)])
def test_both_backends_agree_and_so_do_their_gradients(scene: str, rule: ContactRule) -> None:
    # Steps are both shorter and longer than those of the simulator.
    case = draw(find_setup(scene), 5, 4)
    world = dataclasses.replace(case.world, contact=rule, integration=SemiImplicit(case.world.time_step / 2))
    steps, found = uneven(5, 4, case.world.time_step), []
    for backend in ("reference", "fused"):
        tensors = {name: value.clone().requires_grad_() for name, value in case.tensors.items()}
        rollout = roll(Case(world, tensors), backend, steps=steps)
        (rollout.pose.square().sum() + rollout.twist.sum()).backward()
        found.append((rollout.pose.detach(), {name: value.grad for name, value in tensors.items()}))
    torch.testing.assert_close(found[1][0], found[0][0], rtol=0, atol=STATE)
    for name, gradient in found[0][1].items():
        if gradient is not None:
            torch.testing.assert_close(found[1][1][name], gradient, rtol=GRADIENT, atol=GRADIENT, msg=name)


def test_a_step_of_the_same_length_is_the_scheme_itself() -> None:
    case = draw(find_setup("collide"), 3, 5)
    one, other = (
        roll(Case(dataclasses.replace(case.world, integration=SemiImplicit(step)), case.tensors), "fused")
        for step in (None, case.world.step)
    )
    assert torch.equal(one.pose, other.pose)


@pytest.mark.parametrize("backend", BACKENDS)
def test_shorter_steps_go_through_the_ends_of_the_simulators(backend: str) -> None:
    start = state([[0, 0, 1.0]], [[1.0, -0.5, 3.0]], [[0, 0, 7.0]])
    world = World(FRAME, integration=SemiImplicit(FRAME), ground=None)
    push = torch.tensor([0, 0, 0.01, 0.3, 0, 0], dtype=torch.float64).expand(1, 20, 1, 6)
    whole, parts = (
        PhysicsLayer(dataclasses.replace(world, substeps=count), backend=backend).rollout(  # type: ignore[arg-type]
            start, push, boxes(mass=0.7, friction=0.3)
        )
        for count in (1, 7)
    )
    torch.testing.assert_close(parts.pose, whole.pose, rtol=0, atol=1e-12)


@pytest.mark.parametrize("step", [0.0, -1e-3, math.inf, math.nan])
def test_a_step_that_is_none_is_refused(step: float) -> None:
    with pytest.raises(ValueError, match=r"integration\.step must be positive"):
        SemiImplicit(step)
