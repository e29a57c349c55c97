"""Initial heights from landing: what images do not tell, the motion does."""

from __future__ import annotations

import math
from functools import partial

import pytest
import torch
from torch import Tensor

from physid.networks import PoseEncoder
from physid.networks.encoder import Layers
from physid.physics import State
from physid.scenes import find_setup
from physid.training.learners.supervised import SupervisedID
from physid.training.parameters.pose_loss import PoseLoss
from physid.training.parameters.trajectories import Trajectories
from physid.training.refinement.normal_equations import NormalEquations
from physid.training.vision.landing_height import land
from physid.training.vision.model import VideoModel
from physid.training.vision.reading import Vision

PRECISE = partial(PoseEncoder, layers=Layers(fast=False))

FRAMES, STEPS = 160, 5
DEPTH = 0.03  # [m] by which images mistake how far away a body is
FOUND = 2e-3  # relative, of the friction
HIGH = 2e-3  # [m], of initial heights


def sliding() -> tuple[VideoModel, Tensor]:
    """Return a model whose friction is a third too high, and true poses (B, T, 1, 7)."""
    torch.manual_seed(0)
    scene = find_setup("slide").scene
    model = SupervisedID(["block.friction"], encoder=PRECISE, vision=Vision(chart="hovering")).attach(scene).model
    height = torch.tensor([0.02, 0.05, 0.08, 0.11], dtype=torch.float64)[:, None]
    numbers = torch.zeros(len(height), 1, 5, dtype=torch.float64)
    numbers[..., 0], numbers[..., 2] = -0.4, 1.0
    numbers[..., 4] = height / model.chart.down.norm(dim=-1).double()
    first = model.chart.to_pose(numbers)
    calm = torch.zeros(len(height), FRAMES - 1, 1, 6, dtype=torch.float64)
    with torch.no_grad():
        state = State(first, torch.zeros(len(height), 1, 6, dtype=torch.float64))
        true = model.layer.rollout(state, calm, model.parameters_there()).pose
        model.physical.coordinates.add_(math.log(4 / 3))
    return model, true


def farther(model: VideoModel, pose: Tensor, by: Tensor) -> Tensor:
    """Move poses along the rays from the camera, by a height above the ground."""
    ray = pose[..., :3] - pose.new_tensor(model.decoder.renderer.camera.position)
    ray = ray / (ray @ model.chart.normal.to(ray))[..., None]
    return torch.cat([pose[..., :3] + by[..., None] * ray, pose[..., 3:]], -1)


def test_friction_and_first_heights_are_found_though_images_mistake_the_depth() -> None:
    model, true = sliding()
    mistaken = torch.tensor([DEPTH, 0.5 * DEPTH, -DEPTH, 0.8 * DEPTH], dtype=torch.float64)[:, None]
    goal = farther(model, true, mistaken[:, None] * torch.rand(true.shape[:3]).to(true))
    goal = torch.cat([farther(model, true[:, :1], mistaken[:, None]), goal[:, 1:]], 1)
    real = torch.ones(goal.shape[:2], dtype=torch.bool)
    calm = torch.zeros(*goal.shape[:3], 6).to(goal)
    length, index = torch.full((len(goal),), FRAMES), torch.arange(len(goal))
    loss = PoseLoss()
    for _ in range(STEPS):
        given = Trajectories(goal, calm, calm, length, index)
        eye = model.decoder.renderer.camera.position
        landing = land(model.layer, model.parameters_there(), model.chart, eye, loss, given, real)
        equations = NormalEquations()
        equations.add(model.layer, model.physical, loss, landing.trajectories, real, landing)
        with torch.no_grad():
            model.physical.coordinates.add_(equations.step(0.5))
    friction = model.physical.estimates()["block.friction"]
    assert friction == pytest.approx(0.15, rel=FOUND)
    normal = model.chart.normal.double()
    risen = (landing.trajectories.start.pose[..., :3] - true[:, 0, :, :3]) @ normal
    assert risen.abs().max() < HIGH


def test_without_the_motion_the_wrong_heights_spoil_the_friction() -> None:
    model, true = sliding()
    goal = torch.cat([farther(model, true[:, :1], torch.full((4, 1, 1), DEPTH).to(true)), true[:, 1:]], 1)
    calm, real = torch.zeros(*goal.shape[:3], 6).to(goal), torch.ones(goal.shape[:2], dtype=torch.bool)
    given = Trajectories(goal, calm, calm, torch.full((4,), FRAMES), torch.arange(4))
    for _ in range(STEPS):
        equations = NormalEquations()
        equations.add(model.layer, model.physical, PoseLoss(), given, real)
        with torch.no_grad():
            model.physical.coordinates.add_(equations.step(0.5))
    assert model.physical.estimates()["block.friction"] != pytest.approx(0.15, rel=10 * FOUND)
