"""What was first asked for in inference mode serves gradients later: a test before a fit, in one process."""

from __future__ import annotations

import pytest
import torch

from physics.worlds import boxes, forces, state
from physid.physics import PhysicsLayer, World
from physid.physics.contact_problem.friction import Pyramid
from physid.physics.fused.backend import Backend
from physid.physics.guards.made_once import made_once

WORLDS: dict[Backend, World] = {  # that no other test has asked for
    "fused": World(time_step=1 / 241.7),
    "reference": World(time_step=1 / 241.7, friction=Pyramid(22)),
}


@pytest.mark.parametrize("backend", WORLDS)
def test_a_world_that_was_first_predicted_in_inference_mode_gives_gradients(backend: Backend) -> None:
    layer, parameters, wrench = PhysicsLayer(WORLDS[backend], backend=backend), boxes(), forces(3, [[1.0, 0.0, 0.0]])
    with torch.inference_mode():
        layer.rollout(state([[0.0, 0.0, 0.1]]), wrench, parameters)
    wrench.requires_grad_()
    layer.rollout(state([[0.0, 0.0, 0.1]]), wrench, parameters).pose.square().sum().backward()
    assert wrench.grad is not None
    assert wrench.grad.abs().sum() > 0


def test_it_is_made_once_and_may_take_part_in_a_gradient() -> None:
    asked = []

    @made_once
    def ones(count: int) -> torch.Tensor:
        asked.append(count)
        return torch.ones(count)

    with torch.inference_mode():
        first = ones(3)
    assert ones(3) is first
    assert not first.is_inference()
    ones(2)
    assert asked == [3, 2]
    weight = torch.ones(3, requires_grad=True)
    (first * weight).sum().backward()
