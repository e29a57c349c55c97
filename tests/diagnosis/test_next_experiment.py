"""The experiment that would distinguish what recordings cannot: what is asked for, and when nothing is."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import pytest
import yaml

from diagnosis.flown import QUICK, hypothesis, nominal_fit_of
from estimation.flights import TOSS, Flights, flights
from physid.data.generation.settings import GenerateConfig
from physid.diagnosis.conclusion import next_experiment as planning
from physid.diagnosis.conclusion.next_experiment import REMEDIES, NextExperiment, next_experiment
from physid.diagnosis.reference.nominal_fit import NominalFit
from physid.diagnosis.selection.search import Attribution
from physid.diagnosis.settings.settings import Settings
from physid.effects import CATALOGUE
from physid.estimation.prediction import Predictor
from physid.scenes import find_setup

ROLES = ("fit",) * 4 + ("same",)
TWINS = ("constant_force", "ground_tilt")
FEW = QUICK.changed({"next_experiment.drawn": 1, "next_experiment.steps_with_impacts": 48})


def searched(
    names: tuple[str, ...] = TWINS, settings: Settings = FEW, alike: tuple[str, ...] = (), scene: str = "toss"
) -> tuple[NominalFit, Attribution]:
    """Return flights in a wind, and that hypotheses of one effect each predict them alike."""
    made = flights(kinds=TWINS, sizes=(0.8, -0.3, 0.0, 0.0), trajectories=len(ROLES), cuts=1)
    fit = nominal_fit_of(made, ROLES, settings)
    if scene != "toss":
        predictor = fit.experiment.predictor
        renamed = replace(predictor.model, scene=replace(predictor.model.scene, name=scene))
        predictor = Predictor(renamed, predictor.timeline, predictor.segments, predictor.candidates)
        fit = replace(fit, experiment=fit.experiment.replace(predictor=predictor))
    known = Flights(fit.experiment, made.true, made.start)
    group = [hypothesis(known, (name,), settings) for name in names]
    missing: Any = None
    return fit, Attribution(hypothesis(known, (), settings), missing, group, group[0], missing, group, alike)


def asked(**changes: Any) -> NextExperiment:
    found = next_experiment(*searched(**changes))
    assert found is not None
    return found


def apart(found: NextExperiment) -> tuple[float, float]:
    reported = re.search(
        r"differ by (\d+) standard deviations of the sensor in all, where .* by ([\d.]+)", found.sentence
    )
    assert reported is not None, found.sentence
    return float(reported.group(1)), float(reported.group(2))


def test_flights_that_hit_the_ground_tell_a_wind_from_a_tilted_ground() -> None:
    found = asked()
    assert found.sentence.startswith("record 24 trajectories of protocol ")
    assert "constant force and ground tilt then differ" in found.sentence
    assert found.sentence.endswith("; or use a second body of another mass, or let one fall freely")
    assert found.config is not None
    config = yaml.safe_load(found.config)
    assert config.pop("protocol") in find_setup("toss").protocols
    assert config == {
        "scene": "toss", "frame_rate": 60.0, "seed": 0, "trajectories": 24, "steps": 48, "unknown": [], "video": False
    }  # fmt: skip
    asked_for = GenerateConfig.from_mapping(yaml.safe_load(found.config))
    step = TOSS.time_step
    assert asked_for.true_scene().time_step == pytest.approx(step), "of the frame rate that it was judged at"
    assert asked_for.steps * step <= FEW.next_experiment.longest_with_impacts


@pytest.mark.parametrize("longest", [1.0, 0.2])
def test_a_trajectory_has_so_many_frames_and_lasts_no_longer_than_it_may(
    longest: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(planning, "_planned", lambda *_: 1e9)
    settings = FEW.changed({"next_experiment.longest": longest, "next_experiment.steps": 40})
    found = asked(scene="push", settings=settings)
    assert found.config is not None
    assert yaml.safe_load(found.config)["steps"] == min(40, round(60 * longest))


@pytest.mark.parametrize("arm", [0.0, 0.03])
def test_who_pushed_at_the_centre_of_mass_is_not_asked_for_torques(arm: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """The protocols of pushes that need a torque are tried only where the recordings have one."""
    tried = list[bool]()
    monkeypatch.setattr(
        planning, "_planned", lambda drawn, *_: tried.append(any(one.wrench[..., :3].any() for one in drawn)) or 1.0
    )
    fit, found = searched(scene="push")
    wrench = fit.observations.timeline.grid.wrench
    wrench[..., 3], wrench[..., 2] = 1.0, arm
    assert next_experiment(fit, found) is not None
    assert tried
    assert any(tried) is (arm > 0)


@pytest.mark.slow
def test_deviations_grow_as_the_root_of_how_many_trajectories_are_asked_for() -> None:
    many = FEW.changed({"next_experiment.record": 24 * 16})
    (one, here), (other, there) = apart(asked()), apart(asked(settings=many))
    assert other / one == pytest.approx(4, rel=0.05)
    assert there / here == pytest.approx(4, rel=0.05)


@pytest.mark.parametrize(
    "change",
    [pytest.param({"next_experiment.apart": 1e4}, marks=pytest.mark.slow), {"next_experiment.more": 1e4}],
    ids=str,
)
def test_an_experiment_that_tells_too_little_is_not_asked_for(change: dict[str, float]) -> None:
    found = asked(settings=FEW.changed(change))
    assert found.config is None
    assert found.sentence == (
        "no force profile of this scene tells them apart; use a second body of another mass, or let one fall freely"
    )


def test_of_a_scene_that_is_not_known_nothing_is_drawn() -> None:
    found = asked(scene="mine")
    assert found.config is None
    assert found.sentence.startswith("other pushes may tell them apart; use a second body")


def test_without_a_rival_there_is_nothing_to_tell_apart_and_twins_without_a_fit_have_a_remedy_alone() -> None:
    assert next_experiment(*searched(names=TWINS[:1])) is None
    fit, found = searched()
    assert next_experiment(fit, replace(found, best=None)) is None
    twin = asked(names=TWINS[:1], alike=("ground_tilt",))
    assert twin.config is None
    assert twin.sentence.endswith("tells them apart; use a second body of another mass, or let one fall freely")
    stranger = asked(names=TWINS[:1], alike=("tether",))
    assert stranger.sentence == "no force profile of this scene tells them apart", "nobody knows a remedy"


def test_remedies_are_for_effects_of_the_catalogue() -> None:
    known = {kind.name for kind in CATALOGUE}
    assert all(len(members) > 1 and members <= known for members, _ in REMEDIES)
