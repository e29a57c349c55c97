"""Effects in a fit: their sizes are learned together with the parameters of bodies."""

from __future__ import annotations

import dataclasses

import pytest
import torch
from tests.training.pushed import SCENE, push_batch

from physid.estimation.prediction import NominalModel, Predictor, Timeline, Variants
from physid.physics import State
from physid.training.initial_states import Cutting
from physid.training.learners.engine import Engine
from physid.training.learners.sysid import SysID
from physid.training.parameters.gauss_newton import GaussNewton
from physid.training.parameters.identifiability import Identifiability
from physid.training.parameters.physical_parameters import PhysicalParameters
from physid.training.parameters.trajectories import Trajectories

EVERY_SITE = ["force_gain.gain", "viscous_drag.coefficient", "com_offset.x", "stribeck_friction.rise"]


def test_gradients_by_sizes_of_effects_agree_with_differences() -> None:
    learn = ["block.friction", *EVERY_SITE]
    values = {"viscous_drag.coefficient": 0.6, "com_offset.x": -0.01, "block.friction": 0.14}
    module = SysID(learn, values, segment=8).attach(SCENE)
    batch, step = push_batch(), 1e-4

    def loss() -> torch.Tensor:
        cut = module.trajectories(batch, Cutting(8))
        predicted = cut.rolled(module.layer, module.physical()).pose
        return (predicted - cut.pose).square().mean()

    (slope,) = torch.autograd.grad(loss(), [module.physical.coordinates])
    for column in range(len(learn)):
        found = []
        for move in (step, -2 * step, step):
            with torch.no_grad():
                module.physical.coordinates[column] += move
                found.append(float(loss()))
        assert float(slope[column]) == pytest.approx((found[0] - found[1]) / (2 * step), rel=1e-4, abs=1e-15)


def test_the_predictor_of_a_fit_and_the_layer_say_the_same_of_learned_effects() -> None:
    learn = ["block.friction", "force_delay.delay", "viscous_drag.coefficient", "camera_offset.x"]
    physical = PhysicalParameters(SCENE, learn, {"camera_offset.x": 0.01, "force_delay.delay": 0.006})
    layer, batch = Engine().layer(SCENE, physical.effects), push_batch()
    cut = Trajectories.of(batch, SCENE.time_step).stepped(SCENE.time_step)
    cut = dataclasses.replace(cut, origin=torch.cat([cut.pose[:, 0], cut.twist[:, 0]], -1))
    assert cut.time is not None
    assert cut.grid is not None
    model: NominalModel = physical.model(layer)
    predictor = Predictor.of_whole(model, Timeline(cut.time, cut.grid), cut.length)
    points = physical.coordinates.detach() + torch.tensor([[0.0], [0.3]], dtype=torch.float64)
    start: State = cut.start
    many = Variants.of_states(
        start.pose.expand(2, -1, -1, -1), start.twist.expand(2, -1, -1, -1), points, predictor.null.expand(2, -1)
    )
    predicted = predictor.predict(many).pose
    for point, found in zip(points, predicted, strict=True):
        with torch.no_grad():
            assert torch.allclose(cut.rolled(layer, physical(point)).pose, found, atol=1e-12)


def test_a_step_ends_at_the_end_of_a_range_and_is_best_there_for_the_others() -> None:
    matrix = torch.tensor([[2.0, 1.0], [1.0, 2.0]], dtype=torch.float64)
    goal = torch.tensor([-1.0, 1.0], dtype=torch.float64)
    parameter = torch.nn.Parameter(torch.tensor([0.5, 0.0], dtype=torch.float64))
    optimizer = GaussNewton([parameter], damping=1e-12, max_step=10.0)
    ends = torch.tensor([0.0, -torch.inf]), torch.tensor([torch.inf, torch.inf])

    def closure() -> torch.Tensor:
        optimizer.zero_grad()
        loss = (parameter - goal) @ matrix @ (parameter - goal) / 2
        loss.backward()  # type: ignore[no-untyped-call]
        return loss

    optimizer.step(closure, lambda: (matrix, matrix @ (parameter.detach() - goal)), ends)
    # With x = 0 the sum (x + 1)^2 + (x + 1)(y - 1) + (y - 1)^2 is least where 2 (y - 1) = -1.
    assert parameter.tolist() == pytest.approx([0.0, 0.5])


@pytest.mark.parametrize(
    ("learn", "alike"),
    [
        (["viscous_drag.coefficient", "quadratic_drag.coefficient"], False),
        (["force_gain.gain", "block.mass"], True),
        (["force_gain.gain", "viscous_drag.coefficient"], False),
    ],
)
def test_two_parameters_that_do_nearly_the_same_are_named_together(learn: list[str], alike: bool) -> None:
    slopes = torch.tensor([[1.0, 0.2], [1.0, 0.21 if alike else 0.7]], dtype=torch.float64)
    assert [pair[:2] for pair in Identifiability((learn[0], learn[1]), slopes @ slopes.T).alike()] == [
        (learn[0], learn[1])
    ] * alike
