"""Single steps of both engines, from states and inputs of every kind: values, derivatives, Newton steps."""

from __future__ import annotations

import dataclasses

import pytest
import torch
from tests.physics.compiled_step import WORLDS, placed, uniform
from torch import Tensor

from physid.physics import State, StepInputs, World
from physid.physics.contact_problem.lcp import SolverSettings
from physid.physics.fused.stepping import Stepper
from physid.physics.step import Step, advance

VALUES, SLOPES = 1e-9, 2e-4  # of deep overlaps that yield the reference solves less exactly than the compiled engine
SETTINGS = SolverSettings()
QUICK = ("speculative", "midpoint")
CASES = pytest.mark.parametrize(
    ("name", "bodies"),
    [
        ("speculative", 1),
        ("midpoint", 1),
        *(pytest.param(name, 2, marks=() if name in QUICK else pytest.mark.slow) for name in WORLDS),
    ],
)


def by_reference(state: State, inputs: StepInputs, world: World) -> Step:
    return advance(state, inputs, world, SETTINGS)


def compiled(state: State, inputs: StepInputs, world: World) -> Step:
    return Stepper(world, SETTINGS)(state, inputs)


def of_patches(impulse: Tensor) -> Tensor:
    """Sum impulses (B, C, 3) over patches: of corners at one height either may come first."""
    return impulse.unflatten(1, (-1, 4)).sum(2)


def assert_close(found: Tensor, expected: Tensor, tolerance: float) -> None:
    torch.testing.assert_close(found, expected, rtol=0, atol=tolerance * max(float(expected.abs().max()), 1e-3))


@CASES
def test_a_step_is_the_same_and_solved_in_as_many_newton_steps(name: str, bodies: int) -> None:
    world = WORLDS[name]
    state, inputs = placed(bodies, world, seed=60)
    with torch.no_grad():
        one, other = by_reference(state, inputs, world), compiled(state, inputs, world)
    assert_close(other.state.pose, one.state.pose, VALUES)
    assert_close(other.state.twist, one.state.twist, VALUES)
    assert_close(of_patches(other.impulse), of_patches(one.impulse), VALUES)
    assert bool(one.converged.all() & other.converged.all())
    polished = other.newton_steps - one.newton_steps  # a last step, which the reference does not report
    assert set(polished.tolist()) <= {0, 1}
    assert_close(one.residual.clamp_max(1e-3), other.residual.clamp_max(1e-3), 2.0)


@CASES
def test_a_step_has_the_same_derivatives_by_all_that_enters_it(name: str, bodies: int) -> None:
    world = WORLDS[name]
    state, inputs = placed(bodies, world, seed=80)
    given = inputs.tensors(but=("instant", "ground")) | {
        "wrench": inputs.wrench,
        "pose": state.pose,
        "twist": state.twist,
    }
    found = []
    for engine in (by_reference, compiled):
        leaves = {key: value.clone().requires_grad_() for key, value in given.items()}
        moved = inputs.replace(**{key: value for key, value in leaves.items() if key not in ("pose", "twist")})
        step = engine(State(leaves["pose"], leaves["twist"]), moved, world)
        parts = step.state.pose, step.state.twist, of_patches(step.impulse)
        loss = sum((uniform(*part.shape, low=-1, high=1, seed=k) * part).sum() for k, part in enumerate(parts))
        slopes = torch.autograd.grad(loss, list(leaves.values()), allow_unused=True)
        found.append(dict(zip(leaves, slopes, strict=True)))
    assert float(found[0]["mass"].abs().max()) > 1e-3
    for key, expected in found[0].items():
        slope = found[1][key]
        wanted = torch.zeros_like(given[key]) if expected is None else expected
        assert_close(torch.zeros_like(wanted) if slope is None else slope, wanted, SLOPES)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["speculative", "split", "midpoint"])
def test_a_step_that_begins_with_the_solution_of_another_ends_at_its_own(name: str) -> None:
    world = WORLDS[name]
    state, inputs = placed(2, world, seed=100)
    stepper = Stepper(world, SETTINGS)
    with torch.no_grad():
        for _ in range(4):
            one, other = advance(state, inputs, world, SETTINGS), stepper(state, inputs)
            assert_close(other.state.pose, one.state.pose, VALUES)
            assert_close(other.state.twist, one.state.twist, 10 * VALUES)
            state = one.state
        first, again = (Stepper(world, SETTINGS) for _ in range(2))
        first(state, inputs)
        cold, warm = again(state, inputs), first(state, inputs)
    assert bool((warm.newton_steps <= 1).all()), "its own solution needs polishing at most"
    assert bool((cold.newton_steps > 1).any())
    assert_close(warm.state.twist, cold.state.twist, VALUES)


def test_a_step_without_a_length_is_one_of_the_world_in_each_of_its_worlds() -> None:
    for name in ("speculative", "midpoint"):
        world = dataclasses.replace(WORLDS[name], substeps=2)
        state, inputs = placed(2, world, seed=60)
        none = advance(state, inputs, world, SETTINGS)
        for count in (1, len(state.pose)):
            given = advance(
                state, inputs, world, SETTINGS, torch.full((count,), world.time_step / 2, dtype=torch.float64)
            )
            assert torch.equal(given.state.pose, none.state.pose)
            assert torch.equal(given.impulse, none.impulse)
