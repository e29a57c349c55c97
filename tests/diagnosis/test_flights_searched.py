"""Searches of free flights: the wind that blows is found, rivals are fitted, and what closes is what it closes."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
import torch

from diagnosis.flown import QUICK, busy, examined, hypothesis, random
from estimation.flights import FORCE, NOISE, Flights, flights
from physid.diagnosis.progress import silent
from physid.diagnosis.selection.comparison import by_prediction, compare_candidates, gain, survivors
from physid.diagnosis.selection.contact_free import refit_all_segments
from physid.diagnosis.selection.evidence import beyond_chance, confirmed, evident, explained, improves_held_out, sound
from physid.diagnosis.selection.materiality import excess_left, is_material, tolerance_of
from physid.diagnosis.selection.search import leaves_nothing, search_catalogue, unexplained
from physid.diagnosis.selection.several import Fitted, leaves
from physid.diagnosis.testing import find_lack_of_fit
from physid.diagnosis.testing.hypothesis import (
    Hypothesis,
    begin_from_finite_sizes,
    begin_hypothesis,
    columns_of,
    finish_hypothesis,
    refitted_from_new_states,
)
from physid.diagnosis.testing.parametric_bootstrap import bootstrap_spread
from physid.estimation.least_squares.settings import LeastSquaresSettings, MultiStartSettings
from physid.physics import SolverError

KINDS = ("gravity_error", "constant_force", "viscous_drag")
WIND = (0.0, *FORCE, 0.0)
HELD = torch.tensor([True, True, True, False, True])


def windy(**changes: Any) -> Flights:
    return flights(**{"kinds": KINDS, "sizes": WIND, "trajectories": 5, "fitted": HELD, **changes})


def begun(made: Flights, *names: str, settings: Any = QUICK) -> Hypothesis:
    start = made.experiment.linearise(hypothesis(made).fit.point, torch.arange(4))
    return begin_hypothesis(made.experiment, start, names, settings)


def test_a_search_finds_the_wind_that_blows_and_nothing_where_none_does() -> None:
    made = windy()
    found = search_catalogue(examined(made), random(), silent)
    assert found.best is not None
    assert found.best.names == ("constant_force",)
    assert [one.names for one in found.group] == [("constant_force",)]
    assert leaves_nothing(found)
    assert not unexplained(found)
    assert not found.contact_free
    assert found.whole_nominal is found.nominal
    assert found.whole_best is found.best
    calm = search_catalogue(examined(windy(sizes=(0.0,) * 4)), random(), silent)
    assert (calm.best, calm.left, calm.tried, calm.group) == (None, None, [], [])
    assert not leaves_nothing(calm)
    assert not unexplained(calm)


@pytest.mark.slow
def test_two_effects_are_found_together_where_each_alone_leaves_something() -> None:
    made = windy(sizes=(0.05, 2.0, -0.5, 0.0), trajectories=6, fitted=None)
    found = search_catalogue(examined(made), random(), silent)
    assert found.best is not None
    assert set(found.best.names) == {"constant_force", "gravity_error"}
    error = float(found.best.covariance()[1, 1].sqrt())
    assert found.best.values["gravity_error.change"] == pytest.approx(0.05, abs=4 * error)


def test_a_hypothesis_has_the_sizes_of_its_fit_the_effects_at_work_and_those_that_may_be_absent() -> None:
    made = windy()
    one = begun(made, "constant_force")
    assert one.columns.tolist() == columns_of(made.experiment.predictor, ["constant_force"]).tolist() == [1, 2]
    assert one.values.keys() == {"constant_force.x", "constant_force.y"}
    assert list(one.values.values()) == one.fit.point.effects[0, 1:3].tolist()
    (effect,) = one.working
    assert {name: float(value) for name, value in effect.values().items()} == pytest.approx(
        {"x": one.values["constant_force.x"], "y": one.values["constant_force.y"]}
    )
    covariance = torch.diag(torch.tensor([1.0, 1e-4, 1e-4]).double())
    assert one.reach(covariance).tolist() == pytest.approx([1.6449, 0.016449, 0.016449], rel=1e-3)
    assert one.absent(covariance) == []
    assert one.absent(1e6 * covariance) == ["constant_force"]
    sure_of_y = torch.diag(torch.tensor([1.0, 1e2, 1e-4]).double())
    assert one.absent(sure_of_y) == [], "one size that is not nothing is enough"
    truth = torch.tensor(FORCE).double()
    error = (one.fit.point.effects[0, 1:3] - truth) / one.covariance().diagonal()[1:].sqrt()
    assert float(error.abs().max()) < 4


def test_one_step_follows_residuals_to_what_made_them() -> None:
    made = windy()
    one = begun(made, "constant_force")
    pushed = made.experiment.predictor.predict(
        one.fit.point.replace(effects=one.fit.point.effects + torch.tensor([[0.0, 0.2, -0.1, 0.0]]).double())
    )
    residual = made.experiment.replace(pose=pushed.pose[0]).residual(one.fit.jacobian.base.pose, one.fit.point)[0]
    assert one.follow(residual).tolist() == pytest.approx([0.0, 0.2, -0.1], abs=2e-3)
    shared = replace(one, experiment=made.experiment.replace(common=residual))
    added = shared.covariance() - one.covariance()
    moved = torch.tensor([0.2, -0.1]).double()
    assert torch.allclose(added[1:, 1:], torch.outer(moved, moved), rtol=0.05)


def test_fits_begin_end_and_start_from_finite_sizes_at_the_same_wind() -> None:
    made = windy()
    one = begun(made, "constant_force")
    done = finish_hypothesis(one)
    assert float(done.fit.loss[:6].sum()) <= float(one.fit.loss[:6].sum()) + 1e-3
    assert torch.allclose(done.fit.point.effects, one.fit.point.effects, atol=0.02)
    change = torch.tensor([0.3, -0.1]).double()
    point = made.start.replace(effects=made.start.effects.clone())
    again = begin_from_finite_sizes(made.experiment, point, ("constant_force",), change, QUICK)
    assert torch.allclose(again.fit.point.effects, one.fit.point.effects, atol=0.02)
    both = begun(made, "constant_force", "gravity_error")
    assert both.names == ("constant_force", "gravity_error")
    assert both.columns.tolist() == [0, 1, 2]


def test_a_badly_fitted_segment_is_fitted_from_new_states_if_that_leaves_less() -> None:
    lone = LeastSquaresSettings(multi_start=MultiStartSettings(draws=0))
    made = windy(settings=lone)
    one = hypothesis(made, ("constant_force",))
    assert refitted_from_new_states(one) is one
    pose = one.fit.point.pose.clone()
    pose[0, 2, 0, 0] += 0.03
    wrong = replace(one, fit=made.experiment.linearise(one.fit.point.replace(pose=pose), one.fit.effects))
    found = refitted_from_new_states(wrong)
    assert float(found.fit.loss.sum()) == pytest.approx(float(one.fit.loss.sum()), rel=0.01)


def stand_in(name: str, held_out: list[float], fitted: list[bool] | None = None) -> Any:
    rows = torch.tensor(fitted or [True] * len(held_out))
    return SimpleNamespace(names=(name,), held_out=torch.tensor(held_out), settings=QUICK,
                           experiment=SimpleNamespace(fitted=rows, scale=torch.ones(len(rows), 5, 1, 6)))  # fmt: skip


def test_what_is_gained_counts_in_fitted_trajectories_and_what_is_confirmed_in_the_others() -> None:
    rows = [True, True, False]
    before, after = stand_in("", [50.0, 40.0, 30.0], rows), stand_in("a", [20.0, 45.0, 10.0], rows)
    assert gain(before, after) == pytest.approx(25)
    assert confirmed(before, after)
    assert not confirmed(after, before)
    assert not confirmed(before, before), "no better is not better"
    assert confirmed(stand_in("", [1.0]), stand_in("a", [2.0])), "no others contradict"
    assert improves_held_out(before, after)
    share, others = 0.6 * QUICK.evidence.least, [True, False, False]
    both = [stand_in(name, [0.0, loss, loss], others) for name, loss in (("", share), ("a", 0.0))]
    assert improves_held_out(*both), "over all of them together"
    assert not improves_held_out(before, stand_in("a", [0.0, 0.0, 30.0 - QUICK.evidence.least], rows))
    assert [one.names[0] for one in by_prediction([before, after])] == ["a", ""]
    lack: Any = SimpleNamespace(excess=10.0, reach=lambda names: 24.9)
    assert explained(before, after, lack) == pytest.approx(25)
    assert explained(before, before, SimpleNamespace(excess=-3.0)) == 1e-9  # type: ignore[arg-type]
    assert beyond_chance(before, after, lack)
    assert not beyond_chance(before, after, SimpleNamespace(reach=lambda _: 25.0))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("held_out", "reached", "there"),
    [(10.0, 24.0, True), (31.0, 24.0, False), (10.0, 25.0, False), (31.0, 26.0, False)],
)
def test_an_effect_is_sound_that_gains_more_than_chance_and_predicts_better(
    held_out: float, reached: float, there: bool
) -> None:
    rows = [True, False]
    before, after = stand_in("", [50.0, 30.0], rows), stand_in("a", [25.0, held_out], rows)
    assert sound(before, after, SimpleNamespace(reach=lambda _: reached)) is there  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("losses", "there"), [((44.0,), False), ((46.0,), True), ((28.0, 29.0, 200.0), False), ((20.0, 46.0, 46.0), True)]
)
def test_a_gap_is_evident_where_most_trajectories_leave_the_model_by_one_and_a_half_variances_of_noise_a_value(
    losses: tuple[float, ...], there: bool
) -> None:
    assert evident(stand_in("", [1e9, *losses], [True] + [False] * len(losses))) is there


@pytest.mark.parametrize(
    ("p_value", "missing", "least", "more"),
    [(0.019, 0.26, 0.129, True), (0.021, 0.26, 0.0, False), (0.019, 0.24, 0.0, False), (0.019, 0.26, 0.131, False)],
)
def test_one_effect_more_is_looked_for_where_enough_is_left_beyond_chance(
    p_value: float, missing: float, least: float, more: bool
) -> None:
    before, best = stand_in("", [30.0]), stand_in("a", [5.0])
    lack: Any = SimpleNamespace(excess=0.0)
    left: Any = SimpleNamespace(p_value=p_value, missing=missing, frames=2.0)
    assert leaves(before, best, lack, left, least) is more


@pytest.mark.parametrize(("share", "there"), [(0.5, True), (0.501, False)])
def test_a_gap_that_no_effect_explains_is_there_where_it_is_as_rare_as_half_of_what_chance_is_allowed(
    share: float, there: bool
) -> None:
    quiet = stand_in("", [0.0])
    found: Any = SimpleNamespace(best=None, nominal=quiet, lack=SimpleNamespace(p_free=share * QUICK.evidence.alpha))
    assert unexplained(found) is there
    found.best = stand_in("a", [0.0])
    assert not unexplained(found)


def test_candidates_that_cannot_be_simulated_are_passed_over_and_the_best_comes_first() -> None:
    made = windy(sizes=(0.0, 2.0, -1.5, 0.0))
    still = made.experiment.replace(follow=torch.zeros_like(made.experiment.follow))
    made = Flights(still, made.true, made.start)
    nominal, said = hypothesis(made), list[str]()

    def begin(names: tuple[str, ...]) -> Hypothesis:
        if names == ("viscous_drag",):
            raise SolverError("no solution")
        return begun(made, *names)

    wanted = [("gravity_error",), ("viscous_drag",), ("constant_force",)]
    found = compare_candidates(wanted, begin, nominal, lambda stage, what="": said.append(what))
    assert [one.names for one in found] == [("constant_force",), ("gravity_error",)]
    assert said[:3] == ["gravity_error (1 of 3)", "viscous_drag (2 of 3)", "constant_force (3 of 3)"]
    assert said.count("constant_force") == 2, "is finished and replayed"
    assert "gravity_error" not in said[3:], "falls too far behind"
    lack = find_lack_of_fit(examined(made), nominal, random())
    assert ("constant_force",) in survivors(lack, QUICK)
    fits = Fitted(nominal, lack.fit, [found[0]])
    pair = fits.begin(("constant_force", "gravity_error"))
    assert pair.columns.tolist() == [0, 1, 2]
    assert float(pair.fit.loss.sum()) <= float(found[0].fit.loss.sum()) + 1
    assert {one.names for one in fits.without(pair)} == {("constant_force",), ("gravity_error",)}


def test_a_gap_is_material_where_held_out_flights_or_a_better_model_leave_more_than_the_tolerance() -> None:
    made = windy(sizes=(0.0, 3.0, 0.0, 0.0))
    fit = examined(made)
    nominal, best = hypothesis(made), hypothesis(made, ("constant_force",))
    allowed = tolerance_of(fit)
    assert allowed.position == pytest.approx(0.15 * 3**0.5 * NOISE[1])
    assert excess_left(fit, nominal).position > allowed.position
    assert is_material(fit, nominal, None)
    assert not is_material(fit, best, None)
    little: Any = SimpleNamespace(missing=0.01, frames=100.0)
    much: Any = SimpleNamespace(missing=20.0, frames=100.0)
    assert not is_material(fit, best, little)
    assert is_material(fit, best, much)


def test_replays_of_flights_scatter_no_estimate_and_none_are_made_without_an_event() -> None:
    made = windy()
    one = hypothesis(made, ("constant_force",))
    assert bootstrap_spread(one, random()).tolist() == [[0.0] * 3] * 3
    busy(made, [0])
    spread = bootstrap_spread(one, random())
    known = one.covariance()
    assert 0 < float(spread[1:, 1:].diagonal().max()) < 0.05 * float(known.diagonal()[1:].min())
    twice = replace(one, settings=QUICK.changed({"parametric_bootstrap.replays": 1}))
    (first,) = torch.linalg.eigvalsh(bootstrap_spread(twice, random()))[-1:]
    assert float(first) > 0
    none = replace(one, settings=QUICK.changed({"parametric_bootstrap.replays": 0}))
    assert not bootstrap_spread(none, random()).any()
    everywhere = refit_all_segments(examined(made), one)
    assert everywhere.names == one.names
    assert torch.allclose(everywhere.fit.point.effects, one.fit.point.effects, atol=0.05)
