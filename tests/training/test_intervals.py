"""Confidence intervals: closed forms, and that they hold the truth as often as they say."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.stats import chi2, norm
from scipy.stats import t as student
from torch import Tensor

from physid.cli import main
from physid.commands.terminal.summary import summarize
from physid.data import RecordingSet, trajectory_path, write_scene, write_sums, write_trajectory
from physid.data.reading import ECHO, Reading, write_reading
from physid.estimation.least_squares.covariance import covariance_of, inflation, reach_of, scatter_of
from physid.estimation.least_squares.experiment import Fit
from physid.estimation.least_squares.levenberg_marquardt import NONE
from physid.estimation.least_squares.normal_equations import Normal, linearise
from physid.estimation.least_squares.settings import IntervalSettings
from physid.estimation.measurement.sensor_noise import Noise
from physid.scenes import find_setup
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


def test_the_interval_of_a_mean_is_students_where_the_noise_is_not_known() -> None:
    groups, frames = 7, 5
    value = torch.randn(groups, frames, 1, 6, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    slopes, real = slopes_of_a_mean(groups, frames)
    means = value[..., 0].mean((1, 2))
    normal = normal_of(PoseLoss(), means.mean() - value, slopes, real)
    ridge = ridge_of(normal.matrix.sum(0))
    scatter, freedom, seen = scatter_of(normal, ridge)
    assert float(scatter) == pytest.approx(float(means.var() / groups), rel=EXACT)
    assert float(freedom) == pytest.approx(groups - 1, rel=EXACT)
    assert float(seen) == pytest.approx(1, rel=EXACT)
    reach = float(reach_of(covariance_of(normal, ridge, torch.zeros(1).double())))
    scale_free = IntervalSettings(white=1e-6, tail=1e-6)
    exact = float(reach_of(covariance_of(normal, ridge, torch.zeros(1).double(), scale_free)))
    expected = float(student.ppf(0.95, groups - 1)) * float(scatter.sqrt())
    assert exact == pytest.approx(expected, rel=1e-3)
    assert reach == pytest.approx(expected, rel=0.03)


def test_an_interval_is_that_of_white_noise_where_trajectories_scatter_like_it() -> None:
    ratio, freedom = torch.ones(3).double(), torch.tensor([5.0, 20.0, 1000.0]).double()
    assert (inflation(ratio, freedom) > 1).all()
    assert (inflation(ratio, freedom).sqrt() < torch.tensor([1.15, 1.05, 1.01])).all()
    assert inflation(ratio, freedom).diff().lt(0).all()


@pytest.mark.parametrize("tail", [0.1, 1.0, 3.0])
@pytest.mark.parametrize("freedom", [3.0, 10.0])
def test_far_beyond_white_noise_an_interval_is_students_with_two_tails_more_degrees_of_freedom(
    tail: float, freedom: float
) -> None:
    """A density of f^-(1 + tail) and a chi-square of n degrees make an inverse gamma distribution of f."""
    ratio, settings = 1e4, IntervalSettings(white=1e-9, tail=tail)
    found = float(inflation(torch.tensor([ratio]).double(), torch.tensor([freedom]).double(), settings))
    degrees = freedom + 2 * tail
    expected = ratio * freedom / degrees * (student.ppf(0.95, degrees) / norm.ppf(0.95)) ** 2
    assert found == pytest.approx(expected, rel=1e-2)


@pytest.mark.parametrize("extra", [1.0, 2.0, 10.0, 1e3])
@pytest.mark.parametrize("freedom", [5.0, 9.0, 23.0])
def test_intervals_hold_the_truth_as_often_as_they_say_whatever_disturbs_the_estimates(
    extra: float, freedom: float
) -> None:
    # An error of variance `extra`, in variances of white noise, and a scatter that says so with chance of its own.
    ratio = torch.tensor(chi2.rvs(freedom, size=1000, random_state=0)) / freedom * extra
    reach = reach_of(torch.diag(inflation(ratio, torch.full_like(ratio, freedom))))
    held = float(torch.erf(reach / math.sqrt(2 * extra)).mean())
    assert 0.86 < held < 0.945


def test_what_one_trajectory_alone_says_has_a_wide_interval() -> None:
    matrix = torch.eye(2).double().expand(6, 2, 2).clone()
    matrix[1:, 1, 1] = 0.0
    vector = torch.randn(6, 2, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    vector[1:, 1] = 0.0
    ridge = torch.full((2,), 1e-9).double()
    normal = Normal(matrix, vector, vector[:, 0].square()).solved(ridge)
    _, freedom, seen = scatter_of(normal, ridge)
    assert float(seen[1]) < 1e-3 < 0.999 < float(seen[0])
    assert freedom.tolist() == pytest.approx([5.0, 1.0], rel=1e-2)
    alone, shared = covariance_of(normal, ridge).diagonal().flip(0) * normal.matrix.sum(0).diagonal().flip(0)
    assert alone > 2 > shared


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
    assert 1 <= float(variance) / (noise.position**2 / (groups * frames)) < 1.5


def test_curvatures_that_are_no_numbers_or_bend_the_wrong_way_make_parameters_unknown() -> None:
    vector = torch.tensor([[0.1, 0.1], [-0.2, -0.1], [0.1, 0.0]]).double()
    bend, none = torch.tensor([[1.0, 0.0], [0.0, -0.5]]).double().expand(3, 2, 2), torch.zeros(2).double()
    good, wrong = covariance_of(Normal(bend, vector, none), ridge_of(bend.sum(0)), none).diagonal().sqrt().tolist()
    assert 0 < good < 1 < 1e3 < wrong
    three, flat = torch.eye(3).double().repeat(3, 1, 1), torch.zeros(3, 3).double()
    for place in ((1, 0, 0), (2, 0, 1)):
        for value in (math.nan, math.inf):
            matrix, slope = three.clone(), flat.clone()
            matrix[place], slope[place[:2]] = value, value
            for nothing in (Normal(matrix, flat, none), Normal(three, slope, none)):
                assert covariance_of(nothing, torch.ones(3).double(), torch.zeros(3).double()).isnan().all()


def test_the_noise_of_an_interval_is_the_smaller_of_that_of_poses_and_of_residuals() -> None:
    bent, left = Noise(rotation=2e-3, position=3e-4), Noise(rotation=3e-3, position=2e-4)
    assert bent.or_less(left) == left.or_less(bent) == Noise(rotation=2e-3, position=2e-4)


def test_segments_of_one_trajectory_count_as_one() -> None:
    vector, matrix = torch.randn(6, 2, dtype=torch.float64), torch.eye(2, dtype=torch.float64).expand(6, 2, 2)
    twice = Normal(matrix, vector, vector[:, 0]).grouped(torch.arange(3).repeat_interleave(2))
    assert torch.equal(twice.matrix, 2 * matrix[:3])
    assert torch.equal(twice.vector, vector[::2] + vector[1::2])


def test_an_interval_is_normal_in_the_logarithm() -> None:
    low, high = intervals({"block.mass": 2.0}, torch.tensor([[0.01]]).double())["block.mass"]
    width = 0.1 * norm.ppf(0.95)
    assert (low, high) == pytest.approx((2 * math.exp(-width), 2 * math.exp(width)))


def test_a_parameter_without_influence_has_no_interval() -> None:
    vector, matrix = torch.randn(5, 2).double(), torch.zeros(5, 2, 2).double()
    matrix[:, 0, 0] = 1.0
    vector[:, 1] = 0.0
    response = Response(Normal(matrix, vector, vector[:, 0]), torch.zeros(2).double())
    found = intervals({"seen": 1.0, "unseen": 1.0}, response.covariance())
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


@pytest.mark.slow
def test_a_fit_reports_intervals_and_marks_what_is_not_identifiable(
    recordings: Callable[[str], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config, data = str(CONFIGS / "slide_friction.yaml"), f"data.folder={recordings('push')}"
    assert main(["fit", "--config", config, data, f"--run-dir={tmp_path / 'told'}"]) == 0
    figures = json.loads((tmp_path / "told" / "metrics.json").read_text())
    assert figures["params/block.friction/observable"] == 1
    estimate = figures["params/block.friction/estimate"]
    assert figures["params/block.friction/low"] < estimate < figures["params/block.friction/high"]
    assert "(90 %" in capsys.readouterr().out
    data = f"data.folder={recordings('slide')}"
    assert main(["fit", "--config", config, data, "model.learn=[block.mass]", f"--run-dir={tmp_path / 'not'}"]) == 0
    figures = json.loads((tmp_path / "not" / "metrics.json").read_text())
    assert figures["params/block.mass/observable"] == 0
    assert not {"params/block.mass/low", "params/block.mass/high"} & figures.keys()
    assert "DO NOT RELY ON IT" in summarize(figures, tmp_path)


def test_an_interval_of_a_model_that_leaves_more_than_noise_says_on_what_it_rests(tmp_path: Path) -> None:
    figures = {f"params/block.mass/{name}": value for name, value in (("estimate", 2.0), ("low", 1.9), ("high", 2.1))}
    figures |= {f"fit/{kind}_{name}": 1.0 for kind in ("position", "rotation") for name in ("explained", "noise")}
    assert "2 kg (90 %: 1.9 to 2.1)" in summarize(figures, tmp_path)
    left = {"fit/rotation_explained": 0.0, "fit/rotation_unexplained": 2.0}
    assert "2 kg (90 % if the model held: 1.9 to 2.1)" in summarize(figures | left, tmp_path)


def exact_equations(matrix: Tensor, vector: Tensor) -> NormalEquations:
    equations = NormalEquations()
    losses, none = torch.ones(len(vector)).double(), torch.zeros(*vector.shape, 0).double()
    equations.collect(losses, Normal(matrix, vector, losses), none)
    return equations


def test_no_interval_from_video_is_narrower_than_engines_agree() -> None:
    equations = exact_equations(torch.ones(20, 1, 1).double(), torch.zeros(20, 1).double())
    low, high = intervals({"block.friction": 0.12}, equations.covariance())["block.friction"]
    assert 1 < math.log(high / low) / (2 * norm.ppf(0.95) * LEAST) < 1.05


def test_a_parameter_that_films_say_nothing_about_has_no_interval() -> None:
    vector = torch.tensor([[0.1, 0.0], [-0.2, 0.0], [0.1, 0.0]], dtype=torch.float64)
    matrix = torch.diag(torch.tensor([1.0, 0.0], dtype=torch.float64)).expand(3, -1, -1)
    covariance = exact_equations(matrix, vector).covariance()
    assert intervals({"seen": 1.0, "unseen": 1.0}, covariance).keys() == {"seen"}


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


@pytest.mark.slow
def test_an_interval_knows_what_an_unsure_scale_of_films_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    words = ["trajectories=6", "steps=60", "frame_rate=60", "video=false", "split={train: 6}"]
    assert main(["generate", "--config", "generate/push_rich", "--out", "exact", "--quiet", "--workers=1", *words]) == 0
    exact, scale = RecordingSet(tmp_path / "exact"), 2e-3
    scene = dataclasses.replace(exact.scene, camera=find_setup("push").scene.camera)
    assert scene.camera is not None
    middle = np.array(scene.camera.target)

    def fitted(name: str, share: float, deviation: float) -> tuple[float, float, float]:
        for folder in (tmp_path / name, tmp_path / name / ECHO):
            folder.mkdir()
            for index, one in enumerate(exact):
                pose = one.pose.copy()
                pose[..., :2] += share * (pose[..., :2] - middle[:2])
                write_trajectory(trajectory_path(folder, index), dataclasses.replace(one, pose=pose, twist=None))
            write_scene(folder, scene)
            write_sums(folder)
        write_reading(tmp_path / name, Reading("films", "", "planar", 0.0, deviation, ""))
        assert main(["fit", name]) == 0
        figures = json.loads((tmp_path / "runs" / name / "metrics.json").read_text())
        return tuple(figures[f"params/block.friction/{word}"] for word in ("estimate", "low", "high"))  # type: ignore[return-value]

    estimate, low, high = fitted("sure", 0.0, 0.0)
    same, wider_low, wider_high = fitted("unsure", 0.0, scale)
    moved, *_ = fitted("moved", scale, 0.0)
    assert same == estimate
    more = math.sqrt((wider_high - wider_low) ** 2 - (high - low) ** 2) / 2
    assert more == pytest.approx(norm.ppf(0.95) * abs(moved - estimate), rel=0.1)


def test_a_fit_that_may_take_so_many_steps_ends_with_intervals(
    recordings: Callable[[str], Path], tmp_path: Path
) -> None:
    words = [f"data.folder={recordings('push')}", "data.limit=3", "trainer.max_steps=2", f"--run-dir={tmp_path}"]
    assert main(["fit", "--config", str(CONFIGS / "push_friction.yaml"), *words]) == 0
    figures = json.loads((tmp_path / "metrics.json").read_text())
    assert figures["params/block.friction/low"] < figures["params/block.friction/high"]
    assert "fit/position_explained" in figures
    assert "params/block.friction/observable" in figures
    assert (tmp_path / "posterior.json").is_file()


@pytest.mark.parametrize(("bias", "said"), [(0.05, "estimates by 0.058 standard errors"), (2e-38, "next to nothing")])
def test_what_shorter_steps_would_change_is_said_where_it_is_worth_a_number(
    bias: float, said: str, tmp_path: Path
) -> None:
    left = 0.008 if bias > 1e-9 else 0.0
    figures = {"steps/mean": 1.05, "steps/largest": 8.0, "steps/bias": bias, "steps/left": left}
    assert said in summarize(figures, tmp_path)
