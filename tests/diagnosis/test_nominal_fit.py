"""Gauss-Newton: a Jacobian that serves for some steps leads to the same minimum, with fewer of them."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from diagnosis.sets import FRICTION, recorded
from physid.data import RecordingSet
from physid.diagnosis.inputs.model_source import read_nominal_model
from physid.diagnosis.inputs.observations import load_observations
from physid.diagnosis.reference.discrepancy import fit_with_reference
from physid.diagnosis.reference.nominal_fit import NominalFit, fit_nominal_model
from physid.diagnosis.settings.settings import Settings
from physid.diagnosis.testing import begin_hypothesis, conclude, finish_hypothesis
from physid.effects import find
from physid.estimation.least_squares.experiment import Experiment, Fit
from physid.estimation.least_squares.levenberg_marquardt import gauss_newton, solve_shared
from physid.estimation.least_squares.line_search import best_step
from physid.estimation.least_squares.prior import prior
from physid.estimation.least_squares.settings import LeastSquaresSettings, LineSearchSettings
from physid.estimation.prediction.rollout import Predictor
from physid.estimation.segmented_fit import without_outliers

DRAG = 0.8
FAR = 0.5  # of the logarithm of the friction


@pytest.fixture(scope="module")
def nominal_fit(tmp_path_factory: pytest.TempPathFactory) -> NominalFit:
    effects = {"viscous_drag": {"coefficient": DRAG}}
    folder = recorded(tmp_path_factory.mktemp("fit") / "set", effects, trajectories=6, steps=80, split={"fit": 1})
    observations = load_observations(RecordingSet(folder))
    generator = torch.Generator().manual_seed(0)
    return fit_nominal_model(
        observations, read_nominal_model(observations.scene, None), [find("viscous_drag")], generator
    )


def counted(monkeypatch: pytest.MonkeyPatch, nominal_fit: NominalFit, chords: int) -> tuple[Fit, int]:
    """Fit the drag, and count the Jacobians that it takes."""
    made = 0
    linearise = Experiment.linearise

    def count(*arguments: object) -> Fit:
        nonlocal made
        made += 1
        return linearise(*arguments)  # type: ignore[arg-type]

    with monkeypatch.context() as patch:
        patch.setattr(Experiment, "linearise", count)
        far = nominal_fit.fit.point.replace(nominal=nominal_fit.fit.point.nominal + FAR)
        searched = nominal_fit.experiment.replace(settings=LeastSquaresSettings(line_search={"chords": chords}))
        return gauss_newton(searched, far, torch.tensor([0])), made


def test_an_older_jacobian_leads_to_the_same_minimum(monkeypatch: pytest.MonkeyPatch, nominal_fit: NominalFit) -> None:
    own = LineSearchSettings()
    (one, many), (other, few) = (counted(monkeypatch, nominal_fit, chords) for chords in (0, own.chords))
    tolerance = own.converged * (1 + float(one.loss.sum())) ** 0.5
    assert float(other.loss.sum()) < float(nominal_fit.fit.loss.sum()) - 100 * tolerance
    assert abs(float((one.loss - other.loss).sum())) < 2 * tolerance
    assert float(other.point.effects[0, 0]) == pytest.approx(float(one.point.effects[0, 0]), rel=1e-2)
    assert few < many


def test_residuals_with_an_older_jacobian_are_those_of_the_point(nominal_fit: NominalFit) -> None:
    moved = nominal_fit.fit.point.replace(effects=nominal_fit.fit.point.effects + 0.1)
    near = nominal_fit.experiment.linearise(nominal_fit.fit.point, torch.tensor([0]))
    quick, whole = nominal_fit.experiment.at(moved, near), nominal_fit.experiment.linearise(moved, torch.tensor([0]))
    assert torch.allclose(quick.residual, whole.residual, atol=1e-12)
    assert torch.allclose(quick.loss, whole.loss)
    assert torch.equal(quick.jacobian.state, near.jacobian.state)


def test_a_known_jacobian_alone_does_not_make_things_worse_and_takes_no_other(
    monkeypatch: pytest.MonkeyPatch, nominal_fit: NominalFit
) -> None:
    near = nominal_fit.experiment.linearise(nominal_fit.fit.point, torch.tensor([0]))
    monkeypatch.delattr(Experiment, "linearise")
    better = gauss_newton(nominal_fit.experiment, near, torch.tensor([0]), steps=0)
    assert float(better.loss.sum()) < float(near.loss.sum())
    assert torch.equal(better.jacobian.state, near.jacobian.state)


def test_initial_states_of_what_is_held_out_are_fitted_though_nothing_else_has_to_move(nominal_fit: NominalFit) -> None:
    experiment, best = nominal_fit.experiment, nominal_fit.fit
    fitted = torch.ones_like(experiment.fitted)
    fitted[0] = False
    experiment = experiment.replace(fitted=fitted)
    best = gauss_newton(experiment, best.point, torch.tensor([0]))
    held_out = ~fitted[experiment.predictor.segments.trajectory]
    pose = best.point.pose.clone()
    pose[0, held_out, :, 0] += 2e-3
    moved = experiment.linearise(best.point.replace(pose=pose), torch.tensor([0]))
    assert float(moved.loss[held_out].sum()) > 2 * float(best.loss[held_out].sum())
    again = gauss_newton(experiment, moved.point, torch.tensor([0]))
    assert float(again.loss[held_out].sum()) < 1.02 * float(best.loss[held_out].sum())


@pytest.mark.parametrize("effects", [{}, {"observation_latency": {"latency": 0.02}}], ids=["still", "late camera"])
def test_what_a_step_predicts_need_not_be_predicted_again(
    nominal_fit: NominalFit, effects: dict[str, dict[str, float]]
) -> None:
    experiment, drag = nominal_fit.experiment, torch.tensor([0])
    if effects:
        known = [*experiment.predictor.candidates, find("observation_latency")]
        predictor = experiment.predictor
        experiment = experiment.replace(
            predictor=Predictor(predictor.model, predictor.timeline, predictor.segments, known)
        )
    values = torch.tensor([[0.0, *(value for each in effects.values() for value in each.values())]])
    point = nominal_fit.fit.point.replace(nominal=nominal_fit.fit.point.nominal + FAR, effects=values.double())
    fit = experiment.linearise(point, drag)
    change = solve_shared(fit.normal(), experiment.fitted, prior(experiment, drag))
    step = best_step(experiment, fit, drag, change, torch.full_like(fit.loss, 1e-3), (1.0, 0.5, 0.0))
    assert step.predicted is not None
    assert len(step.damping.unique()) > 1  # segments have kept different trials
    again = experiment.predictor.predict(step.point)
    assert torch.allclose(step.predicted.pose, again.pose, atol=1e-10)
    assert torch.allclose(step.predicted.twist, again.twist, atol=1e-8)
    assert torch.allclose(step.predicted.impulse, again.impulse, atol=1e-8)
    kept, anew = experiment.moved(step.point, fit, step.predicted), experiment.at(step.point, fit)
    assert torch.allclose(kept.loss, anew.loss, rtol=1e-6)
    assert torch.allclose(kept.normal().vector, anew.normal().vector, rtol=1e-6, atol=1e-6)


def test_settings_of_the_estimator_reach_the_fit(nominal_fit: NominalFit) -> None:
    changes = {"noise.least": [0.1, 0.01], "least_squares.prior.effect": 5.0, "steps.rounds": 1}
    settings = Settings().changed(changes)
    observations = nominal_fit.observations
    found = fit_nominal_model(
        observations, nominal_fit.experiment.predictor.model, (), torch.Generator(), settings=settings
    )
    assert (found.noise.rotation, found.noise.position) == (0.1, 0.01)
    assert found.experiment.settings.prior.effect == 5.0
    still = Settings().changed({"noise.jump": [1e-9, 1e-9], "noise.usual": 1e-3})
    few, many = (without_outliers(observations, one.noise).present.sum() for one in (still, settings))
    assert few < many


@pytest.mark.slow
def test_steps_are_no_shorter_than_those_of_the_simulator_that_is_known_whatever_the_stamps(tmp_path: Path) -> None:
    words = {"jitter": 0.2, "missing": 0.1, "force_rate": 90.0, "frame_rate": 60.0}
    folder = recorded(tmp_path / "set", {}, trajectories=4, steps=40, split={"fit": 1}, **words)
    observations = load_observations(RecordingSet(folder))
    model = read_nominal_model(observations.scene, None)
    assert model.scene.integration is not None
    found = fit_nominal_model(observations, model, [], torch.Generator().manual_seed(0))
    grid = found.experiment.predictor.timeline.grid
    assert len(observations.timeline.grid.steps[0].unique()) > 5
    single = grid.steps[grid.real] / model.scene.integration.step
    assert float(single.min()) == pytest.approx(1, abs=0.01)
    assert float(single.max()) > 5
    assert float((observations.timeline.grid.steps / model.scene.integration.step).max()) > 20


@pytest.mark.slow
def test_a_camera_that_sees_between_the_steps_of_a_simulator_is_found_as_late_as_it_is(tmp_path: Path) -> None:
    # PyBullet takes four steps from frame to frame; the camera is 4.8 of them late.
    late = {"observation_latency": {"latency": 0.02}}
    changes = {"frame_rate": 60, "trajectories": 10, "steps": 100, "split": {"fit": 8, "report_same": 2}}
    observations = load_observations(RecordingSet(recorded(tmp_path / "late", late, **changes)))
    assert observations.scene.integration is not None
    model, kinds = read_nominal_model(observations.scene, None), [find("observation_latency")]
    found = fit_nominal_model(observations, model, kinds, torch.Generator().manual_seed(0))
    start = found.experiment.linearise(found.fit.point, torch.tensor([0]))
    one = finish_hypothesis(begin_hypothesis(found.experiment, start, (kinds[0].name,), found.settings))
    experiment, fit = fit_with_reference(one.experiment, one.fit, one.columns, one.names, found.settings)
    one = conclude(experiment, fit, one.names, found.settings)
    reach, friction = one.reach(one.covariance()), float(model.to_values(one.fit.point.nominal[0])[0])
    # Steps of the simulator alone, which are too long for it, had given 20.5 +- 0.4 ms.
    assert one.values["observation_latency.latency"] == pytest.approx(0.02, abs=float(reach[-1]))
    assert friction == pytest.approx(FRICTION, rel=float(reach[0]))


@pytest.mark.slow
def test_bodies_that_strike_each_other_are_followed_in_the_steps_of_the_simulator_throughout(tmp_path: Path) -> None:
    words = {"scene": "collide", "frame_rate": 60, "trajectories": 4, "steps": 30, "protocol_of_split": {}}
    observations = load_observations(RecordingSet(recorded(tmp_path / "set", {}, split={"fit": 1}, **words)))
    model = read_nominal_model(observations.scene, None)
    assert model.made_in is not None
    found = fit_nominal_model(observations, model, [], torch.Generator().manual_seed(0))
    grid = found.experiment.predictor.timeline.grid
    assert torch.allclose(grid.steps[grid.real], torch.tensor(model.made_in, dtype=torch.float64))
    assert found.steps is None
