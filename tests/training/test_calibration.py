"""An error of scale that all refined poses share is measured, taken out, and stands in the interval."""

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
from physid.training.vision.calibration import Calibration, moved, stretched
from physid.training.vision.model import VideoModel

PRECISE = partial(PoseEncoder, layers=Layers(fast=False))

SHARE = 0.003
OFFSET = torch.tensor([0.4, -0.3], dtype=torch.float64)  # [px]
ROUNDING = 1e-4  # relative


def model_of() -> VideoModel:
    return SupervisedID(["block.friction"], encoder=PRECISE).attach(find_setup("push").scene).model


def anywhere(model: VideoModel, count: int) -> Tensor:
    torch.manual_seed(0)
    numbers = torch.rand(count, 1, 4, dtype=torch.float64) - 0.5
    return model.chart.to_pose(numbers)


def test_a_scale_is_measured_and_taken_out() -> None:
    model, calibration = model_of(), Calibration()
    true = anywhere(model, 16)
    found = stretched(model.chart, true, -SHARE)
    calibration.measure(model.decoder.renderer.camera, found, true)
    assert float(calibration.stretch) == pytest.approx(SHARE, rel=2 * SHARE)
    assert float(calibration.deviation) < ROUNDING * SHARE
    assert (calibration(model.chart, model.decoder.renderer.camera, found) - true).abs().max() < ROUNDING


def test_a_scale_and_an_offset_are_measured_and_taken_out() -> None:
    model, calibration = model_of(), Calibration()
    camera, true = model.decoder.renderer.camera, anywhere(model, 16)
    found = moved(camera, stretched(model.chart, true, -SHARE), -OFFSET)
    assert (
        camera.project(moved(camera, true, OFFSET)[..., :3]) - camera.project(true[..., :3]) - OFFSET
    ).abs().max() < 1e-9
    calibration.measure(camera, found, true, offset=True)
    assert float(calibration.stretch) == pytest.approx(SHARE, rel=2 * SHARE)
    assert calibration.offset.tolist() == pytest.approx(OFFSET.tolist(), rel=2 * SHARE)
    assert (calibration(model.chart, camera, found) - true).abs().max() < ROUNDING
    calibration.measure(camera, found, true)
    assert calibration.offset.tolist() == [0.0, 0.0]
    assert float(calibration.deviation) > 1e-4  # the offset is taken for noise


def test_errors_that_poses_share_have_the_covariance_of_what_was_measured() -> None:
    model, calibration = model_of(), Calibration()
    camera, true = model.decoder.renderer.camera, anywhere(model, 16) + torch.tensor([0.3] + [0.0] * 6)
    torch.manual_seed(2)
    measured, roots = [], []
    for _ in range(200):
        noise = torch.cat([0.002 * torch.randn(16, 1, 2), torch.zeros(16, 1, 5)], -1)
        calibration.measure(camera, true + noise, true, offset=True)
        measured.append(torch.cat([calibration.stretch[None], calibration.offset]))
        roots.append(calibration.root.clone())
        if len(roots) == 1:
            assert len(calibration.shared_errors(model.chart, camera, true)) == 3
    root = torch.stack(roots)
    expected, found = (root @ root.transpose(-1, -2)).mean(0), torch.stack(measured).T.cov()
    scale = expected.diagonal().sqrt()
    assert ((found - expected) / (scale[:, None] * scale)).abs().max() < 0.3
    assert abs(expected[0, 1] / (scale[0] * scale[1])) > 0.3  # bodies to one side: scale and offset look alike


def test_the_deviation_is_that_of_the_scale_over_many_draws() -> None:
    model, calibration = model_of(), Calibration()
    true = anywhere(model, 16)
    torch.manual_seed(1)
    measured = []
    for _ in range(200):
        noise = torch.cat([0.002 * torch.randn(16, 1, 2), torch.zeros(16, 1, 5)], -1)
        calibration.measure(model.decoder.renderer.camera, true + noise, true)
        measured.append((float(calibration.stretch), float(calibration.deviation)))
    stretch, deviation = torch.tensor(measured).unbind(1)
    assert float(stretch.std()) == pytest.approx(float(deviation.mean()), rel=0.2)


def test_a_shared_scale_widens_the_interval_by_what_it_does_to_the_parameter() -> None:
    model = model_of()
    first = anywhere(model, 3)
    push = torch.zeros(3, 60, 1, 6, dtype=torch.float64)
    push[..., 3] = 6.0
    rest = torch.zeros(3, 1, 6, dtype=torch.float64)
    with torch.no_grad():
        pose = model.layer.rollout(State(first, rest), push[:, :-1], model.parameters_there()).pose
    real = torch.ones(pose.shape[:2], dtype=torch.bool)
    length, index = torch.full((3,), 60), torch.arange(3)

    def fitted(share: float) -> tuple[float, float]:
        """Return ln(friction) fitted to poses of another scale, and its deviation if that scale is the uncertainty."""
        goal = stretched(model.chart, pose, share)
        there = Trajectories(goal, torch.zeros_like(push), push, length, index)
        shifted = Trajectories(stretched(model.chart, goal, SHARE), torch.zeros_like(push), push, length, index)
        physical = model.physical.coordinates.detach().clone()
        for _ in range(6):
            equations = NormalEquations()
            equations.add(model.layer, model.physical, PoseLoss(), there, real, shifted=[shifted])
            with torch.no_grad():
                model.physical.coordinates.add_(equations.step(0.5))
        found = float(model.physical.coordinates.detach())
        with torch.no_grad():
            model.physical.coordinates.copy_(physical)
        return found, math.sqrt(float(equations.covariance()))

    (exact, deviation), (other, _) = fitted(0.0), fitted(SHARE)
    assert abs(other - exact) > ROUNDING
    assert deviation == pytest.approx(abs(other - exact), rel=0.05)
