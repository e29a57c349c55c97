"""Confidence intervals: closed forms, and that they hold the truth as often as they say."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from scipy.stats import t as student
from torch import Tensor

from physid.cli import main
from physid.commands.summary import summarize
from physid.training.parameters.intervals import Pull, coarse_pull, intervals
from physid.training.parameters.pose_loss import PoseLoss
from physid.training.refinement.normal_equations import NormalEquations
from physid.training.refinement.refinement import QUANTILE, SMALLEST, interval

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
    variance = Pull.of(PoseLoss(), residual, slopes, real).covariance()
    # Equal groups: u = g / (1 - 1 / G), so that the variance is the jackknife's, sum (m - mean)^2 / (G - 1)^2.
    expected = (means - means.mean()).square().sum() / (groups - 1) ** 2
    assert float(variance) == pytest.approx(float(expected), rel=EXACT)


def test_segments_of_one_trajectory_count_as_one() -> None:
    pull = Pull(torch.randn(6, 2, dtype=torch.float64), torch.eye(2, dtype=torch.float64).expand(6, 2, 2))
    twice = Pull(pull.gradient.repeat_interleave(2, 0) / 2, pull.curvature.repeat_interleave(2, 0) / 2)
    again = twice.of_trajectories(torch.arange(6).repeat_interleave(2))
    assert torch.allclose(again.covariance(), pull.covariance())


def test_an_interval_is_students_in_the_logarithm() -> None:
    low, high = intervals({"block.mass": 2.0}, torch.tensor([[0.01]]).double(), 11)["block.mass"]
    width = 0.1 * student.ppf(0.95, 10)
    assert (low, high) == pytest.approx((2 * math.exp(-width), 2 * math.exp(width)))


def test_a_parameter_without_influence_has_no_interval() -> None:
    gradient, curvature = torch.randn(5, 2).double(), torch.zeros(5, 2, 2).double()
    curvature[:, 0, 0] = 1.0
    gradient[:, 1] = 0.0
    pull = Pull(gradient, curvature)
    found = intervals({"seen": 1.0, "unseen": 1.0}, pull.covariance(), 5)
    assert 0 < found["seen"][0] < found["seen"][1] < math.inf
    assert found["unseen"] == (0.0, math.inf)


def test_differences_over_a_coarse_step_are_those_of_a_parabola() -> None:
    centre = torch.tensor([[0.1, 0.0], [-0.2, 0.3], [0.1, -0.3]]).double()
    bend = torch.tensor([[2.0, 0.5], [0.5, 1.0]]).double()

    def losses(points: Tensor) -> Tensor:
        away = points[:, None] - centre
        return torch.einsum("kbi,ij,kbj->kb", away, bend, away) / 2

    pull = coarse_pull(losses, torch.zeros(2).double())
    assert torch.allclose(pull.gradient, -centre @ bend)
    assert torch.allclose(pull.curvature, bend.expand(3, 2, 2))


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


def test_no_interval_from_video_is_narrower_than_engines_agree() -> None:
    found = interval({"block.friction": 0.12}, [0.0])
    low, high = found["params/block.friction/low"], found["params/block.friction/high"]
    assert math.log(high / low) == pytest.approx(2 * QUANTILE * SMALLEST, rel=1e-3)
    wide = interval({"block.friction": 0.12}, [0.1])
    assert wide["params/block.friction/high"] == pytest.approx(0.12 * math.exp(0.1 * QUANTILE))


def test_a_parameter_that_films_say_nothing_about_has_no_interval() -> None:
    gradients = torch.tensor([[0.1, 0.0], [-0.2, 0.0], [0.1, 0.0]], dtype=torch.float64)
    curvatures = torch.diag(torch.tensor([1.0, 0.0], dtype=torch.float64)).expand(3, -1, -1)
    equations = NormalEquations(2)
    equations.collect(torch.ones(3).double(), Pull(gradients, curvatures), torch.zeros(3, 2, 0).double())
    deviation = equations.covariance().diagonal().sqrt().tolist()
    assert interval({"seen": 1.0, "unseen": 1.0}, deviation).keys() == {"params/seen/low", "params/seen/high"}


@pytest.mark.parametrize("noise", [1e-3, 1e-9])
def test_a_few_trajectories_that_nothing_explains_hardly_move_an_estimate_from_video(noise: float) -> None:
    torch.manual_seed(0)
    pulled = noise * torch.randn(60, 20).double()
    pulled[:6] += 0.5  # of the parameter that the first ones measure
    curvatures, none = torch.full((60, 1, 1), 2.0).double(), torch.zeros(60, 1, 0).double()
    found = torch.zeros(1).double()
    for _ in range(20):
        residual = found - pulled
        equations = NormalEquations(1)
        equations.collect(residual.square().mean(1), Pull(2 * residual.mean(1, keepdim=True), curvatures), none)
        found = found + equations.step(1.0)
    deviation = float(equations.covariance().sqrt())
    assert abs(float(found)) < 3 * deviation < 3 * noise
    assert float(equations.weights[:6].max()) < 1e-3
    assert float(equations.weights[6:].min()) > 0.8


def test_trajectories_that_fit_alike_count_alike_and_exact_ones_too() -> None:
    for losses in (torch.full((4,), 2.0).double(), torch.zeros(4).double()):
        one = torch.ones(4, 1).double()
        equations = NormalEquations(1)
        equations.collect(losses, Pull(one, one[..., None]), one[..., None])
        assert torch.equal(equations.weights, equations.weights[:1].expand(4))
