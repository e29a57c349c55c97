"""Initial states that are guessed anew: a wrong one is mended, a right one is left alone."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from diagnosis.sets import recorded
from physid.data import RecordingSet
from physid.diagnosis.inputs.model_source import read_nominal_model
from physid.diagnosis.inputs.observations import load_observations
from physid.diagnosis.reference.nominal_fit import NominalFit, fit_nominal_model
from physid.effects import find
from physid.estimation.least_squares import NONE
from physid.estimation.least_squares.multi_start import carried, guesses, search, try_new_states, varied
from physid.estimation.least_squares.settings import MultiStartSettings
from physid.estimation.prediction import Predictor, Variants

NEAR = 1.1  # times the loss at the best initial state
ROUNDING = 1e-6  # worlds that are solved together take as many rounds as the worst of them


@pytest.fixture(scope="module")
def nominal_fit(tmp_path_factory: pytest.TempPathFactory) -> NominalFit:
    folder = recorded(tmp_path_factory.mktemp("restart") / "set", trajectories=4, steps=60, split={"fit": 1})
    observations = load_observations(RecordingSet(folder))
    generator = torch.Generator().manual_seed(0)
    return fit_nominal_model(
        observations,
        read_nominal_model(observations.scene, None),
        [find("camera_offset"), find("observation_latency"), find("camera_yaw")],
        generator,
    )


def test_a_wrong_initial_state_is_found_again_and_the_others_stay(nominal_fit: NominalFit) -> None:
    experiment, right = nominal_fit.experiment, nominal_fit.fit
    twist = right.point.twist.clone()
    twist[0, 1] = 0.0
    twist[0, 1, :, 2] = 4.0
    wrong = experiment.linearise(right.point.replace(twist=twist), NONE)
    count = experiment.predictor.segments.size * 6
    assert wrong.loss[1] > 10 * MultiStartSettings().doubtful * count[1]
    found = search(experiment, wrong)
    assert experiment.losses(found)[0, 1] < NEAR * right.loss[1]
    well = wrong.loss < MultiStartSettings().doubtful * count
    assert well.any()
    assert torch.equal(found.twist[0, well], wrong.point.twist[0, well])


def test_a_rival_that_found_the_motion_leads_to_it_through_another_camera_and_a_worse_one_changes_nothing(
    nominal_fit: NominalFit,
) -> None:
    """The camera stands 5 cm aside: where the rival saw a body, this one has to be 5 cm away from what it sees."""
    experiment, right, shift = nominal_fit.experiment, nominal_fit.fit, torch.zeros(7, dtype=torch.float64)
    shift[0] = 0.05
    alone = MultiStartSettings(doubtful=1e9, draws=0)
    moved = experiment.replace(
        pose=experiment.pose + shift, settings=experiment.settings.model_copy(update={"multi_start": alone})
    )
    aside = right.point.replace(effects=0.05 * torch.eye(5, dtype=torch.float64)[:1])
    seen = moved.linearise(right.point.replace(pose=right.point.pose + shift), NONE)  # the rival knows of no camera
    twist = aside.twist.clone()
    twist[0, 1, :, 2] = 4.0  # [rad/s]
    wrong = moved.linearise(aside.replace(twist=twist), NONE)
    assert float(wrong.loss[1]) > 1e3 * float(right.loss[1])
    assert search(moved, wrong) is wrong.point
    found = search(moved, wrong, seen)
    assert float(moved.losses(found)[0, 1]) < NEAR * float(right.loss[1])
    assert float((found.pose - aside.pose)[0, 1, :, :3].norm(dim=-1).max()) < 2e-3
    best = moved.linearise(aside, NONE)
    assert float(moved.losses(search(moved, best, wrong)).sum()) <= float(best.loss.sum())


def test_where_all_fits_nothing_is_searched(nominal_fit: NominalFit) -> None:
    count = nominal_fit.experiment.predictor.segments.size * 6
    assert (nominal_fit.fit.loss < MultiStartSettings().doubtful * count).all()
    assert search(nominal_fit.experiment, nominal_fit.fit) is nominal_fit.fit.point


def test_where_most_fit_badly_it_is_the_model_that_is_wrong(nominal_fit: NominalFit) -> None:
    twist = nominal_fit.fit.point.twist.clone()
    twist[..., 2] += 4.0
    wrong = nominal_fit.experiment.linearise(nominal_fit.fit.point.replace(twist=twist), NONE)
    assert search(nominal_fit.experiment, wrong) is wrong.point


def test_varied_states_explain_no_segment_worse_and_one_that_was_moved_better(nominal_fit: NominalFit) -> None:
    experiment, pose = nominal_fit.experiment, nominal_fit.fit.point.pose.clone()
    pose[:, 0, 0, 0] += 2e-3
    moved = experiment.linearise(nominal_fit.fit.point.replace(pose=pose), NONE)
    again = experiment.losses(varied(experiment, moved, moved.point))[0]
    assert (again <= moved.loss * (1 + ROUNDING)).all()
    assert float(again[0]) < float(moved.loss[0]) - 50
    best = nominal_fit.fit.point
    gained = nominal_fit.fit.loss - experiment.losses(varied(experiment, nominal_fit.fit, best))[0]
    assert (gained >= -ROUNDING * nominal_fit.fit.loss).all()
    none = experiment.settings.model_copy(update={"multi_start": MultiStartSettings(draws=0)})
    assert varied(experiment.replace(settings=none), moved, moved.point) is moved.point


def test_a_new_guess_is_taken_only_if_it_explains_more(nominal_fit: NominalFit) -> None:
    again = try_new_states(nominal_fit.experiment, nominal_fit.fit.point)
    assert (nominal_fit.experiment.losses(again)[0] <= nominal_fit.fit.loss + 1e-9).all()


def test_what_the_camera_adds_is_taken_off_before_a_state_is_guessed(nominal_fit: NominalFit) -> None:
    experiment, shift = nominal_fit.experiment, 0.05
    moved = experiment.replace(pose=experiment.pose + torch.tensor([shift, 0, 0, 0, 0, 0, 0], dtype=torch.float64))
    point = nominal_fit.fit.point.replace(effects=torch.tensor([[shift, 0, 0, 0, 0]], dtype=torch.float64))
    plain, seen = guesses(experiment, nominal_fit.fit.point), guesses(moved, point)
    assert torch.allclose(seen.pose, plain.pose, atol=1e-9)
    assert torch.allclose(seen.twist, plain.twist, atol=1e-6)


def test_some_segments_are_predicted_as_among_all(nominal_fit: NominalFit) -> None:
    experiment, point = nominal_fit.experiment, nominal_fit.fit.point
    late = point.replace(effects=torch.full_like(point.effects, 0.01))
    whole = experiment.predictor.predict(late)
    chosen = torch.tensor([1, 2])
    some = experiment.only(chosen, whole.state[0])
    own = late.replace(pose=late.pose[:, chosen], twist=late.twist[:, chosen])
    assert torch.equal(some.losses(own)[0], experiment.losses(late)[0, chosen])
    assert torch.equal(some.predictor.predict(own).pose, whole.pose)


def test_initial_states_follow_a_turned_camera_so_that_it_sees_what_it_saw(nominal_fit: NominalFit) -> None:
    experiment = nominal_fit.experiment
    predictor, start = experiment.predictor, experiment.predictor.segments.start
    effects = predictor.null[None].clone()
    effects[0, [term.label for term in predictor.terms].index("camera_yaw.angle")] = 0.5
    found = carried(experiment, nominal_fit.fit, nominal_fit.fit.point.replace(effects=effects))
    assert float((found.pose - nominal_fit.fit.point.pose)[..., :3].norm(dim=-1).max()) > 0.01
    now, before = predictor.predict(found).pose[0], nominal_fit.fit.jacobian.base.pose[0]
    first = (predictor.segments.trajectory, start)
    assert torch.allclose(now[first], before[first], atol=2e-3)


def test_a_lens_that_folds_the_picture_throws_no_state_away(
    nominal_fit: NominalFit, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Beyond the fold nothing is seen where it was: undoing it again and again ran off to 1e135 m."""

    def folded(_: Predictor, state: Tensor, _point: Variants) -> Tensor:
        place = state[..., :3]
        return torch.cat([place * (1 - 4 * place.square().sum(-1, keepdim=True)), state[..., 3:]], -1)

    experiment, fit = nominal_fit.experiment, nominal_fit.fit
    monkeypatch.setattr(Predictor, "observe", folded)
    found = carried(experiment, fit, fit.point)
    assert float(found.pose[..., :3].abs().max()) < 2 * float(fit.point.pose[..., :3].abs().max()) + 1
    assert experiment.losses(found).isfinite().all()
