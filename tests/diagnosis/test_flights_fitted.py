"""Nominal fits of free flights: states, noise and steps, and a reference simulator that goes another way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import pytest
import torch
from torch import Tensor

from diagnosis.flown import QUICK, nominal_fit_of, observed, random
from estimation.flights import NOISE, Flights, G, flights
from physid.diagnosis.progress import Stage, silent
from physid.diagnosis.reference import discrepancy, numerics
from physid.diagnosis.reference.discrepancy import between, fit_with_reference, simulator_discrepancy, working_effects
from physid.diagnosis.reference.following import follow
from physid.diagnosis.reference.nominal_fit import fit_nominal_model
from physid.diagnosis.reference.numerics import keep_agreeing
from physid.diagnosis.reference.replay import Reference
from physid.estimation.least_squares import NONE
from physid.estimation.prediction import NominalModel, Predictor, Variants
from physid.physics.rotations import exponential, multiply
from physid.scenes.scene import Integration

ROLES = ("fit",) * 3 + ("same",)
BULLET = Integration("semi_implicit_euler", 1 / 240)
REPLAYS = QUICK.changed({"null_simulations.floor_replays": 2})


def calm(**changes: Any) -> Flights:
    return flights(**{"sizes": (0.0, 0.0), "trajectories": len(ROLES), "cuts": 1} | changes)


@pytest.mark.parametrize("known", [True, False])
def test_flights_are_fitted_by_parabolas_with_the_noise_that_they_have(known: bool) -> None:
    made = calm(frames=40)
    observations, old = observed(made, ROLES), made.experiment.predictor
    model = NominalModel(replace(old.model.scene, integration=BULLET if known else None))
    said = list[Stage]()
    found = fit_nominal_model(
        observations, model, old.candidates, random(), lambda stage, what="": said.append(stage), REPLAYS
    )
    assert (found.noise.rotation, found.noise.position) == pytest.approx(NOISE, rel=0.15)
    assert not found.events.any()
    assert len(found.phases.unique()) == 1
    assert found.references == (("pybullet",) if known else REPLAYS.replay.simulators)
    assert torch.equal(found.present, observations.present)
    time = observations.timeline.time[0]
    line = torch.stack([torch.ones_like(time), time], 1)
    fall = torch.zeros(40, 3).double()
    fall[:, 2] = -G * time**2 / 2
    best = line @ (torch.linalg.pinv(line) @ (observations.pose[:, :, 0, :3] - fall)) + fall
    predicted = found.fit.jacobian.base.pose[0, :, :, 0, :3]
    assert float((predicted - best).abs().max()) < (1.0 if known else 0.3) * NOISE[1]
    grid = found.experiment.predictor.timeline.grid
    assert torch.allclose(grid.steps[grid.real], torch.tensor(1 / 60).double())  # others go as far, in a free fall
    assert found.steps is not None
    assert Stage.CHOOSING_STEPS in said
    assert bool(found.experiment.follow.all()) is known
    assert bool(found.experiment.engine.any()) is known


@pytest.mark.parametrize(
    ("made_by", "substeps", "step"), [(None, 3, 1 / 180), (replace(BULLET, step=1 / 60), None, 1 / 60)]
)
def test_steps_that_are_given_or_one_from_frame_to_frame_are_not_chosen(
    made_by: Integration | None, substeps: int | None, step: float
) -> None:
    made = calm(frames=16)
    old = made.experiment.predictor
    model = NominalModel(replace(old.model.scene, integration=made_by), substeps=substeps)
    found = fit_nominal_model(observed(made, ROLES), model, (), random(), settings=REPLAYS)
    grid = found.experiment.predictor.timeline.grid
    assert torch.allclose(grid.steps[grid.real], torch.tensor(step).double())
    assert found.steps is None


def point_at(made: Flights, effects: Sequence[float]) -> Variants:
    return made.true.replace(effects=torch.tensor([effects]).double())


def test_states_between_two_points_lie_on_the_way_and_everything_else_is_the_others() -> None:
    made = calm(cuts=2)
    one, other = point_at(made, (1.0, 2.0)), point_at(made, (3.0, 4.0))
    other = other.replace(pose=other.pose.clone(), twist=other.twist + 2.0)
    other.pose[..., :3] += 1.0
    other.pose[..., 3:] *= -1  # the same attitudes
    share = torch.tensor([0.0, 0.25, 1.0, 0.5, 1.0, 0.0, 0.75, 1.0]).double()
    found = between(one, other, share)
    part = share[None, :, None, None]
    assert torch.allclose(found.pose[..., :3], one.pose[..., :3] + part)
    assert torch.allclose(found.twist, one.twist + 2 * part)
    assert torch.allclose(found.pose[..., 3:].norm(dim=-1), torch.ones(()).double())
    along = (found.pose[..., 3:] * one.pose[..., 3:]).sum(-1).abs()
    assert torch.allclose(along, torch.ones(()).double()), "no way lies between q and -q"
    assert torch.equal(found.effects, other.effects)
    angle = torch.tensor([0.0, 0.0, 1.2]).double()
    other.pose[..., 3:] = multiply(exponential(angle), one.pose[..., 3:])
    halfway = between(one, other, torch.full((8,), 0.5).double()).pose[..., 3:]
    assert torch.allclose(halfway, multiply(exponential(angle / 2), one.pose[..., 3:]), atol=1e-12)
    other.pose[..., 3:] *= -1
    again = between(one, other, torch.full((8,), 0.5).double()).pose[..., 3:]
    assert torch.allclose(again, halfway, atol=1e-12), "q and -q are one attitude"


def test_effects_at_work_are_those_that_are_named_with_the_values_of_a_point() -> None:
    made = flights(kinds=("gravity_error", "constant_force"), sizes=(0.1, 0.2, 0.3))
    predictor = made.experiment.predictor
    (wind,) = working_effects(predictor, made.true, ("constant_force",))
    assert {name: float(value) for name, value in wind.values().items()} == {"x": 0.2, "y": 0.3}
    both = working_effects(predictor, made.true, ("constant_force", "gravity_error"))
    assert [effect.name for effect in both] == ["gravity_error", "constant_force"]
    assert working_effects(predictor, made.true, ()) == ()


def bent(made: Flights, size: float) -> Tensor:
    """Return how far a reference simulator leaves flights along x, (R, T, 1, 7): as far as no initial state leads."""
    frames = made.experiment.pose.shape[1]
    off = torch.zeros_like(made.experiment.pose)
    off[..., 0] = size * torch.linspace(-1, 1, frames).double()[:, None] ** 2
    return off


@pytest.mark.parametrize("followed", [[True] * 4, [True, False, True, False], [False] * 4])
def test_what_the_reference_makes_is_taken_off_where_it_is_followed(
    followed: list[bool], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Recordings leave the model as the reference simulator does: its states are found, and nothing is left."""
    made = calm(noise=(0.0, 0.0))
    predictor, off = made.experiment.predictor, bent(made, 0.02)

    def other_engine(_model: Any, _time: Any, _cuts: Any, point: Variants, *_: Any) -> Tensor:
        return predictor.predict(point).pose[0] + off

    monkeypatch.setattr(discrepancy, "replay", other_engine)
    which = torch.tensor(followed)
    experiment = made.experiment.replace(pose=made.experiment.pose + off, follow=which)
    start = made.true.replace(twist=made.true.twist + 0.05)
    begun = experiment.linearise(start, NONE)
    known, fit = fit_with_reference(experiment, begun, NONE, (), QUICK)
    assert torch.allclose(known.engine[which][..., 3], off[which][..., 0], atol=1e-6)
    assert not bool((known.engine[~which].abs() > 1e-12).any())
    assert bool((fit.loss[which] < 1e-6).all())
    assert bool((fit.loss[~which] > 100).all())
    assert torch.allclose(fit.point.twist[:, which], made.true.twist[:, which], atol=1e-6)
    found = simulator_discrepancy(predictor, fit, which, (), QUICK)
    assert torch.allclose(found[..., 3], torch.where(which[:, None, None], off[..., 0], 0.0), atol=1e-9)


@pytest.mark.parametrize(("settled", "replays"), [(1e-12, 7), (0.01, 6), (1.0, 3)])
def test_rounds_of_fit_and_replay_end_where_the_loss_changes_by_less_than_so_many_standard_deviations(
    settled: float, replays: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A loss L = chi^2 / 2 of 614 has a standard deviation of sqrt(2 L) = 35; it changes by 4 first, then by less."""
    made, made_so_far = calm(), list[float]()
    predictor, off = made.experiment.predictor, bent(made, 0.002)

    def ever_nearer(_model: Any, _time: Any, _cuts: Any, point: Variants, *_: Any) -> Tensor:
        made_so_far.append(1 - 0.5 ** len(made_so_far))
        return predictor.predict(point).pose[0] + made_so_far[-1] * off

    monkeypatch.setattr(discrepancy, "replay", ever_nearer)
    experiment = made.experiment.replace(
        pose=made.experiment.pose + off, follow=torch.ones_like(made.experiment.follow)
    )
    settings = QUICK.changed({"discrepancy.settled": settled, "discrepancy.rounds": 6})
    known, fit = fit_with_reference(experiment, experiment.linearise(made.true, NONE), NONE, (), settings)
    assert float(known.losses(fit.point)[0].sum()) == pytest.approx(614, abs=1)
    assert len(made_so_far) == replays


@pytest.mark.parametrize(("follows", "known"), [(True, True), (False, True), (True, False)])
def test_a_simulator_is_followed_if_its_steps_are_known_and_it_is_asked_for(
    follows: bool, known: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = calm()
    old, off = made.experiment.predictor, bent(made, 0.02)
    model = NominalModel(replace(old.model.scene, integration=BULLET if known else None))
    predictor = Predictor(model, old.timeline, old.segments, old.candidates)
    monkeypatch.setattr(
        discrepancy, "replay", lambda _model, _time, _cuts, point, *_: predictor.predict(point).pose[0] + off
    )
    experiment = made.experiment.replace(predictor=predictor, pose=made.experiment.pose + follows * known * off)
    experiment = experiment.replace(follow=torch.ones_like(experiment.follow))
    settings = QUICK.changed({"discrepancy.follows": follows})
    alone = experiment.linearise(made.true, NONE)
    found, fit, noise = follow(experiment, alone, torch.ones(off.shape[:3]).double(), None, settings, silent)
    assert found.follow.tolist() == [follows and known] * 4
    expected = off[..., 0] if follows and known else torch.zeros_like(off[..., 0])
    assert torch.allclose(found.engine[..., 3], expected, atol=1e-6)
    assert float(fit.point.engine) == pytest.approx(float(follows and known), abs=0.02)
    assert noise.position == pytest.approx(NOISE[1], rel=0.2)


@pytest.mark.parametrize(
    ("bullet", "mujoco", "kept"),
    [
        (0.0, 0.0, ["pybullet", "mujoco"]),
        (1.1, 0.0, ["mujoco"]),
        (0.9, 0.0, ["pybullet", "mujoco"]),
        (0.0, -1.1, ["pybullet"]),
        (0.0, -0.9, ["pybullet", "mujoco"]),
        (4.1, 1.0, ["mujoco"]),  # 3.1 from the nearer of two that are 1 apart
        (3.9, 1.0, ["pybullet", "mujoco"]),
        (9.0, 9.2, ["pybullet", "mujoco"]),  # both agree, though not with the model
        (4.0, -4.0, ["pybullet", "mujoco"]),
    ],
)
def test_a_reference_counts_unless_it_stands_alone(
    bullet: float, mujoco: float, kept: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Distances are in standard deviations of the noise, after initial states are fitted anew."""
    made = calm()
    fit = nominal_fit_of(made, ROLES).fit
    unit = bent(made, 1.0)[0, :, 0, 0]
    line = torch.stack([torch.ones_like(unit), torch.arange(len(unit)).double()], 1)
    rest = unit - line @ torch.linalg.lstsq(line, unit[:, None]).solution[:, 0]
    size = NOISE[1] / float((rest.square().sum() / (6 * len(unit))).sqrt())
    away = {"pybullet": bullet * size, "mujoco": mujoco * size}

    def replay(*_: Any, reference: Reference) -> Tensor:
        return fit.jacobian.base.pose[0] + bent(made, away[reference.name])

    monkeypatch.setattr(numerics, "replay", replay)
    settings = keep_agreeing(made.experiment, fit, QUICK, silent)
    assert list(settings.replay.simulators) == kept
    assert QUICK.changed({"replay.simulators": kept}) == settings


@pytest.mark.parametrize("follows", [True, False])
def test_flights_count_whole_however_badly_they_fit_and_contact_segments_by_their_misfit(
    follows: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = calm()
    old = made.experiment.predictor
    predictor = Predictor(
        NominalModel(replace(old.model.scene, integration=BULLET)), old.timeline, old.segments, old.candidates
    )
    monkeypatch.setattr(discrepancy, "replay", lambda _model, _time, _cuts, point, *_: predictor.predict(point).pose[0])
    off = bent(made, 0.05)
    off[[0, 2]] = 0.0
    settings = QUICK.changed({"discrepancy.follows": follows, "nominal_fit.robust": False})
    scales = []
    for contact in (False, True):
        predictor.segments.contact[:] = contact
        experiment = made.experiment.replace(predictor=predictor, pose=made.experiment.pose + off)
        experiment = experiment.replace(follow=torch.ones_like(experiment.follow))
        alone = experiment.linearise(made.true, NONE)
        found, _, _ = follow(experiment, alone, torch.ones(off.shape[:3]).double(), None, settings, silent)
        scales.append(found.scale[:, 0, 0, 3])
    free, busy = scales
    assert float(free.max()) == pytest.approx(float(free.min()))
    assert float(busy[[1, 3]].max()) < 0.8 * float(busy[[0, 2]].min())


def test_a_contact_segment_in_which_no_state_goes_where_the_recording_went_is_given_up_and_counts_less(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made, lost = calm(), torch.tensor([False, False, True, False])
    predictor, away, own = made.experiment.predictor, bent(made, 0.02), bent(made, 0.02)
    own[2] = 0.5 * own[2].roll(2, -1)  # upwards, where the reference simulator goes along y
    away[2] = away[2].roll(1, -1)
    predictor.segments.contact[:] = True
    known = NominalModel(replace(predictor.model.scene, integration=BULLET))
    predictor = Predictor(known, predictor.timeline, predictor.segments, predictor.candidates)
    monkeypatch.setattr(
        discrepancy, "replay", lambda _model, _time, _cuts, point, *_: predictor.predict(point).pose[0] + away
    )
    experiment = made.experiment.replace(predictor=predictor, pose=made.experiment.pose + own)
    experiment = experiment.replace(follow=torch.ones_like(experiment.follow))
    alone = experiment.linearise(made.true, NONE)
    there = torch.ones(away.shape[:3]).double()
    found, fit, _ = follow(experiment, alone, there, None, QUICK, silent)
    assert torch.equal(found.follow, ~lost)
    assert not found.engine[2].any()
    assert torch.allclose(fit.point.pose[:, 2], made.true.pose[:, 2], atol=1e-9), "it returns to its fit without it"
    scale = found.scale[..., 3].median(1).values[:, 0]
    assert float(scale[2]) < 0.5 * float(scale[~lost].min())
    assert float(scale[~lost].max()) == pytest.approx(float(scale[~lost].min())), "all others count alike"


def test_segments_count_less_by_what_replays_of_one_fit_differ(monkeypatch: pytest.MonkeyPatch) -> None:
    """A variance f of the numerics, in that of the noise, adds to it: a weight of 1 / (1 + f)."""
    made, spread = calm(cuts=2), torch.tensor([0.0, 3.0, 0.0, 8.0, 0.0, 0.0, 0.0, 0.0]).double()
    monkeypatch.setattr(numerics, "floors", lambda *_: spread)
    monkeypatch.setattr(numerics, "fit_with_reference", lambda experiment, fit, *_: (experiment, fit))
    fit = made.experiment.linearise(made.true, NONE)
    found, _, _ = numerics.count_numerics(made.experiment, fit, QUICK, random(), silent)
    share = (found.scale / made.experiment.scale)[..., 3].amax((2,))
    expected = made.experiment.predictor.segments.spread((1 + spread).rsqrt())
    assert torch.allclose(share, expected)
    assert float(share.min()) == pytest.approx(1 / 3)
