"""Steps of different length: a step of a world is that of a world whose time step is this one."""

from __future__ import annotations

import dataclasses

import pytest
import torch
from tests.physics.test_fused import GRADIENT, STATE, Case, draw
from torch import Tensor

from physics.worlds import boxes, forces, repeat, state
from physid.effects.contact.friction_drift import FrictionDrift
from physid.effects.dynamics.viscous_drag import ViscousDrag
from physid.physics import Effect, PhysicsLayer, Rollout, State, World
from physid.physics.schemes.integration import Integration, Midpoint, SemiImplicit
from physid.scenes import find_setup

BACKENDS = ("reference", "fused")
SIZE = torch.tensor([0.3], dtype=torch.float64)
EFFECTS: dict[str, tuple[Effect, ...]] = {
    "nothing": (),
    "timed": (FrictionDrift(rate=SIZE),),
    "stateful": (ViscousDrag(coefficient=SIZE),),
}


def uneven(batch: int, frames: int, time_step: float, spread: float = 4.0) -> Tensor:
    """Return steps between `time_step` / spread and `time_step` * spread."""
    draws = torch.rand(batch, frames, generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    return time_step * spread ** (2 * draws - 1)


def roll(case: Case, backend: str, effects: tuple[Effect, ...] = (), **more: Tensor | None) -> Rollout:
    layer = PhysicsLayer(case.world, effects, backend=backend)  # type: ignore[arg-type]
    return layer.rollout(
        State(case.tensors["pose"], case.tensors["twist"]), case.tensors["wrench"], case.parameters, **more
    )


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("effects", EFFECTS.values(), ids=EFFECTS)
def test_steps_that_are_all_the_time_step_are_no_steps(backend: str, effects: tuple[Effect, ...]) -> None:
    case = draw(find_setup("collide"), 3, 5)
    steps = torch.full((1, 5), case.world.time_step, dtype=torch.float64)
    given, none = roll(case, backend, effects, steps=steps), roll(case, backend, effects)
    torch.testing.assert_close(given.pose, none.pose, rtol=0, atol=1e-14)


@pytest.mark.parametrize("backend", BACKENDS)
def test_each_step_is_that_of_a_world_with_this_time_step(backend: str) -> None:
    case = draw(find_setup("push"), 2, 6)
    steps = uneven(1, 6, case.world.time_step)
    whole = roll(case, backend, steps=steps)
    now = State(case.tensors["pose"], case.tensors["twist"])
    for t in range(6):
        world = dataclasses.replace(case.world, time_step=float(steps[0, t]))
        one = PhysicsLayer(world, backend=backend).rollout(now, case.tensors["wrench"][:, t : t + 1], case.parameters)
        now = State(one.pose[:, 1], one.twist[:, 1])
        torch.testing.assert_close(whole.pose[:, t + 1], now.pose, rtol=0, atol=STATE)
        torch.testing.assert_close(whole.impulse[:, t].sum(1), one.impulse[:, 0].sum(1), rtol=0, atol=STATE)


@pytest.mark.parametrize("substeps", [1, pytest.param(3, marks=pytest.mark.slow)])
@pytest.mark.parametrize("effects", EFFECTS.values(), ids=EFFECTS)
@pytest.mark.parametrize("scene", [pytest.param("push", marks=pytest.mark.slow), "collide"])
@pytest.mark.parametrize("integration", [pytest.param(SemiImplicit(), marks=pytest.mark.slow), Midpoint()])
def test_both_backends_agree_on_steps_of_each_world(
    scene: str, effects: tuple[Effect, ...], substeps: int, integration: Integration
) -> None:
    case = draw(find_setup(scene), 9, 5)
    world = dataclasses.replace(case.world, substeps=substeps, integration=integration)
    case = dataclasses.replace(case, world=world)
    steps, start = uneven(9, 5, case.world.time_step), torch.linspace(0, 2, 9, dtype=torch.float64)
    found = []
    for backend in BACKENDS:
        tensors = {name: value.clone().requires_grad_() for name, value in case.tensors.items()}
        rollout = roll(Case(case.world, tensors), backend, effects, steps=steps, start=start)
        loss = rollout.pose.square().sum() + rollout.twist.sum() + rollout.impulse.sum()
        found.append(
            (rollout.pose.detach(), rollout.twist.detach(), *torch.autograd.grad(loss, list(tensors.values())))
        )
        with torch.no_grad():
            without = roll(case, backend, effects, steps=steps, start=start)
        torch.testing.assert_close(without.pose, rollout.pose, rtol=0, atol=STATE)
    for k, (one, other) in enumerate(zip(*found, strict=True)):
        tolerance = STATE if k < 2 else 10 * GRADIENT
        torch.testing.assert_close(other, one, rtol=0, atol=tolerance * max(float(one.abs().max()), 1e-6))


@pytest.mark.parametrize("backend", BACKENDS)
def test_worlds_with_their_own_steps_move_as_each_alone(backend: str) -> None:
    case, frames = draw(find_setup("push"), 10, 6), 6
    steps = uneven(10, frames, case.world.time_step)
    together = roll(case, backend, steps=steps)
    for k in (0, 9):
        one = Case(case.world, {name: value[k : k + 1] for name, value in case.tensors.items()})
        alone = roll(one, backend, steps=steps[k : k + 1])
        torch.testing.assert_close(alone.pose[0], together.pose[k], rtol=0, atol=STATE)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_split_step_is_two_steps(backend: str) -> None:
    case = draw(find_setup("slide"), 3, 4)
    steps = uneven(3, 4, case.world.time_step)
    parts = dataclasses.replace(case, world=dataclasses.replace(case.world, substeps=2))
    held = case.tensors | {"wrench": case.tensors["wrench"].repeat_interleave(2, 1)}
    fine = roll(Case(case.world, held), backend, steps=(steps / 2).repeat_interleave(2, 1))
    torch.testing.assert_close(roll(parts, backend, steps=steps).pose, fine.pose[:, ::2], rtol=0, atol=STATE)


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_clock_of_effects_runs_with_the_steps_from_its_start(backend: str) -> None:
    @dataclasses.dataclass(frozen=True)
    class Clock(ViscousDrag):
        """A force of 1 N per second since the start of the clock."""

        def act(self, state: State, inputs):  # noqa: ANN001, ANN202
            return inputs.add_force(inputs.time[:, None, None] * torch.tensor([1.0, 0, 0], dtype=torch.float64))

    steps = torch.tensor([[0.01, 0.03, 0.02], [0.02, 0.02, 0.02]], dtype=torch.float64)
    start = torch.tensor([1.0, 5.0], dtype=torch.float64)
    layer = PhysicsLayer(World(substeps=2, ground=None), [Clock()], backend=backend)  # type: ignore[arg-type]
    twist = layer.rollout(
        repeat(state([[0, 0, 0.1]]), 2),
        forces(3, [[0.0, 0, 0]]).expand(2, -1, -1, -1),
        boxes(),
        steps=steps,
        start=start,
    ).twist
    # v(t) = sum of h_k t_k / m over the steps of the engine, with t_k the time at the beginning of each
    begin = torch.tensor([[0, 0.005, 0.01, 0.025, 0.04, 0.05], [0, 0.01, 0.02, 0.03, 0.04, 0.05]], dtype=torch.float64)
    speed = ((begin + start[:, None]) * steps.repeat_interleave(2, 1) / 2).cumsum(1)[:, 1::2]
    torch.testing.assert_close(twist[:, 1:, 0, 3], speed, rtol=0, atol=1e-12)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_later_start_is_a_window_of_a_longer_trajectory(backend: str) -> None:
    case = draw(find_setup("push"), 2, 12)
    whole = roll(case, backend, EFFECTS["timed"])
    late = case.tensors | {
        "wrench": case.tensors["wrench"][:, 8:],
        "pose": whole.pose[:, 8],
        "twist": whole.twist[:, 8],
    }
    start = torch.tensor([8 * case.world.time_step], dtype=torch.float64)
    rest = roll(Case(case.world, late), backend, EFFECTS["timed"], start=start)
    torch.testing.assert_close(rest.pose, whole.pose[:, 8:], rtol=0, atol=STATE)


def test_steps_that_make_no_sense_are_refused_by_name() -> None:
    layer, start, push = PhysicsLayer(World()), state([[0, 0, 0.1]]), forces(2, [[0.0, 0, 0]])
    for steps, message in (
        (torch.tensor([[0.01, 0.0]]), r"steps must be positive lengths of time \[s\], got 0"),
        (torch.tensor([[0.01, float("nan")]]), "steps must be finite"),
        (torch.tensor([[0.01]]), r"steps must have shape \(any, 2\), got \(1, 1\)"),
        (torch.full((3, 2), 0.01), "steps must have a first axis of 1 or 1, one for each world, got 3"),
    ):
        with pytest.raises(ValueError, match=message):
            layer.rollout(start, push, boxes(), steps=steps)
    with pytest.raises(ValueError, match="start must be finite"):
        layer.rollout(start, push, boxes(), start=torch.tensor([float("inf")]))
