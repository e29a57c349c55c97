"""Leaving trajectories out: closed forms for a mean. A step that a line cannot make: a camera that is turned far."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from diagnosis.sets import recorded
from physid.data import RecordingSet
from physid.data.reading import stretch_of
from physid.diagnosis.inputs.model_source import read_nominal_model
from physid.diagnosis.inputs.observations import Observations, load_observations
from physid.diagnosis.reference.nominal_fit import fit_nominal_model
from physid.diagnosis.settings.settings import Settings
from physid.diagnosis.testing.hypothesis import (
    Hypothesis,
    begin_hypothesis,
    conclude,
    finish_hypothesis,
    refitted_from_new_states,
)
from physid.effects import find
from physid.estimation.least_squares.covariance import predictive_score
from physid.estimation.least_squares.normal_equations import Normal
from physid.estimation.measurement.tracking_error import TrackingError
from physid.physics import Parameters, PhysicsLayer, State, World
from physid.physics.schemes.integration import Midpoint

NO_RIDGE = torch.zeros(1, dtype=torch.float64)


def means(values: torch.Tensor, fitted: torch.Tensor) -> Normal:
    """Return the normal equations of one shared mean, at the mean of the fitted values; one for each value (R,)."""
    left = values - values[fitted].mean()
    return Normal(torch.ones(len(values), 1, 1, dtype=torch.float64), left[:, None], left.square())


def test_a_value_is_predicted_with_the_mean_of_the_others_as_well_as_they_know_it() -> None:
    values = torch.tensor([1.0, 2.0, 4.0, 9.0, 3.0], dtype=torch.float64)
    fitted = torch.tensor([True, True, True, True, False])
    score = predictive_score(means(values, fitted), fitted, NO_RIDGE)
    for index, value in enumerate(values):
        others = values[fitted & (torch.arange(5) != index)]
        variance = 1 + 1 / len(others)  # of the value, and of the mean of the others: a normal distribution
        expected = (value - others.mean()) ** 2 / variance + math.log(variance)
        assert float(score[index]) == pytest.approx(float(expected))


def test_what_one_value_alone_tells_is_no_error_of_prediction_but_costs_its_evidence() -> None:
    size, ridge = 1000.0, torch.tensor([1e-2], dtype=torch.float64)
    pull = torch.tensor([0.0, 0.0, size], dtype=torch.float64)  # at the mean of the prior, of no use for the first two
    normal = Normal((pull / size)[:, None, None], pull[:, None], pull.square())
    score = predictive_score(normal, torch.tensor([True, True, False]), ridge)
    assert score[:2].tolist() == pytest.approx([0.0, 0.0])
    variance = 1 + 1 / float(ridge)
    assert float(score[2]) == pytest.approx(size**2 / variance + math.log(variance))


def test_a_trajectory_is_not_blamed_for_what_the_others_leave_open() -> None:
    generator = torch.Generator().manual_seed(3)
    columns = torch.randn(4, 30, 2, generator=generator, dtype=torch.float64)
    columns[:3, :, 1] = 0  # the last one alone shows the second parameter
    residual = torch.randn(4, 30, generator=generator, dtype=torch.float64)
    matrix = columns.mT @ columns
    ridge = torch.tensor([1e-4, 1e-4], dtype=torch.float64)

    def scored(true: float) -> torch.Tensor:
        seen = residual + columns[..., 1] * true
        total = torch.linalg.solve(matrix.sum(0) + torch.diag(ridge), (columns.mT @ seen[..., None])[..., 0].sum(0))
        left = seen - columns @ total  # at the fit
        normal = Normal(matrix, (columns.mT @ left[..., None])[..., 0], left.square().sum(1))
        return predictive_score(normal, torch.ones(4, dtype=torch.bool), ridge)

    assert torch.allclose(scored(0.0), scored(5.0), atol=0.1)  # the prior alone minds


@pytest.mark.slow
def test_a_camera_that_is_turned_far_is_followed(tmp_path: Path) -> None:
    turned = {"camera_yaw": {"angle": 0.4}}
    changes = {"protocol": "paper", "trajectories": 6, "split": {"fit": 1}, "unknown": ("block.mass", "block.friction")}
    observations = load_observations(RecordingSet(recorded(tmp_path / "set", turned, **changes)))
    generator = torch.Generator().manual_seed(0)
    nominal_fit = fit_nominal_model(
        observations, read_nominal_model(observations.scene, None), [find("camera_yaw")], generator
    )
    start = nominal_fit.experiment.linearise(nominal_fit.fit.point, torch.tensor([0]))
    found = begin_hypothesis(nominal_fit.experiment, start, ("camera_yaw",), nominal_fit.settings)
    assert found.values["camera_yaw.angle"] == pytest.approx(0.4, abs=0.02)
    assert float(found.fit.loss.sum()) < 1.2 * float(nominal_fit.experiment.counted().sum())


@pytest.mark.slow
def test_a_state_from_which_no_step_leads_back_is_found_anew_if_that_is_asked_for(tmp_path: Path) -> None:
    folder = recorded(tmp_path / "set", trajectories=4, steps=60, split={"fit": 1})
    observations = load_observations(RecordingSet(folder))
    model = read_nominal_model(observations.scene, None)
    right = fit_nominal_model(observations, model, [], torch.Generator().manual_seed(0))
    twist = right.fit.point.twist.clone()
    twist[0, 1, :, 2] = 4.0  # [rad/s]
    wrong = right.experiment.linearise(right.fit.point.replace(twist=twist), torch.zeros(0, dtype=torch.int64))
    stays = Settings().changed({"hypothesis.new_states": False})
    asked, left = (conclude(right.experiment, wrong, (), settings) for settings in (right.settings, stays))
    assert float(wrong.loss[1]) > 1e3 * float(right.fit.loss[1])
    assert float(refitted_from_new_states(asked).fit.loss.sum()) < 1.02 * float(right.fit.loss.sum())
    assert refitted_from_new_states(left) is left


@pytest.mark.slow
def test_an_interval_knows_what_an_error_that_all_poses_share_moves(tmp_path: Path) -> None:
    """The scale of films: recordings that are seen larger by it are fitted with parameters that are moved so far."""
    scale, unknown = 2e-3, ("block.friction",)
    observations = load_observations(RecordingSet(recorded(tmp_path / "set", unknown=unknown)))
    model = read_nominal_model(observations.scene, None)
    common = scale * stretch_of(observations.pose, (0.0, 0.0, 0.0))
    larger = observations.pose.clone()
    larger[..., :3] += common[..., 3:]

    def fitted(seen: Observations) -> Hypothesis:
        fit = fit_nominal_model(seen, model, [], torch.Generator().manual_seed(0))
        return conclude(fit.experiment, fit.fit, (), fit.settings)

    exact = fitted(observations)
    moved = float((fitted(replace(observations, pose=larger)).fit.point.nominal - exact.fit.point.nominal)[0, 0])
    unsure = replace(exact, experiment=exact.experiment.replace(common=common))
    added = float((unsure.covariance() - exact.covariance())[0, 0])
    assert added**0.5 == pytest.approx(abs(moved), rel=0.1)
    noise = 1e-4 * torch.randn((*observations.pose.shape[:3], 6), generator=torch.Generator().manual_seed(1))
    read = fitted(replace(observations, error=TrackingError(noise.double(), common / scale, scale)))
    assert read.experiment.common is not None
    assert torch.equal(read.experiment.common, common)


@pytest.mark.slow
def test_forces_that_come_late_between_two_frames_of_a_slow_camera_leave_nothing(tmp_path: Path) -> None:
    late = {"force_delay": {"delay": 0.015}}
    changes = {"protocol": "straight", "trajectories": 5, "split": {"fit": 1}, "unknown": ("block.friction",)}
    made = {"simulator": "closed_form", "frame_rate": 30.0, "steps": 40}
    observations = load_observations(RecordingSet(recorded(tmp_path / "set", late, **changes, **made)))
    left = {}
    for longest in (0.1, 0.0):  # the second does not know of late forces, and holds them from frame to frame
        settings = Settings().changed({"steps.late": longest})
        model = read_nominal_model(observations.scene, None)
        nominal = fit_nominal_model(
            observations, model, [find("force_delay")], torch.Generator().manual_seed(0), settings=settings
        )
        start = nominal.experiment.linearise(nominal.fit.point, torch.tensor([0]))
        found = finish_hypothesis(begin_hypothesis(nominal.experiment, start, ("force_delay",), settings))
        left[longest] = float(found.fit.loss.sum())
        short, long = (one.experiment.predictor.timeline.grid.steps.shape[1] for one in (found, nominal))
        assert (short > long) == bool(longest), "what is late takes shorter steps, the nominal model does not"
        if longest:
            error = float(found.covariance()[-1, -1].sqrt())
            assert found.values["force_delay.delay"] == pytest.approx(0.015, abs=2 * error)
    assert left[0.1] < left[0.0] - 100  # squared residuals


def test_a_body_that_sets_off_within_a_step_is_too_slow_by_what_the_choice_of_steps_reckons_with() -> None:
    # `parts_for_late_forces`: mu g h / 4 on average over the moments of a change from nothing to 2 mu m g
    friction, gravity, step, count = 0.2, 9.81, 1 / 60, 400
    share = (torch.arange(count, dtype=torch.float64) + 0.5) / count  # of the step that is over when the force comes
    wrench = torch.zeros(count, 1, 1, 6, dtype=torch.float64)
    wrench[:, 0, 0, 3] = 2 * friction * gravity * (1 - share)  # the mean force, of a block of 1 kg
    start = State(
        torch.tensor([[[0, 0, 0.1, 0, 0, 0, 1.0]]], dtype=torch.float64).expand(count, -1, -1),
        torch.zeros(count, 1, 6, dtype=torch.float64),
    )
    one = torch.ones(count, 1, dtype=torch.float64)
    block = Parameters.of_boxes(0.2 * one[..., None].expand(-1, -1, 3), one, friction * one, 0 * one)
    layer = PhysicsLayer(World(time_step=step, integration=Midpoint()))
    speed = layer.rollout(start, wrench, block).twist[:, 1, 0, 3]
    true = friction * gravity * step * (1 - share)
    assert float((true - speed).min()) > -1e-6
    assert float((true - speed).mean()) == pytest.approx(friction * gravity * step / 4, rel=0.01)
