"""Worlds that need different numbers of steps: up to there all is the same, and what comes later is not computed."""

from __future__ import annotations

import dataclasses

import pytest
import torch
from tests.physics.test_fused import Case, draw
from torch import Tensor

from physid.effects.contact.friction_drift import FrictionDrift
from physid.effects.dynamics.viscous_drag import ViscousDrag
from physid.physics import Effect, PhysicsLayer, Rollout
from physid.scenes import find_setup

LENGTHS = torch.tensor([20, 3, 7, 7, 1, 12, 2, 9, 5, 5, 4])
STEPS = int(LENGTHS.max())
SIZE = torch.tensor([0.3], dtype=torch.float64)
NOTHING, TIMED, STATEFUL = (), (FrictionDrift(rate=SIZE),), (ViscousDrag(coefficient=SIZE),)


def rolled(case: Case, effects: tuple[Effect, ...], lengths: Tensor | None, substeps: int = 1) -> Rollout:
    world = dataclasses.replace(case.world, substeps=substeps)
    return case.roll(PhysicsLayer(world, effects, backend="fused"), lengths)


@pytest.fixture(scope="module")
def case() -> Case:
    return draw(find_setup("collide"), len(LENGTHS), STEPS)


@pytest.mark.parametrize("substeps", [1, 2])
@pytest.mark.parametrize("effects", [NOTHING, TIMED, STATEFUL], ids=["nothing", "timed", "stateful"])
def test_the_steps_that_are_needed_are_those_of_a_rollout_of_all(
    case: Case, effects: tuple[Effect, ...], substeps: int
) -> None:
    with torch.no_grad():
        whole, needed = (rolled(case, effects, lengths, substeps) for lengths in (None, LENGTHS))
    for name in ("pose", "twist", "impulse"):
        for world, length in enumerate(LENGTHS.tolist()):
            until = length + (name != "impulse")
            assert torch.equal(getattr(needed, name)[world, :until], getattr(whole, name)[world, :until])


@pytest.mark.parametrize("effects", [NOTHING, TIMED, STATEFUL], ids=["nothing", "timed", "stateful"])
def test_steps_that_no_world_needs_are_not_computed(case: Case, effects: tuple[Effect, ...]) -> None:
    with torch.no_grad():
        status = rolled(case, effects, torch.full_like(LENGTHS, 5)).status
    assert bool((status.newton_steps[:, :5] > 0).all())
    assert not bool(status.newton_steps[:, 5:].any())


@pytest.mark.parametrize("effects", [NOTHING, STATEFUL], ids=["nothing", "stateful"])
def test_gradients_do_not_depend_on_lengths(case: Case, effects: tuple[Effect, ...]) -> None:
    slopes = []
    for lengths in (None, LENGTHS):
        wrench = case.tensors["wrench"].clone().requires_grad_()
        rollout = rolled(Case(case.world, case.tensors | {"wrench": wrench}), effects, lengths)
        ends = rollout.pose[torch.arange(len(LENGTHS)), LENGTHS]
        slopes.append(torch.autograd.grad(ends.square().sum(), wrench)[0])
    assert torch.equal(*slopes)


def test_lengths_may_be_of_any_kind_and_beyond_the_end(case: Case) -> None:
    with torch.no_grad():
        whole = rolled(case, NOTHING, None)
        for lengths in (
            torch.full((len(LENGTHS),), 2.0 * STEPS),
            torch.full((len(LENGTHS),), STEPS, dtype=torch.int32),
        ):
            assert torch.equal(rolled(case, NOTHING, lengths).pose, whole.pose)


def test_a_length_for_each_world_is_asked_for(case: Case) -> None:
    with pytest.raises(ValueError, match=r"lengths must have shape \(11,\), got \(3,\)"):
        rolled(case, NOTHING, LENGTHS[:3])
