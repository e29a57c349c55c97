"""What is concluded, from findings that are made by hand: places, sizes that show, shares that close, causes."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from scipy.stats import chi2, norm

from physid.diagnosis.conclusion.decomposition import decompose
from physid.diagnosis.conclusion.gap import POSITION, Closing, Interval, closing, floor_of, values_of
from physid.diagnosis.conclusion.localisation import over_time, places, sites
from physid.diagnosis.conclusion.power import detectable_factors, detectable_sizes
from physid.diagnosis.conclusion.verdict import in_all_frames, judge
from physid.diagnosis.document.document import SITES
from physid.diagnosis.document.evidence import Evidence
from physid.diagnosis.posterior.evidence import _behind
from physid.diagnosis.posterior.posterior import Coefficients, Posterior, causes, confidence, features, softmax
from physid.diagnosis.settings.conclusion import GapSettings, VerdictSettings
from physid.diagnosis.settings.settings import Settings
from physid.diagnosis.testing.null_tails import Tail
from physid.effects import CATALOGUE
from physid.estimation.measurement import Noise

SETTINGS = Settings()
ONE = torch.ones((), dtype=torch.float64)


def cells(*gains: float, excess: float = 100.0) -> Any:
    """Return a lack of fit with a cell in a phase for each gain, of one counted segment beside one that is not."""
    listed = [SimpleNamespace(phase="coast", body=k % 2, dof="xyz"[k % 3], piece=None) for k in range(len(gains))]
    listed.append(SimpleNamespace(phase=None, body=0, dof="x", piece=0))
    gain = torch.tensor([*gains, 50.0], dtype=torch.float64)
    both = torch.stack([gain, torch.full_like(gain, 1e6)], 1)
    return SimpleNamespace(cells=listed, cell_gain=both, counted=torch.tensor([True, False]), excess=excess)


def test_a_place_stands_out_by_the_root_of_its_gain_and_explains_its_share_of_the_gap_but_no_more_than_all() -> None:
    found = places(cells(25.0, 400.0, 1e-9, -4.0), ["block", "wall"], 1e-6)
    assert [(one.body, one.dof) for one in found] == [("wall", "y"), ("block", "x"), ("block", "z"), ("wall", "x")]
    assert [one.evidence for one in found] == pytest.approx([20.0, 5.0, 0.0, 0.0])
    assert [one.share for one in found] == pytest.approx([1.0, 0.25, 0.0, 0.0])
    assert {one.phase for one in found} == {"coast"}
    assert [one.share for one in places(cells(25.0, excess=-3.0), ["block", "wall"], 1e-6)] == [1.0]


def test_a_table_over_time_has_a_column_for_each_piece_and_axes_in_their_order() -> None:
    listed = [SimpleNamespace(phase=None, body=0, dof=dof, piece=k) for k in (0, 1, 2) for dof in ("rz", "y", "x")]
    gain = torch.tensor([[float(k * k), 9.0] for k in range(9)], dtype=torch.float64)
    lack: Any = SimpleNamespace(cells=listed, cell_gain=gain, counted=torch.tensor([True, False]))
    table, dofs = over_time(lack, 0, 1e-6)
    assert dofs == ["x", "y", "rz"]
    assert table.tolist() == [[2.0, 5.0, 8.0], [1.0, 4.0, 7.0], [0.0, 3.0, 6.0]]


def test_sites_share_by_how_far_their_best_law_falls_behind_and_sum_to_one() -> None:
    found: Any = SimpleNamespace(nominal=SimpleNamespace(settings=SETTINGS))
    shares = sites(found, False, {"dynamics": 1000.0, "contact": 1000.0, "actuation": 800.0})
    ratio = math.exp(-200 / (2 * 0.1 * 1000))
    assert shares == pytest.approx(
        dict.fromkeys(SITES, 0.0)
        | {"dynamics": 1 / (2 + ratio), "contact": 1 / (2 + ratio), "actuation": ratio / (2 + ratio)},
        abs=1e-4,
    )
    assert list(shares.values()) == [round(value, 4) for value in shares.values()], "as many digits as are reported"
    little = sites(found, False, {"dynamics": 4.0, "contact": 0.0})
    assert little["contact"] / little["dynamics"] == pytest.approx(math.exp(-4 / (2 * 2.0)), rel=1e-3)
    assert sum(sites(found, False, {}).values()) == 0


def shown(signal: float, tail: Tail, **changes: float) -> Any:
    """Return the size of a drag that would have been found; a null of 100 simulations that deviate by 0 to 3."""
    row = SimpleNamespace(names=("drag",), signal=torch.tensor([signal, 4 * signal]), steady_tail=tail)
    frames = changes.get("frames", 1e-9)
    lack: Any = SimpleNamespace(null_steady=torch.linspace(0, 3, 101).double(), frames=frames, rows=[row])
    drag = SimpleNamespace(name="drag")
    wind = {"typical": 0.5, "largest": 9.0, "unit": "N"}
    terms: Any = [
        SimpleNamespace(effect=drag, name=name, quantity=SimpleNamespace(**own))
        for name, own in (("x", wind | {"null": 0.0}), ("y", wind | {"null": 1.5}))
    ]
    noise, tolerance = SimpleNamespace(position=1e-3), SimpleNamespace(position=2e-3)
    return detectable_sizes(lack, terms, noise, tolerance, SETTINGS)  # type: ignore[arg-type]


def test_a_size_is_found_beyond_the_margin_over_chance_or_the_tolerance_whichever_is_more() -> None:
    tail = Tail(2 * ONE, 16 * ONE)
    rare = 3 * (1 - SETTINGS.evidence.alpha / 2)
    by_chance = 1.25 * float(tail.gain(rare))
    reach = norm.ppf(0.95) * (16 / 4) ** 0.5
    x, y = shown(400.0, tail)
    assert x.size == pytest.approx(0.5 * (by_chance**0.5 + reach) / 20)
    assert y.size == pytest.approx(1.0 * (by_chance**0.5 + reach) / 40), "sizes count from no effect"
    assert (x.effect, x.parameter, x.unit, x.typical, y.typical) == ("drag", "x", "N", 0.5, 1.0)
    material, _ = shown(400.0, tail, frames=1000.0)
    assert material.size == pytest.approx(0.5 * (4000**0.5 + reach) / 20)
    edge = (0.5 * (by_chance**0.5 + reach) / 9.0) ** 2
    assert [one.size is None for one in shown(0.99 * edge, tail)] == [True, True]
    assert [one.size is None for one in shown(1.01 * edge, tail)] == [False, False]
    assert [one.size is None for one in shown(0.0, tail)] == [True, True]


@pytest.mark.parametrize("probability", [0.2, 0.5, 0.9])
def test_the_less_sure_one_must_be_the_smaller_the_size_that_is_found(probability: float) -> None:
    tail, signal = Tail(ONE, 2 * ONE), torch.tensor([1.0, 0.0]).double()
    found = detectable_factors(signal, 16.0, tail, probability)
    assert found.tolist() == pytest.approx([4 + norm.ppf(probability), math.inf])
    wide = detectable_factors(signal, 16.0, Tail(ONE, 32 * ONE), probability)
    assert float(wide[0]) == pytest.approx(4 + 4 * norm.ppf(probability))


def closed(before: list[float], after: list[float], floor: float = 1.0, **changes: Any) -> Closing:
    old, new = (torch.tensor(each, dtype=torch.float64).square() for each in (before, after))
    rows = torch.ones(len(before), dtype=torch.bool)
    settings = GapSettings(**changes)
    floors, values = torch.full_like(old, floor**2), torch.full_like(old, 30)
    made = closing(old, new, floors, values, rows, settings, torch.Generator().manual_seed(0))
    assert made is not None
    return made


def test_a_gap_closes_by_the_share_of_its_error_beyond_the_floor() -> None:
    found = closed([5.0, 5.0, 5.0], [2.0, 2.0, 2.0])
    assert found.shrink == Interval(pytest.approx(0.75), pytest.approx(0.75), pytest.approx(0.75))  # type: ignore[arg-type]
    assert (found.before, found.after, found.floor, found.values) == pytest.approx((5.0, 2.0, 1.0, 90))
    assert found.excess == pytest.approx(24**0.5)
    assert Closing(0.5, None, None, 1.0, 3).excess == 0
    assert closed([1.021] * 3, [1.0] * 3).shrink is not None
    assert closed([1.019] * 3, [1.0] * 3).shrink is None
    assert closed([1.02] * 3, [1.0] * 3, no_gap=1.02).shrink is None
    nothing = torch.zeros(3, dtype=torch.bool)
    zeros = torch.zeros(3).double()
    assert closing(zeros, zeros, zeros, zeros, nothing, GapSettings(), torch.Generator()) is None


def test_the_interval_of_a_share_is_that_of_means_over_drawn_trajectories() -> None:
    before, after = [4.0, 5.0, 6.0, 9.0, 3.0], [1.5, 2.0, 1.0, 4.0, 1.2]
    found = closed(before, after, bootstraps=4000)
    draws = np.random.default_rng(0).integers(5, size=(4000, 5))
    old, new = (np.sqrt(np.square(each)[draws].mean(1)) for each in (np.array(before), np.array(after)))
    low, high = np.quantile((old - new) / (old - 1.0), [0.05, 0.95])
    assert found.shrink is not None
    assert (found.shrink.low, found.shrink.high) == (pytest.approx(low, abs=0.02), pytest.approx(high, abs=0.02))
    whole = (np.sqrt(np.square(before).mean()), np.sqrt(np.square(after).mean()))
    assert found.shrink.value == pytest.approx((whole[0] - whole[1]) / (whole[0] - 1))


def test_a_drawn_set_that_hardly_leaves_the_floor_divides_by_a_share_of_it() -> None:
    found = closed([1.0, 1.0, 1.0, 5.0], [0.5] * 4, least=0.2, interval=(0.0, 1.0))
    assert found.shrink is not None
    assert found.shrink.high == pytest.approx((1 - 0.5) / 0.2)


def test_a_ceiling_is_a_quantile_of_chi_squared_and_a_floor_that_of_its_kind() -> None:
    one = Closing(9.0, 9.0, None, 2.0, 50)
    assert one.ceiling(0.02) == pytest.approx(2 * (chi2.isf(0.02, 50) / 50) ** 0.5)
    assert Closing(9.0, 9.0, None, 2.0, 0).ceiling(0.02) == 2.0
    noise = Noise(rotation=0.01, position=0.002)
    assert (floor_of(noise), floor_of(noise, 0)) == pytest.approx((3**0.5 * 0.002, 3**0.5 * 0.01))
    scale = torch.ones(2, 5, 2, 6)
    scale[0, 1:, 0] = 0.0
    assert values_of(SimpleNamespace(scale=scale), POSITION).tolist() == [18, 30]  # type: ignore[arg-type]


def judged(value: float, after: float = 5.0, missing: float = 30.0, p_value: float = 0.001) -> str:
    """Judge what leaves a tenth of the gap, where another protocol closes by a share (its interval ends there)."""
    before = SimpleNamespace(held_out=torch.tensor([300.0]), settings=SETTINGS,
                             experiment=SimpleNamespace(fitted=torch.tensor([True])))  # fmt: skip
    best = SimpleNamespace(held_out=torch.tensor([0.0]), names=("drag",))
    lack, left = SimpleNamespace(excess=0.0), SimpleNamespace(p_value=p_value, missing=missing)
    found: Any = SimpleNamespace(nominal=before, best=best, lack=lack, left=left, group=[best], alike=())
    other = Closing(9.0, after, Interval(value, value, value), 1.0, 9000)
    return judge(found, other, before=True, after=True)


def test_shares_at_the_very_limit_are_on_the_side_of_the_verdict_that_says_more() -> None:
    settings = VerdictSettings()
    assert judged(1 - settings.partly) == "partial"
    assert judged(1 - settings.partly - 1e-6) == "unknown"
    assert judged(0.9, missing=300 * settings.partly) == "partial"
    assert judged(0.9, missing=300 * settings.partly + 1e-3) == "unknown"
    assert judged(0.51, p_value=1.0) == "named"
    assert judged(settings.carries, p_value=1.0) == "unknown"
    assert judged(-5.0, after=1.04, p_value=1.0) == "named", "nearly at the floor"
    edge = [Closing(9.0, 5.0, Interval(1 - settings.partly, None, None), 1.0, 9000)]
    assert in_all_frames("named", edge, settings) == "named"
    assert in_all_frames("partial", [None], settings) == "unknown"


def test_where_a_choice_of_effects_has_no_gap_to_close_it_closes_none(monkeypatch: pytest.MonkeyPatch) -> None:
    shares = {"a": 0.4, "b": None}

    def closings(_fit: Any, _nominal: Any, one: Any, _random: Any, _kind: int) -> Any:
        value = shares[one.names[0]]
        return {
            "same": Closing(2.0, 1.0, None if value is None else Interval(value, None, None), 0.5, 90),
            "transfer": None,
        }

    monkeypatch.setattr("physid.diagnosis.conclusion.decomposition.closings_of", closings)
    found: Any = SimpleNamespace(best=SimpleNamespace(names=("a", "b")), contact_free=False, whole_nominal=None,
                                 tried=[SimpleNamespace(names=("a",)), SimpleNamespace(names=("b",))],
                                 nominal=SimpleNamespace(experiment=None))  # fmt: skip
    whole: Any = {"same": Closing(2.0, 1.0, Interval(0.9, None, None), 0.5, 90), "transfer": None}
    fit: Any = SimpleNamespace(settings=None)
    parts = decompose(fit, found, whole, {"same": POSITION, "transfer": POSITION}, torch.Generator())
    assert parts == {"same": pytest.approx({"a": 0.65, "b": 0.25})}
    empty: Any = SimpleNamespace(best=None)
    assert decompose(fit, empty, whole, {}, torch.Generator()) == {}


def test_a_softmax_is_a_distribution_that_does_not_mind_a_constant_however_large() -> None:
    utility = np.array([[1.0, 2.0, 4.0], [1000.0, 1001.0, 1003.0]])
    found = softmax(utility)
    assert found == pytest.approx(np.tile(np.exp([1, 2, 4]) / np.exp([1, 2, 4]).sum(), (2, 1)))
    assert softmax(-1e4 * np.ones(4)) == pytest.approx(np.full(4, 0.25))


def test_each_cause_has_the_features_of_what_is_said_and_of_how_far_it_falls_behind() -> None:
    evidence = Evidence(said=("a", "a + b"), behind={"a": 0.5, "a + b": 1.5, "c": 2.0}, gap=3.0, bend=1.0, poses=100)
    assert causes(evidence) == ["none", "unknown", "other", "a", "a + b", "c"]
    size, bent, few = math.log(4), math.log(2), -1.0
    expected = np.array([
        [1, 0, 0, 0, 0, 0, 0, 0, -size, 0, 0],
        [0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0],
        [0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0],
        [0, 0, 0, 0, 0, 0, 1, 0.5, size, bent, few],
        [0, 0, 0, 1, 0, 0, 1, 1.5, size, bent, few],
        [0, 0, 0, 0, 0, 0, 0, 2.0, 0, 0, 0],
    ])  # fmt: skip
    assert features(evidence) == pytest.approx(expected)
    for place, kind in enumerate(("none", "unknown")):
        said = features(Evidence(said=(kind,), behind={"a": 0.0}, gap=3.0, bend=1.0, poses=100))
        row = [1.0 - place, place, 0, 0, 1.0 - place, place, 0, 0, size if place else -size, bent, few]
        assert said[place] == pytest.approx(row)
        assert said[:, 6].tolist() == [0] * 4
    flat = Posterior(Coefficients(*[0.0] * 11), 0.3, 1).probabilities(evidence)
    assert list(flat.values()) == pytest.approx([1 / 6] * 6)
    assert confidence(evidence, flat) == pytest.approx(1 / 3)
    sure = Posterior(Coefficients(99.0, *[0.0] * 10), 0.3, 1).probabilities(evidence)
    assert next(iter(sure.items())) == ("none", pytest.approx(0.7 + 0.05))


def test_hypotheses_fall_behind_the_best_by_the_logarithm_of_ties() -> None:
    row = SimpleNamespace
    ranking = [row(effects=("a",), score=1e5), row(effects=("b",), score=9e4), row(effects=("c",), score=-5.0)]
    tie = max(SETTINGS.evidence.least, SETTINGS.evidence.same * 1e5)
    document: Any = row(ranking=ranking)
    expected = {"a": 0.0, "d": 0.0, "b": math.log1p(1e4 / tie), "c": math.log1p(1e5 / tie)}
    assert _behind(document, ["a", "d"], SETTINGS) == pytest.approx(expected)
    one = SETTINGS.changed({"posterior.listed": 1})
    assert list(_behind(document, ["d"], one)) == ["d", "a"]
    assert _behind(row(ranking=[]), ["a"], SETTINGS) == {"a": 0.0}  # type: ignore[arg-type]
    assert len(CATALOGUE) > SETTINGS.posterior.listed
