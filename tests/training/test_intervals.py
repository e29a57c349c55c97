"""Confidence intervals: closed forms, and that they hold the truth as often as they say."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from scipy.stats import t as student
from torch import Tensor

from physid.cli import main
from physid.commands.terminal.summary import summarize
from physid.estimation.least_squares.covariance import covariance_of
from physid.estimation.least_squares.experiment import Fit
from physid.estimation.least_squares.levenberg_marquardt import NONE
from physid.estimation.least_squares.normal_equations import Normal, linearise
from physid.estimation.measurement.sensor_noise import Noise
from physid.scenes.catalogue import find_setup
from physid.training.initial_states.explaining import Explaining
from physid.training.learners.sysid import SysID
from physid.training.parameters.intervals import Response, intervals, normal_of, ridge_of
from physid.training.parameters.pose_loss import PoseLoss
from physid.training.parameters.trajectories import Trajectories
from physid.training.refinement.normal_equations import LEAST, NormalEquations

CONFIGS = Path(__file__).parents[2] / "configs" / "sysid"
EXACT = 1e-9


def slopes_of_a_mean(groups: int, frames: int) -> tuple[Tensor, Tensor]:
    """Return J and the real frames for predictions that all are the one parameter itself, along x."""
    slopes = torch.zeros(1, groups, frames, 1, 6, dtype=torch.float64)
    slopes[..., 0] = 1.0
    return slopes, torch.ones(groups, frames, dtype=torch.bool)


def test_the_deviation_of_a_mean_is_that_of_the_groups_means() -> None:
    groups, frames = 7, 5
    value = torch.randn(groups, frames, 1, 6, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    slopes, real = slopes_of_a_mean(groups, frames)
    means = value[..., 0].mean((1, 2))
    residual = means.mean() - value
    normal = normal_of(PoseLoss(), residual, slopes, real)
    variance = covariance_of(normal, ridge_of(normal.matrix.sum(0)), torch.zeros(1).double())
    # Equal groups: u = g / (1 - 1 / G), so that the variance is the jackknife's, sum (m - mean)^2 / (G - 1)^2.
    expected = (means - means.mean()).square().sum() / (groups - 1) ** 2
    assert float(variance) == pytest.approx(float(expected), rel=EXACT)


def test_white_noise_that_agrees_by_chance_is_not_taken_for_knowledge() -> None:
    groups, frames, noise = 3, 50, Noise(rotation=1e-2, position=1e-3)
    pose = torch.zeros(groups, frames, 1, 7, dtype=torch.float64)
    pose[..., 6] = 1.0
    still = torch.zeros(groups, frames, 1, 6, dtype=torch.float64)
    cut = Trajectories(pose, still, still, torch.full((groups,), frames), torch.arange(groups))
    module = SysID(["block.friction"]).attach(find_setup("push").scene)
    experiment, point = Explaining(module.layer, module.physical, PoseLoss(), cut, fitted=False).begin()
    fit = experiment.linearise(point, NONE)
    # A prediction that is the parameter itself, along x, and recordings that agree exactly with it.
    shared = torch.zeros_like(fit.jacobian.shared)
    shared[0, ..., 3] = 1.0
    jacobian = dataclasses.replace(fit.jacobian, shared=shared)
    experiment = experiment.replace(scale=torch.full_like(experiment.scale, 1 / noise.position))
    linear = linearise(still, experiment.scale, jacobian, experiment.directions, experiment.predictor.segments)
    exact = Fit.of(point, NONE, jacobian, still, linear)
    variance = Response.of(experiment, exact, cut.index, noise).covariance()
    assert float(variance) == pytest.approx(noise.position**2 / (groups * frames), rel=EXACT)


def test_segments_of_one_trajectory_count_as_one() -> None:
    vector, matrix = torch.randn(6, 2, dtype=torch.float64), torch.eye(2, dtype=torch.float64).expand(6, 2, 2)
    twice = Normal(matrix, vector, vector[:, 0]).grouped(torch.arange(3).repeat_interleave(2))
    assert torch.equal(twice.matrix, 2 * matrix[:3])
    assert torch.equal(twice.vector, vector[::2] + vector[1::2])


def test_an_interval_is_students_in_the_logarithm() -> None:
    low, high = intervals({"block.mass": 2.0}, torch.tensor([[0.01]]).double(), 11)["block.mass"]
    width = 0.1 * student.ppf(0.95, 10)
    assert (low, high) == pytest.approx((2 * math.exp(-width), 2 * math.exp(width)))


def test_a_parameter_without_influence_has_no_interval() -> None:
    vector, matrix = torch.randn(5, 2).double(), torch.zeros(5, 2, 2).double()
    matrix[:, 0, 0] = 1.0
    vector[:, 1] = 0.0
    response = Response(Normal(matrix, vector, vector[:, 0]), torch.zeros(2).double())
    found = intervals({"seen": 1.0, "unseen": 1.0}, response.covariance(), 5)
    assert 0 < found["seen"][0] < found["seen"][1] < math.inf
    assert found.keys() == {"seen"}


def test_differences_over_a_coarse_step_are_those_of_a_parabola() -> None:
    centre = torch.tensor([[0.1, 0.0], [-0.2, 0.3], [0.1, -0.3]]).double()
    bend = torch.tensor([[2.0, 0.5], [0.5, 1.0]]).double()

    def losses(points: Tensor) -> Tensor:
        away = points[:, None] - centre
        return torch.einsum("kbi,ij,kbj->kb", away, bend, away) / 2

    normal = Response.coarse(losses, torch.zeros(2).double(), torch.arange(3)).normal
    assert torch.allclose(2 * normal.vector, centre @ bend)
    assert torch.allclose(2 * normal.matrix, bend.expand(3, 2, 2))


def test_a_fit_reports_intervals_and_marks_what_is_not_identifiable(
    recordings: Callable[[str], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config, data = str(CONFIGS / "slide_friction.yaml"), f"data.folder={recordings('push')}"
    assert main(["fit", "--config", config, data, f"--run-dir={tmp_path / 'told'}"]) == 0
    figures = json.loads((tmp_path / "told" / "metrics.json").read_text())
    assert figures["params/block.friction/observable"] == 1
    estimate = figures["params/block.friction/estimate"]
    assert figures["params/block.friction/low"] < estimate < figures["params/block.friction/high"]
    assert "90 %:" in capsys.readouterr().out
    data = f"data.folder={recordings('slide')}"
    assert main(["fit", "--config", config, data, "model.learn=[block.mass]", f"--run-dir={tmp_path / 'not'}"]) == 0
    figures = json.loads((tmp_path / "not" / "metrics.json").read_text())
    assert figures["params/block.mass/observable"] == 0
    assert not {"params/block.mass/low", "params/block.mass/high"} & figures.keys()
    assert "DO NOT RELY ON IT" in summarize(figures, tmp_path)


def exact_equations(matrix: Tensor, vector: Tensor) -> NormalEquations:
    equations = NormalEquations()
    losses, none = torch.ones(len(vector)).double(), torch.zeros(*vector.shape, 0).double()
    equations.collect(losses, Normal(matrix, vector, losses), none)
    return equations


def test_no_interval_from_video_is_narrower_than_engines_agree() -> None:
    equations = exact_equations(torch.ones(20, 1, 1).double(), torch.zeros(20, 1).double())
    low, high = intervals({"block.friction": 0.12}, equations.covariance(), 20)["block.friction"]
    assert math.log(high / low) == pytest.approx(2 * student.ppf(0.95, 19) * LEAST, rel=1e-3)


def test_a_parameter_that_films_say_nothing_about_has_no_interval() -> None:
    vector = torch.tensor([[0.1, 0.0], [-0.2, 0.0], [0.1, 0.0]], dtype=torch.float64)
    matrix = torch.diag(torch.tensor([1.0, 0.0], dtype=torch.float64)).expand(3, -1, -1)
    covariance = exact_equations(matrix, vector).covariance()
    assert intervals({"seen": 1.0, "unseen": 1.0}, covariance, 3).keys() == {"seen"}


@pytest.mark.parametrize("noise", [1e-3, 1e-9])
def test_a_few_trajectories_that_nothing_explains_hardly_move_an_estimate_from_video(noise: float) -> None:
    torch.manual_seed(0)
    pulled = noise * torch.randn(60, 20).double()
    pulled[:6] += 0.5  # of the parameter that the first ones measure
    matrices, none = torch.ones(60, 1, 1).double(), torch.zeros(60, 1, 0).double()
    found = torch.zeros(1).double()
    for _ in range(20):
        residual = found - pulled
        equations = NormalEquations()
        square = residual.square().mean(1)
        equations.collect(square, Normal(matrices, -residual.mean(1, keepdim=True), square), none)
        found = found + equations.step(1.0)
    deviation = float(equations.covariance().sqrt())
    assert abs(float(found)) < 3 * noise
    assert deviation <= max(noise, 1.01 * LEAST)
    assert float(equations.weights[:6].max()) < 1e-3
    assert float(equations.weights[6:].min()) > 0.8


def test_trajectories_that_fit_alike_count_alike_and_exact_ones_too() -> None:
    for losses in (torch.full((4,), 2.0).double(), torch.zeros(4).double()):
        one = torch.ones(4, 1).double()
        equations = NormalEquations()
        equations.collect(losses, Normal(one[..., None], one, losses), one[..., None])
        assert torch.equal(equations.weights, equations.weights[:1].expand(4))
