"""Examinations of free flights: what is missing is a force that is known, and null simulations are noise alone."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
import torch

from diagnosis.flown import QUICK, busy, examined, hypothesis, random
from estimation.flights import FORCE, NOISE, Flights, flights
from physid.diagnosis.settings.testing import ResidualWrenchSettings
from physid.diagnosis.testing import find_lack_of_fit
from physid.diagnosis.testing.equivalence import alike, twins
from physid.diagnosis.testing.null_distribution import score_test_of
from physid.diagnosis.testing.residual_wrench import freed, local_gain, residual_wrenches
from physid.effects import find
from physid.estimation.least_squares.settings import LeastSquaresSettings, PriorSettings
from physid.estimation.measurement import Noise
from physid.estimation.prediction import Segmentation, Variants
from physid.estimation.segmented_fit import PHASES

KINDS = ("constant_force", "gravity_error", "ground_tilt")
SIZES = (*FORCE, 0.0, 0.0, 0.0)


def windy(**changes: Any) -> Flights:
    return flights(kinds=KINDS, sizes=SIZES, **changes)


def test_an_effect_gains_what_its_fit_explains_and_others_what_they_share_with_it() -> None:
    made = windy()
    nominal, best = hypothesis(made), hypothesis(made, ("constant_force",))
    lack = find_lack_of_fit(examined(made), nominal, random())
    gains = {row.names[0]: row.gain for row in lack.rows}
    explained = float((nominal.fit.loss - best.fit.loss).sum())
    assert gains["constant_force"] == pytest.approx(explained, rel=0.02)
    assert gains["ground_tilt"] == pytest.approx(explained, rel=0.02), "a tilted gravity pulls as a wind does"
    assert gains["gravity_error"] < 10
    assert [row.gain for row in lack.rows] == sorted(gains.values(), reverse=True)
    assert {row.names[0] for row in lack.significant} == {"constant_force", "ground_tilt"}
    assert lack.p_value < 0.02
    assert lack.frames == 96
    assert all(row.steady == row.gain for row in lack.rows), "without an impact all is steady"
    for row in lack.rows:
        assert row.deviation() == float(row.steady_tail.deviation(row.steady))
        assert row.deviation(2.0) == float(row.steady_tail.deviation(row.steady / 2))
    change = next(row.change for row in lack.rows if row.names[0] == "constant_force")
    assert change.tolist() == pytest.approx(best.fit.point.effects[0, :2].tolist(), rel=0.02)
    after = find_lack_of_fit(examined(made), best, random())
    assert after.p_value > 0.1
    assert {row.names[0] for row in after.rows} == {"gravity_error", "ground_tilt"}
    assert max(row.gain for row in after.rows) < 15


def test_a_fit_follows_residuals_as_far_as_what_is_known_beforehand_lets_it() -> None:
    """(I + P) x = I y, where y is how far it goes if nothing is known, and P = 1 / spread^2."""
    spread = 0.02  # in typical sizes
    strong = LeastSquaresSettings(prior=PriorSettings(effect=spread))
    loose, tied = (hypothesis(windy(settings=own), ("constant_force",)) for own in (None, strong))
    seen = torch.randn(*loose.experiment.pose.shape[:3], 6, generator=random(2)).double() * 1e-3
    free, held = (one.follow(seen)[-2:] for one in (loose, tied))
    information = loose.normal.of(loose.experiment.fitted).matrix.sum(0)[-2:, -2:]
    known = torch.eye(2).double() / (spread * find("constant_force").quantities()["x"].typical) ** 2
    assert torch.allclose((information + known) @ held, information @ free, rtol=1e-3)
    assert float((held / free).max()) < 0.9


def test_of_a_right_model_gains_are_chi_squares_and_nothing_is_missing() -> None:
    made = flights(kinds=KINDS, sizes=(0.0,) * 5, trajectories=5)
    lack = find_lack_of_fit(examined(made), hypothesis(made), random())
    for row in lack.rows:
        degrees = len(row.change)
        assert float(row.tail.mean) == pytest.approx(degrees, rel=0.35)
        assert row.p_value > 0.02
    assert lack.p_value > 0.02
    assert lack.null_best.shape == lack.null_steady.shape == (150,)
    # What effects reach together by chance grows with their parameters; a chance of all is that of the least gain.
    one, two, all_of_them = ("gravity_error",), ("constant_force",), ("constant_force", "gravity_error")
    reached = [lack.reach(names) for names in (one, two, all_of_them)]
    assert reached == sorted(reached)
    assert reached[0] < reached[-1] - 1
    assert lack.chance(one, reached[0]) <= 3 / 151
    assert lack.chance(one, reached[-1]) <= lack.chance(all_of_them, reached[-1])
    # A free wrench in two pieces of six components, beside priors that hardly matter: so many degrees of freedom.
    assert sum(cell.piece is not None for cell in lack.cells) == 12
    assert float(lack.null_free.mean()) == pytest.approx(12, rel=0.05)
    assert float(lack.null_free.mean()) == pytest.approx(float(lack.free.mean()), rel=0.35)
    # What is nothing but noise has no gain in any cell, on average.
    assert abs(float(lack.cell_gain.mean())) < 0.5


@pytest.mark.parametrize(("leaving", "components"), [((), 3), ((3,), 6), (range(8), 6)])
def test_a_free_wrench_leaves_the_plane_as_soon_as_one_segment_can(leaving: Any, components: int) -> None:
    made = windy()
    free = made.experiment.directions.free.clone()
    free[[k for k in range(8) if k not in leaving], :, 0] = False
    experiment = made.experiment.replace(directions=replace(made.experiment.directions, free=free))
    one = hypothesis(Flights(experiment, made.true, made.start))
    lack = find_lack_of_fit(examined(made), one, random())
    assert len({cell.dof for cell in lack.cells}) == components


def test_evidence_is_what_has_no_events_or_fits_badly_although_it_follows() -> None:
    for bad, sound in ((False, [False] * 2 + [True] * 6), (True, [True] + [False] + [True] * 6)):
        made = busy(flights(kinds=KINDS, sizes=(0.0,) * 5), [0, 1])
        follow = torch.ones(8, dtype=torch.bool)
        follow[1] = False
        fitted = torch.tensor([True, True, False, True])
        experiment = made.experiment.replace(follow=follow, fitted=fitted)
        wrong = made.start.replace(pose=made.start.pose.clone())
        wrong.pose[0, 0, 0, 0] += 0.02 if bad else 0.0
        one = hypothesis(Flights(experiment, made.true, made.start))
        one = replace(one, fit=experiment.linearise(one.fit.point.replace(pose=wrong.pose), one.fit.effects))
        found = find_lack_of_fit(examined(made), one, random())
        assert found.sound.tolist() == sound
        counted = [each and bool(fitted[k // 2]) for k, each in enumerate(sound)]
        assert found.counted.tolist() == counted
        assert found.frames == 12 * sum(counted)


def test_null_simulations_that_fit_badly_at_an_impact_count_as_little_there_as_recordings_do() -> None:
    made = busy(windy(), [2])
    one = hypothesis(made)
    test = score_test_of(one)
    bad = QUICK.null_distribution.bad
    assert test.impacts.tolist() == [False] * 2 + [True] + [False] * 5
    data = torch.randn(2, 4, 24, 1, 6, generator=random(1)).double() * Noise(*NOISE).spread()
    data[1] *= 5
    plain = one.fit.linear.respond_by_segment(data, made.experiment.scale)
    found = test.respond(SimpleNamespace(residual=data))  # type: ignore[arg-type]
    away = float(plain.square[2, 1]) / 72
    assert away > bad
    assert torch.allclose(found.square[2, 1], plain.square[2, 1] * bad / away)
    assert torch.allclose(found.square[:, 0], plain.square[:, 0])
    assert torch.allclose(found.square[3:, 1], plain.square[3:, 1]), "flights count whole"
    full = test.fit.linear.respond_by_segment(data, made.experiment.scale)
    assert torch.allclose(found.vector[2, :, 1], full.vector[2, :, 1] * bad / away)
    clean = test.cleaned(SimpleNamespace(residual=data), found)  # type: ignore[arg-type]
    assert torch.allclose(clean, data, atol=1e-9), "there are no unknown parameters to fit"


def looked_at(made: Flights, names: tuple[str, ...]) -> tuple[Any, Any]:
    """Return a lack of fit and the best hypothesis for a look at twins."""
    nominal, best = hypothesis(made), hypothesis(made, names)
    test = score_test_of(nominal)
    return SimpleNamespace(fit=test.fit, groups=test.groups), best


def test_a_wind_and_a_tilted_ground_are_twins_in_flight_unless_fits_have_told_them_apart() -> None:
    lack, best = looked_at(windy(), ("constant_force",))
    assert twins(lack, best) == [("constant_force", "ground_tilt")]
    assert alike(lack, best) == ("ground_tilt",)

    def other(name: str, worse: float) -> Any:
        return SimpleNamespace(names=(name,), fit=SimpleNamespace(loss=best.fit.loss + worse / len(best.fit.loss)))

    least = QUICK.evidence.least
    assert twins(lack, best, [other("ground_tilt", 1.1 * least)]) == []
    assert twins(lack, best, [other("ground_tilt", 0.9 * least)]) == [("constant_force", "ground_tilt")]
    assert twins(lack, best, [other("gravity_error", 1.1 * least)]) == [("constant_force", "ground_tilt")]
    both = hypothesis(windy(), ("constant_force", "gravity_error"))
    assert twins(lack, both) == [("constant_force", "ground_tilt")]
    pair = SimpleNamespace(names=("ground_tilt", "gravity_error"), fit=other("", 1.1 * least).fit)
    assert twins(lack, both, [pair]) == []


@pytest.mark.parametrize(("which", "judged"), [([0, 1, 2], True), ([0, 1, 2, 3, 4, 5, 6], False)])
def test_signatures_are_compared_where_most_of_them_is_without_events(which: list[int], judged: bool) -> None:
    lack, best = looked_at(busy(windy(), which), ("constant_force",))
    assert bool(twins(lack, best)) is judged


def test_a_freed_wrench_leaves_what_no_force_and_no_state_explain_and_nothing_outside_of_segments() -> None:
    weak = LeastSquaresSettings(prior=PriorSettings(state=(1e3, 1e3, 1e3, 1e3)))
    made = windy(trajectories=2, settings=weak)
    chosen = torch.tensor([1, 2])
    whole = made.experiment.predictor.predict(made.true)
    experiment = made.experiment.only(chosen, whole.state[0])
    segments = experiment.predictor.segments
    phases = torch.full((2, 24, 1), PHASES.index("free_fall"))
    settings = ResidualWrenchSettings(piece_time=0.1)
    cells, push = residual_wrenches(phases, experiment.directions.frame, False, segments, 1 / 60, settings)
    own: Variants = made.start.replace(pose=made.start.pose[:, chosen], twist=made.start.twist[:, chosen])
    fit = experiment.linearise(own, torch.zeros(0, dtype=torch.int64), push)
    columns = 1 + torch.arange(len(cells))
    left = freed(fit, columns, 1e3)
    inside = segments.spread(torch.ones(2, dtype=torch.bool))
    assert not left[~inside].any()
    (part,) = fit.linear.parts
    held, clean = freed(fit, columns, 1e-12), part.profiled(part.residual[..., None])[..., 0]
    found = part.batch.columns(torch.stack([left, held]))
    assert torch.allclose(found[..., 1], clean, atol=1e-6), "without a force what initial states leave"
    free = part.profiled(part.shared[..., columns])
    across = (free.mT @ found[..., :1])[..., 0] / free.norm(dim=1).clamp_min(1e-9)
    assert float(across.abs().max()) < 1e-2, "no force explains more"
    states = experiment.losses_of(fit.jacobian.base, own)[0]
    for part in fit.linear.parts:
        clean = part.profiled(part.residual[..., None]).square().sum((1, 2))
        gained = local_gain(fit.linear, columns, 1e3)[part.batch.segments, 0]
        kept = torch.stack([left[int(segments.trajectory[k])][inside[int(segments.trajectory[k])]].square().sum()
                            for k in part.batch.segments.tolist()])  # fmt: skip
        assert torch.allclose(clean - gained, kept, rtol=1e-2)
        assert bool((clean <= states[part.batch.segments]).all())


@pytest.mark.parametrize(("frames", "listed"), [(1, True), (0, False)])
def test_phases_have_cells_of_their_own_from_a_share_of_the_frames_on(frames: int, listed: bool) -> None:
    segments = Segmentation.equal(1, 50, 50)
    phases = torch.full((1, 50, 2), PHASES.index("coast"))
    phases[0, : frames + 1, 1] = PHASES.index("impact")
    settings = ResidualWrenchSettings(seldom=0.03)
    cells, wrench = residual_wrenches(phases, torch.eye(3).double(), True, segments, 0.04, settings)
    impacts = [k for k, cell in enumerate(cells) if cell.phase == "impact"]
    assert bool(impacts) is listed
    assert all(cells[k].body == 1 for k in impacts)
    for k in impacts:
        assert (wrench[k] != 0).any(-1).nonzero().tolist() == [[0, 0, 1], [0, 1, 1]]
    assert sum(cell.piece is not None for cell in cells) == 2 * 3 * 13, "of four frames each"


def test_null_simulations_are_cleaned_of_what_another_mass_would_make_as_the_fitted_flights_see_it() -> None:
    held = torch.tensor([True, False, True, True])
    made = flights(unknown=("block.mass",), sizes=(4.0, 0.0), noise=(0.0, 0.0), fitted=held, cuts=1)
    one = hypothesis(Flights(made.experiment, made.true, made.true))
    test = score_test_of(one)
    column = test.fit.jacobian.shared[0]
    only = column.clone()
    only[1] *= -30.0  # nothing is fitted to that one
    data = torch.stack([0.02 * column, 0.05 * only])
    response = test.respond(SimpleNamespace(residual=data))  # type: ignore[arg-type]
    clean = test.cleaned(SimpleNamespace(residual=data), response)  # type: ignore[arg-type]
    known = float(test.fit.normal().matrix[held][:, 0, 0].sum())
    kept = (1 / 9) / (known + 1 / 9)  # by the prior, of a factor of e^3
    assert known > 50
    assert torch.allclose(clean[0], kept * data[0], atol=1e-9)
    assert torch.allclose(clean[1][held], kept * data[1][held], atol=1e-9)
    assert torch.allclose(clean[1, 1], 0.05 * (-30.0 - (1 - kept)) * column[1], atol=1e-9)
