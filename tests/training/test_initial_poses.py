"""Initial poses are unknowns of each trajectory; only what no other initial pose explains moves the parameters."""

from __future__ import annotations

import dataclasses
import math
from functools import partial
from typing import Any

import pytest
import torch
from torch import Tensor

from physid.networks import PoseEncoder
from physid.networks.encoder import Layers
from physid.physics import State
from physid.physics.rotations import exponential, multiply
from physid.scenes import Integration, find_setup
from physid.training.initial_states.elimination import slopes
from physid.training.learners.supervised import SupervisedID
from physid.training.learners.video import Objective
from physid.training.parameters.pose_loss import PoseLoss
from physid.training.parameters.trajectories import Trajectories
from physid.training.refinement import normal_equations
from physid.training.refinement.initial_poses import Placing, place
from physid.training.refinement.normal_equations import NormalEquations
from physid.training.vision.model import VideoModel

PRECISE = partial(PoseEncoder, layers=Layers(fast=False))

FRAMES, STEPS, MANY = 50, 6, 12
OFF, TURNED = 1e-3, 0.01  # [m], [rad], of what is read
EXACT = 2e-5  # [m], [rad]
LOSS = PoseLoss(rotation_weight=0.06)


def model_of(scene: str, learn: list[str]) -> VideoModel:
    torch.manual_seed(0)
    known = find_setup(scene).scene
    known = dataclasses.replace(known, integration=Integration("semi_implicit_euler", known.time_step))
    return SupervisedID(learn, encoder=PRECISE, objective=Objective(LOSS)).attach(known).model


def astray(pose: Tensor) -> Tensor:
    """Return poses (..., 7) of bodies on a level plane as they might be read."""
    shift = torch.cat([OFF * torch.randn_like(pose[..., :2]), torch.zeros_like(pose[..., :1])], -1)
    turn = torch.cat([torch.zeros_like(shift[..., :2]), TURNED * torch.randn_like(shift[..., :1])], -1)
    return torch.cat([pose[..., :3] + shift, multiply(exponential(turn), pose[..., 3:])], -1)


def lying(scene: str, places: Tensor) -> Tensor:
    """Return poses of a scene's bodies that lie at places (B, N, 2) of the plane, unturned."""
    height = torch.as_tensor(find_setup(scene).scene.sizes[:, 2]).to(places) / 2
    pose = torch.zeros(*places.shape[:2], 7).to(places)
    pose[..., :2], pose[..., 2], pose[..., 6] = places, height, 1.0
    return pose


def moved(model: VideoModel, first: Tensor, wrench: Tensor) -> Tensor:
    state = State(first, torch.zeros(*first.shape[:2], 6).to(first))
    with torch.no_grad():
        pose: Tensor = model.layer.rollout(state, wrench[:, :-1], model.parameters_there()).pose
    return pose


def given(pose: Tensor, wrench: Tensor) -> Trajectories:
    length = torch.full((len(pose),), pose.shape[1])
    return Trajectories(pose, torch.zeros_like(wrench), wrench, length, torch.arange(len(pose)))


def hit(model: VideoModel) -> tuple[Tensor, Tensor]:
    """Return poses and wrenches of blocks that are pushed into others, off centre."""
    places = torch.zeros(MANY, 2, 2, dtype=torch.float64)
    places[:, 1, 0], places[:, 1, 1] = 0.17, torch.linspace(-0.05, 0.05, MANY)
    wrench = torch.zeros(MANY, FRAMES, 2, 6, dtype=torch.float64)
    wrench[:, :, 0, 3] = torch.linspace(15.0, 30.0, MANY)[torch.randperm(MANY)][:, None]
    return moved(model, lying("collide", places), wrench), wrench


def test_a_body_at_rest_is_where_its_readings_are_on_average() -> None:
    model = model_of("push", ["block.friction"])
    wrench = torch.zeros(3, FRAMES, 1, 6, dtype=torch.float64)
    still = lying("push", torch.zeros(3, 1, 2, dtype=torch.float64))[:, None].expand(-1, FRAMES, -1, -1)
    read = astray(still)
    real = torch.arange(FRAMES).expand(3, -1) % 10 == 0
    placing = place(model, LOSS, given(read, wrench), real)
    mean = read[:, ::10, :, :2].mean(1)
    assert torch.allclose(placing.trajectories.start.pose[..., :2], mean, atol=EXACT)


def test_a_single_wild_reading_of_the_first_pose_is_outvoted_by_the_motion() -> None:
    model = model_of("push", ["block.friction"])
    wrench = torch.zeros(3, FRAMES, 1, 6, dtype=torch.float64)
    wrench[..., 3] = torch.tensor([6.0, 8.0, 10.0])[:, None, None]
    true = moved(model, lying("push", torch.zeros(3, 1, 2, dtype=torch.float64)), wrench)
    goal = torch.cat([astray(true[:, :1]), true[:, 1:]], 1)
    placing = place(model, LOSS, given(goal, wrench), torch.ones(goal.shape[:2], dtype=torch.bool))
    left = (placing.trajectories.start.pose - true[:, 0])[..., :2]
    assert torch.allclose(left, (goal[:, 0] - true[:, 0])[..., :2] / FRAMES, atol=EXACT)
    assert torch.equal(placing.trajectories.start.twist, torch.zeros(3, 1, 6, dtype=torch.float64))


def identified(model: VideoModel, goal: Tensor, wrench: Tensor, *, fitted: bool) -> dict[str, float]:
    real = torch.ones(goal.shape[:2], dtype=torch.bool)
    with torch.no_grad():
        model.physical.coordinates.add_(math.log(1.1))
    for _ in range(STEPS):
        equations, trajectories = NormalEquations(), given(goal, wrench)
        own: Placing | None = None
        if fitted:
            own = place(model, LOSS, trajectories, real)
            equations.add(model.layer, model.physical, LOSS, own.trajectories, real, own)
        else:
            equations.add(model.layer, model.physical, LOSS, trajectories, real)
        with torch.no_grad():
            model.physical.coordinates.add_(equations.step(0.5))
    return model.physical.estimates()


@pytest.mark.slow
def test_an_impact_identifies_mass_and_friction_though_all_poses_are_off() -> None:
    errors: dict[bool, list[float]] = {True: [], False: []}
    for seed in range(3):
        for fitted in (True, False):
            model = model_of("collide", ["block.mass", "block.friction"])
            truth = dict(model.physical.estimates())
            torch.manual_seed(seed)
            true, wrench = hit(model)
            found = identified(model, astray(true), wrench, fitted=fitted)
            errors[fitted] += [abs(found[name] / truth[name] - 1) for name in truth]
    assert max(errors[True]) < 0.05
    assert sum(errors[False]) > 3 * sum(errors[True])


def test_what_another_first_pose_does_as_well_is_left_to_it() -> None:
    model = model_of("collide", ["block.mass", "block.friction"])
    true, wrench = hit(model)
    real = torch.ones(true.shape[:2], dtype=torch.bool)
    placing = place(model, LOSS, given(true, wrench), real)
    moves = placing._fit.jacobian.state
    kept = placing.reduce(moves[:1].repeat(2, 1, 1, 1, 1), LOSS, real)
    assert kept.abs().max() < 1e-3 * moves[:1].abs().max()


def test_trajectories_without_usable_slopes_move_no_parameter(monkeypatch: pytest.MonkeyPatch) -> None:
    model = model_of("collide", ["block.mass", "block.friction"])
    true, wrench = hit(model)
    real, goal = torch.ones(true.shape[:2], dtype=torch.bool), astray(true)
    usable = torch.arange(MANY) % 2 == 0

    def judged(*arguments: Any) -> tuple[Tensor, Tensor]:
        answer, found = slopes(*arguments)
        return answer, usable if len(found) == MANY else torch.ones_like(found)

    few, some = NormalEquations(), NormalEquations()
    monkeypatch.setattr(normal_equations, "slopes", judged)
    few.add(model.layer, model.physical, LOSS, given(goal, wrench).chosen(usable), real[usable])
    some.add(model.layer, model.physical, LOSS, given(goal, wrench), real)
    assert torch.allclose(some.step(1.0), few.step(1.0))
    assert torch.allclose(some.covariance(), few.covariance())
