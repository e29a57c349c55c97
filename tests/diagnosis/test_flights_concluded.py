"""What is concluded of free flights: sizes with their intervals, gaps that close, and what is said of whom."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch
import yaml
from torch import Tensor

from diagnosis.flown import QUICK, nominal_fit_of, random
from estimation.flights import FORCE, flights
from physid.diagnosis.conclusion.conclusion import Conclusion, draw_conclusion
from physid.diagnosis.conclusion.estimates import estimate
from physid.diagnosis.document.document import Impacts
from physid.diagnosis.fitted_model import save_model
from physid.diagnosis.progress import silent
from physid.diagnosis.reference.nominal_fit import NominalFit
from physid.diagnosis.selection.search import Attribution, search_catalogue
from physid.diagnosis.settings.settings import Settings
from physid.diagnosis.testing import Hypothesis
from physid.estimation.segmented_fit import UnexplainedEvents

ROLES = ("fit",) * 4 + ("same",) * 3 + ("transfer",) * 3
PUSH = tuple(float(k) for k in range(len(ROLES)))
KINDS = ("gravity_error", "constant_force", "viscous_drag")
NORMAL = 1.6448536  # standard deviations within which 90 % lie
DIGITS = 1e-4  # those of the document


def searched(
    sizes: tuple[float, ...] = (0.0, *FORCE, 0.0), kinds: tuple[str, ...] = KINDS, settings: Settings = QUICK
) -> tuple[NominalFit, Attribution]:
    made = flights(
        kinds=kinds, sizes=sizes, trajectories=len(ROLES), cuts=1, unknown=("block.mass",), push=PUSH,
    )  # fmt: skip
    nominal_fit = nominal_fit_of(made, ROLES, settings)
    return nominal_fit, search_catalogue(nominal_fit, random(), silent)


@pytest.fixture(scope="module")
def windy() -> tuple[NominalFit, Attribution]:
    return searched()


@pytest.fixture(scope="module")
def wind(windy: tuple[NominalFit, Attribution]) -> Conclusion:
    return draw_conclusion(*windy, random())


def best_of(found: Attribution) -> Hypothesis:
    assert found.best is not None
    return found.best


def test_the_wind_is_named_with_the_intervals_of_its_covariance(wind: Conclusion) -> None:
    best, said = best_of(wind.judgement.found), wind.diagnosis
    assert (said.verdict, said.group, said.minor, said.next_experiment) == ("named", ("constant_force",), (), None)
    assert not said.residual, "a cause that is named leaves nothing to describe"
    (effect,) = said.effects
    assert (effect.name, effect.site) == ("constant_force", "dynamics")
    deviation = best.covariance().diagonal().sqrt()[2:]
    for (name, one), error, true in zip(effect.parameters.items(), deviation.tolist(), FORCE, strict=True):
        assert one.value == pytest.approx(best.values[f"constant_force.{name}"], rel=DIGITS)
        assert one.unit == "N"
        reach = NORMAL * error
        assert (one.low, one.high) == pytest.approx((one.value - reach, one.value + reach), abs=2e-5)
        assert abs(one.value - true) < 4 * error
    assert wind.judgement.covariance is not None
    assert torch.equal(wind.judgement.covariance, best.covariance()), "no impact scatters anything"


def test_an_unknown_mass_is_given_without_and_with_the_wind_in_kilograms(wind: Conclusion) -> None:
    found, mass = wind.judgement.found, wind.diagnosis.parameters["block.mass"]
    best = best_of(found)
    before, after = (float(one.fit.point.nominal.exp()) for one in (found.nominal, best))
    assert mass.nominal == pytest.approx(before, rel=DIGITS)
    assert mass.with_effect is not None
    assert (mass.with_effect.value, mass.with_effect.unit) == (pytest.approx(after, rel=DIGITS), "kg")
    reach = NORMAL * best.covariance()[0, 0].sqrt()
    assert mass.with_effect.high / mass.with_effect.value == pytest.approx(float(reach.exp()), rel=DIGITS)
    assert mass.with_effect.value / mass.with_effect.low == pytest.approx(float(reach.exp()), rel=DIGITS)


def rms(hypothesis: Hypothesis, rows: Tensor) -> float:
    return float(hypothesis.fit.residual[rows][..., 3:].square().sum(-1).mean().sqrt())


def test_errors_are_those_of_held_out_flights_and_shares_what_closes_above_the_floor(wind: Conclusion) -> None:
    found, said = wind.judgement.found, wind.diagnosis
    best, floor = best_of(found), wind.judgement.nominal_fit.noise.floor
    assert (said.gap.unit, said.gap.floor) == ("m", pytest.approx(floor, rel=DIGITS))
    reported = wind.judgement.nominal_fit.observations.reported
    for errors, share, rows in zip(
        (said.gap.same, said.gap.transfer), (said.shrink.same, said.shrink.transfer), reported, strict=True
    ):
        before, after = rms(found.nominal, rows), rms(best, rows)
        assert errors is not None
        assert share is not None
        assert (errors.before, errors.after) == pytest.approx((before, after), rel=DIGITS)
        assert share.value == pytest.approx((before - after) / (before - floor), rel=0.02)
        assert share.low is not None
        assert share.high is not None
        assert share.low < share.value < share.high
    parts = said.shrink.parts
    assert parts["same"] == {"constant_force": said.shrink.same and said.shrink.same.value}
    assert parts["transfer"] == {"constant_force": said.shrink.transfer and said.shrink.transfer.value}


def test_the_ranking_falls_and_holds_what_was_fitted_by_prediction_and_others_by_the_score_test(
    wind: Conclusion,
) -> None:
    found, ranking = wind.judgement.found, wind.diagnosis.ranking
    gains = {row.names: row.gain for row in found.lack.rows}
    gains |= {one.names: float((found.nominal.held_out - one.held_out).sum()) for one in found.tried}
    assert [row.score for row in ranking] == sorted((row.score for row in ranking), reverse=True)
    assert {row.effects: row.score for row in ranking} == pytest.approx(gains, rel=DIGITS, abs=DIGITS)
    assert ranking[0].effects == ("constant_force",)
    for row in ranking:
        assert row.p_value == pytest.approx(found.lack.chance(row.effects, gains[row.effects]), rel=DIGITS)


def test_the_wind_acts_in_the_dynamics_of_a_free_fall_and_shows_along_its_axes(wind: Conclusion) -> None:
    said = wind.diagnosis
    assert said.where.site == {"perception": 0.0, "actuation": 0.0, "dynamics": 1.0, "contact": 0.0}
    assert said.where.phase == {"free_fall": 1.0}
    assert [cell.dof for cell in said.where.cells[:2]] == ["x", "y"]
    assert all(cell.evidence > 0 for cell in said.where.cells)
    assert said.excess == pytest.approx(wind.judgement.found.lack.missing, rel=DIGITS)
    assert said.null_simulations == len(wind.judgement.found.lack.null_best) == 150
    assert {one.effect for one in said.detectable} == {"gravity_error", "viscous_drag"}
    assert 0.5 < said.confidence == said.causes["constant_force"]
    assert sum(said.causes.values()) == pytest.approx(1, abs=DIGITS)


def test_no_more_is_written_than_is_asked_for(windy: tuple[NominalFit, Attribution], wind: Conclusion) -> None:
    nominal_fit, found = windy
    few = nominal_fit.settings.changed({"verdict.most_cells": 1, "verdict.most_ranks": 2})
    said = draw_conclusion(replace(nominal_fit, settings=few), found, random()).diagnosis
    assert said.where.cells == wind.diagnosis.where.cells[:1]
    assert said.ranking == wind.diagnosis.ranking[:2]
    assert said.settings == few.to_mapping()


def test_a_gap_within_the_tolerance_has_no_cause_though_an_effect_explains_it(
    windy: tuple[NominalFit, Attribution],
) -> None:
    nominal_fit, found = windy
    wide = replace(nominal_fit, settings=nominal_fit.settings.changed({"materiality.tolerance": 1.0}))
    concluded = draw_conclusion(wide, found, random())
    said = concluded.diagnosis
    assert (said.verdict, said.effects, said.group, concluded.further) == ("none", (), (), None)
    assert (concluded.judgement.chosen, concluded.judgement.shown, concluded.judgement.covariance) == (None,) * 3
    (minor,) = said.minor
    assert minor.effects == ("constant_force",)
    assert minor.p_value == pytest.approx(1 / 151, rel=DIGITS)
    assert minor.closes == pytest.approx(1, abs=0.05)
    assert said.gap.same.before > said.gap.floor
    assert said.gap.same.after is None
    assert (said.shrink.same, said.shrink.transfer, said.shrink.parts) == (None, None, {})


def test_where_no_wind_blows_nothing_is_said_to_be_anywhere() -> None:
    nominal_fit, found = searched((0.0,) * 4)
    said = draw_conclusion(nominal_fit, found, random()).diagnosis
    assert (said.verdict, said.effects, said.group, said.minor, said.residual) == ("none", (), (), (), ())
    assert not any(said.where.site.values())
    assert (said.where.cells, said.where.phase) == ((), {})
    assert said.parameters["block.mass"].with_effect is None
    assert said.gap.same.before == pytest.approx(said.gap.floor, rel=0.15)


def test_a_wind_that_the_catalogue_lacks_is_an_unknown_cause_and_described_as_a_force(
    windy: tuple[NominalFit, Attribution],
) -> None:
    nominal_fit, found = windy
    said = draw_conclusion(nominal_fit, replace(found, best=None, left=None, tried=[], group=[]), random())
    assert (said.diagnosis.verdict, said.diagnosis.effects, said.diagnosis.group) == ("unknown", (), ())
    laws = {law.direction: law for law in said.diagnosis.residual}
    assert laws.keys() == {"along x", "along y"}
    for direction, true in zip(("along x", "along y"), FORCE, strict=True):
        assert laws[direction].kind == "force"
        assert laws[direction].size == pytest.approx([true], abs=0.05)
    assert said.diagnosis.gap.same.after is None
    assert said.diagnosis.shrink.same is None


def test_twins_are_a_group_that_names_the_chosen_one_first(windy: tuple[NominalFit, Attribution]) -> None:
    nominal_fit, found = windy
    twins = replace(found, alike=("ground_tilt", "constant_force"))
    concluded = draw_conclusion(nominal_fit, twins, random())
    assert concluded.diagnosis.verdict == "group"
    assert concluded.diagnosis.group == ("constant_force", "ground_tilt")
    assert concluded.further is not None
    assert concluded.diagnosis.next_experiment == concluded.further.sentence


def test_sizes_end_where_their_range_ends_and_nothing_blamed_has_no_size(
    windy: tuple[NominalFit, Attribution],
) -> None:
    _, found = windy
    dragged = replace(best_of(found), names=("viscous_drag",), columns=torch.tensor([3]))
    value = float(dragged.fit.point.effects[0, 3])
    for error, low, high in ((1e-6, max(value, 0.0), value), (1e3, 0.0, 5.0)):
        covariance = error**2 * torch.eye(3).double()
        judged: Any = SimpleNamespace(
            found=SimpleNamespace(whole_nominal=found.nominal), shown=dragged, chosen=dragged, covariance=covariance
        )
        ((effect,), parameters) = estimate(judged, random())
        one = effect.parameters["coefficient"]
        assert (one.value, one.unit) == (value, "N s/m")
        assert (one.low, one.high) == pytest.approx((low, high), abs=1e-5)
        assert parameters["block.mass"].with_effect is not None
    nobody: Any = SimpleNamespace(found=judged.found, shown=None, chosen=None, covariance=covariance)
    effects, parameters = estimate(nobody, random())
    assert effects == ()
    assert parameters["block.mass"].with_effect is None


def test_a_saved_model_starts_from_the_new_estimates_with_the_effects_at_work(
    wind: Conclusion, windy: tuple[NominalFit, Attribution], tmp_path: Path
) -> None:
    save_model(tmp_path / "model.yaml", wind)
    text = (tmp_path / "model.yaml").read_text()
    assert text.startswith("# The nominal model with constant_force. physid fit --config model.yaml\n")
    said, saved = wind.diagnosis, yaml.safe_load(text)
    assert saved["model"]["learn"] == ["block.mass"]
    mass = said.parameters["block.mass"].with_effect
    assert mass is not None
    assert saved["model"]["values"] == {"block.mass": mass.value}
    sizes = {name: one.value for name, one in said.effects[0].parameters.items()}
    assert saved["model"]["engine"] == {"substeps": None, "effects": {"constant_force": sizes}}
    assert saved["data"]["folder"] == "data/flights"
    assert saved["data"]["shuffle"] is False
    odd = tmp_path / "a\nseed_everything: 1\nb c.yaml"
    save_model(odd, wind)
    assert yaml.safe_load(odd.read_text()) == saved
    assert odd.read_text().splitlines()[1:] == text.splitlines()[1:]
    vortex = replace(said, effects=(replace(said.effects[0], name="vortex"),), group=("vortex",))
    own = replace(wind, diagnosis=vortex)
    save_model(tmp_path / "own.yaml", own)
    assert "# vortex is an effect of your own: add --allow and its file.\n" in (tmp_path / "own.yaml").read_text()
    assert yaml.safe_load((tmp_path / "own.yaml").read_text())["model"]["engine"]["effects"] == {"vortex": sizes}
    nominal_fit, found = windy
    wide = replace(nominal_fit, settings=nominal_fit.settings.changed({"materiality.tolerance": 1.0}))
    nothing = draw_conclusion(wide, found, random())
    save_model(tmp_path / "none.yaml", nothing)
    text = (tmp_path / "none.yaml").read_text()
    assert "as it was believed: nothing was found" in text.splitlines()[0]
    assert yaml.safe_load(text)["model"]["values"] == {
        "block.mass": pytest.approx(nothing.diagnosis.parameters["block.mass"].nominal)
    }


@pytest.mark.parametrize(("left", "verdict"), [(2e-3, "unknown"), (1e-6, "none")])
def test_what_most_impacts_leave_is_a_gap_if_it_is_more_than_the_tolerance(left: float, verdict: str) -> None:
    nominal_fit, found = searched(sizes=(0.0,) * 4)
    vars(nominal_fit)["unexplained_events"] = UnexplainedEvents(7, 9, left, left)
    said = draw_conclusion(nominal_fit, found, random()).diagnosis
    assert said.verdict == verdict
    assert said.gap.impacts == Impacts(7, 9, left, left)
    assert said.evidence is not None
    within = said.gap.beyond_noise(said.gap.same) / said.gap.tolerance.position
    assert said.evidence.gap == pytest.approx(max(left / said.gap.tolerance.position, within), rel=1e-3)
    assert said.causes[verdict] == max(said.causes.values())


@pytest.mark.slow
def test_of_impacts_that_are_not_explained_is_said_how_many_are_with_the_effects() -> None:
    nominal_fit, found = searched()
    segments = nominal_fit.experiment.predictor.segments
    segments.struck[:] = True
    named = draw_conclusion(nominal_fit, found, random()).diagnosis
    assert named.verdict == "named"
    assert named.gap.impacts is not None
    assert named.gap.impacts.unexplained > 0.7 * len(segments)
    assert named.gap.impacts.with_effects == 0
    vars(nominal_fit).pop("unexplained_events")
    segments.struck[1:] = False
    assert draw_conclusion(nominal_fit, found, random()).diagnosis.gap.impacts is None, "one may be by chance"
