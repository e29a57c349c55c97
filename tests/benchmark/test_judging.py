"""Both sides of every judgement, on verdicts made by hand."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from tests.diagnosis.documents import diagnosis

from physid.benchmark.labels import Label, Part
from physid.benchmark.scoring.baselines import bic, likelihood
from physid.benchmark.scoring.figures import Figure, figures, reliability
from physid.benchmark.scoring.intervals import bootstrap_calibration_error, bootstrap_median, half_power, wilson
from physid.benchmark.scoring.judging import Judged, bin_of, judge
from physid.benchmark.verdicts import Spent
from physid.diagnosis.document.document import Diagnosis, check_diagnosis

DRAG = Part("viscous_drag", "dynamics", {"coefficient": 0.2}, 2.0)
GAIN = Part("force_gain", "actuation", {"gain": 0.1}, 2.0)
YAW = Part("camera_yaw", "perception", {"angle": 0.1}, 2.0)
FREE = Label("free", "push", "rich")


def label(role: str = "catalogue", *parts: Part, right: tuple[tuple[str, ...], ...] | None = None) -> Label:
    """Return the truth about a set with drag, or other parts, hidden."""
    hidden = parts or (DRAG,)
    names = (tuple(part.name for part in hidden),) if right is None else right
    return Label(role, "push", "rich", hidden, names, 2.0, ("coast",), 1e-3, {"block.mass": 1.0})  # type: ignore[arg-type]


def said(verdict: str, *names: str, group: tuple[str, ...] = ()) -> Diagnosis:
    """Return a diagnosis that blames effects."""
    made = diagnosis(verdict)
    if names:
        made["effects"] = [{"name": name, "site": "dynamics", "parameters": {}} for name in names]
        made["group"] = [*names, *group]
    return check_diagnosis(made)


@pytest.mark.parametrize(
    ("truth", "verdict", "exact", "grouped"),
    [
        (label(), said("named", "viscous_drag"), True, True),
        (label(), said("named", "quadratic_drag"), False, False),
        (label(), said("group", "quadratic_drag", group=("viscous_drag",)), False, True),
        (label(), said("group", "quadratic_drag", group=("tether",)), False, False),
        (label(), said("group", "tether", group=("viscous_drag", *"abcdefgh")), False, False),
        (label(), said("partial", "viscous_drag"), True, True),
        (label(), said("none"), False, False),
        (label(), said("unknown"), False, False),
        (label(), said("named", "viscous_drag", "force_gain"), False, True),
        (FREE, said("none"), True, True),
        (FREE, said("unknown"), False, False),
        (FREE, said("named", "viscous_drag"), False, False),
        (label("outside", right=()), said("unknown"), True, True),
        (label("outside", right=()), said("none"), False, False),
        (label("outside", right=()), said("named", "viscous_drag"), False, False),
        (label("native", right=(("tether",), ("viscous_drag",))), said("named", "viscous_drag"), True, True),
        (label("native", right=(("tether",), ("viscous_drag",))), said("unknown"), False, False),
        (label("pair", DRAG, GAIN), said("named", "force_gain", "viscous_drag"), True, True),
        (label("pair", DRAG, GAIN), said("named", "force_gain"), False, False),
        (label("pair", DRAG, GAIN), said("group", "force_gain", "tether", group=("viscous_drag",)), False, True),
        (label("pair", DRAG, GAIN), said("group", "force_gain", group=("viscous_drag",)), False, False),
        (label("triple", DRAG, GAIN, YAW), said("named", "camera_yaw", "force_gain", "viscous_drag"), True, True),
        (label("triple", DRAG, GAIN, YAW), said("named", "camera_yaw", "viscous_drag"), False, False),
    ],
)
def test_a_verdict_is_right_exactly_or_within_its_group(
    truth: Label, verdict: Diagnosis, exact: bool, grouped: bool
) -> None:
    one = judge("000", verdict, truth)
    assert (one.exact, one.grouped) == (exact, grouped)
    assert one.flagged == (verdict.verdict != "none")


@pytest.mark.parametrize(
    ("verdict", "parts"),
    [
        (said("named", "camera_yaw", "viscous_drag"), 2),
        (said("group", "camera_yaw", "tether", group=("viscous_drag",)), 2),
        (said("named", "viscous_drag", "tether"), 1),
        (said("unknown"), 0),
    ],
)
def test_of_three_effects_those_count_that_are_blamed_or_in_the_group(verdict: Diagnosis, parts: int) -> None:
    assert judge("000", verdict, label("triple", DRAG, GAIN, YAW)).parts == parts


def test_site_and_phase_are_those_of_the_largest_share() -> None:
    document = diagnosis()
    document["where"]["phase"] = {"impact": 0.4, "coast": 0.6}
    one = judge("000", check_diagnosis(document), label())
    assert one.site is True
    assert one.phase is True
    document["where"]["site"] = {"perception": 0.0, "actuation": 0.9, "dynamics": 0.1, "contact": 0.0}
    document["where"]["phase"] = {"impact": 0.6, "coast": 0.4}
    other = judge("000", check_diagnosis(document), label())
    assert other.site is False
    assert other.phase is False
    document["where"]["site"] = dict.fromkeys(document["where"]["site"], 0.0)
    assert judge("000", check_diagnosis(document), label()).site is False, "no site is not the first of the list"
    assert judge("000", said("none"), label()).site is None
    assert judge("000", check_diagnosis(document), FREE).phase is None


def test_an_interval_covers_the_truth_or_does_not() -> None:
    document = diagnosis()  # 0.19 to 0.23 N s/m, 0.995 to 1.009 kg
    assert judge("000", check_diagnosis(document), label()).covered == ((True,), (True,))
    off = Part("viscous_drag", "dynamics", {"coefficient": 0.24}, 2.0)
    assert judge("000", check_diagnosis(document), label("catalogue", off)).covered[0] == (False,)
    assert judge("000", check_diagnosis(document), label("catalogue", GAIN)).covered == ((), ()), (
        "sizes of wrong effects are not asked"
    )


def test_a_truth_that_does_not_have_a_parameter_says_nothing_of_its_interval() -> None:
    other = Part("viscous_drag", "dynamics", {"strength": 0.2}, 2.0)
    assert judge("000", check_diagnosis(diagnosis()), label("catalogue", other)).covered == ((), (True,))


def test_what_closes_is_relative_to_the_noise_that_the_true_effect_leaves() -> None:
    document = diagnosis()
    floor = 3**0.5 * 1e-3
    document["gap"]["same"] = {"before": 0.02, "after": floor}
    document["gap"]["transfer"] = {"before": 0.02, "after": 0.02}
    one = judge("000", check_diagnosis(document), label())
    assert one.same == pytest.approx(1)
    assert one.transfer == pytest.approx(0)
    document["gap"]["same"] = {"before": 1.01 * floor, "after": floor}
    document["gap"]["transfer"] = document["shrink"]["transfer"] = None
    near = judge("000", check_diagnosis(document), label())
    assert near.same is None
    assert near.transfer is None
    document["gap"]["same"] = {"before": 0.02, "after": None}
    assert judge("000", check_diagnosis(document), label()).same == 0, "a gap that is not explained does not close"


def test_severities_have_names() -> None:
    assert [bin_of(severity) for severity in (0.05, 0.1, 0.5, 1.0)] == ["faint", "weak", "medium", "strong"]


@pytest.mark.parametrize(
    ("right", "count", "low", "high"), [(0, 10, 0.0, 0.2775), (5, 10, 0.2366, 0.7634), (8, 10, 0.4902, 0.9433)]
)
def test_the_interval_of_wilson_is_the_published_one(right: int, count: int, low: float, high: float) -> None:
    assert wilson(right, count) == pytest.approx((low, high), abs=1e-4)


def test_the_interval_of_wilson_is_symmetric_and_knows_nothing_without_trials() -> None:
    low, high = wilson(3, 20)
    assert wilson(17, 20) == pytest.approx((1 - high, 1 - low))
    assert wilson(0, 0) == (0, 1)


def test_half_of_all_effects_are_seen_where_the_curve_passes_one_half() -> None:
    severities = [0.1, 0.2, 0.4, 0.5, 2.0, 2.5, 5.0, 10.0]
    seen = [severity > 1 for severity in severities]
    assert half_power(severities, seen) == pytest.approx(1.0, rel=1e-6), "symmetric about 1 on a logarithmic axis"
    assert half_power([0.0, *severities], [False, *seen]) == half_power(severities, seen), "zero has no logarithm"
    assert half_power(severities, [True] * 8) is None
    assert half_power(severities, [not one for one in seen]) is None


def test_figures_count_what_they_say() -> None:
    known = [judge("0", said("named", "viscous_drag"), label())] * 3 + [judge("1", said("none"), label())]
    free = [judge("2", said("none"), FREE)] * 9 + [judge("3", said("unknown"), FREE)]
    outside = [
        judge("4", said("unknown"), label("outside", right=())),
        Judged("5", label("outside", right=()), "failed"),
    ]
    value = {figure.name: figure for figure in figures([*known, *free, *outside])}

    def percent(name: str) -> tuple[float | None, int]:
        found: Figure = value[name]
        return found.value, found.count

    assert percent("false alarms on effect-free sets") == (10, 10)
    assert percent("group accuracy, medium and up") == (75, 4)
    assert percent("exact accuracy, medium and up") == (75, 4)
    assert percent("recall of unknown, strong") == (50, 2)
    assert percent("both parts of a pair") == (None, 0)
    assert percent("diagnoses that failed") == (pytest.approx(100 / 16), 16)
    assert value["false alarms on effect-free sets"].low == pytest.approx(100 * wilson(1, 10)[0])


def test_confidence_is_calibrated_if_it_is_the_share_of_right_verdicts() -> None:
    def set_of(confidence: float, right: int, wrong: int) -> list[Judged]:
        hit, miss = said("named", "viscous_drag"), said("named", "tether")
        hit, miss = (dataclasses.replace(one, confidence=confidence) for one in (hit, miss))
        return [judge("0", hit, label())] * right + [judge("1", miss, label())] * wrong

    def error(judged: list[Judged]) -> float | None:
        return next(one.value for one in figures(judged) if one.name == "calibration error of confidence")

    assert error(set_of(0.9, 9, 1) + set_of(0.5, 5, 5)) == pytest.approx(0, abs=1e-9)
    assert error(set_of(0.9, 5, 5)) == pytest.approx(40)
    assert len(reliability(set_of(0.9, 2, 1))) == 3


def test_every_figure_but_the_longest_time_has_an_interval() -> None:
    seconds = Spent(3.0, 2.0)
    pair, triple = label("pair", DRAG, GAIN), label("triple", DRAG, GAIN, YAW)
    judged = [
        *(judge("0", said("none"), FREE, seconds), judge("1", said("unknown"), FREE, seconds)),
        *(judge("2", check_diagnosis(diagnosis()), label(), seconds), judge("3", said("none"), label(), seconds)),
        judge("4", said("unknown"), label("outside", right=()), seconds),
        judge("5", said("named", "force_gain", "viscous_drag"), pair, seconds),
        judge("6", said("named", "force_gain", "viscous_drag"), triple, seconds),
    ]
    for figure in figures(judged):
        # All have the same severity here: no curve can be laid through them.
        if figure.name not in ("most work for a diagnosis", "severity at 50 % power"):
            assert figure.low is not None, figure.name
            assert figure.high is not None, figure.name


def test_the_interval_of_the_calibration_error_holds_it_and_shrinks_with_more_sets() -> None:
    def interval(count: int) -> tuple[float, float]:
        return bootstrap_calibration_error(np.full(4 * count, 0.9), np.tile([1.0, 1.0, 1.0, 0.0], count))

    (low, high), (least, most) = interval(10), interval(100)
    assert low <= least < 0.15 < most <= high  # 0.9 said, 0.75 right
    assert most - least < (high - low) / 2


def test_baselines_take_the_best_of_the_ranking_if_it_gains_enough() -> None:
    document = diagnosis()
    document["ranking"] = [{"effects": ["viscous_drag"], "score": 11.0, "p_value": 0.5}]
    assert likelihood(check_diagnosis(document)).named == "viscous_drag"
    assert bic(check_diagnosis(document), numbers=10**3).named == "viscous_drag"  # ln 1000 = 6.9
    assert not bic(check_diagnosis(document), numbers=10**5).flagged  # ln 1e5 = 11.5
    document["ranking"][0]["score"] = 9.0
    assert not likelihood(check_diagnosis(document)).flagged
    document["ranking"] = []
    assert not likelihood(check_diagnosis(document)).flagged


@pytest.mark.parametrize(("right", "count"), [(0, 1), (1, 1), (3, 7), (29, 30), (150, 150)])
def test_the_interval_of_a_share_is_wilsons_formula(right: int, count: int) -> None:
    z, p = 1.959963984540054, right / count
    middle, reach = p + z**2 / (2 * count), z * (p * (1 - p) / count + z**2 / (4 * count**2)) ** 0.5
    expected = np.clip(np.array([middle - reach, middle + reach]) / (1 + z**2 / count), 0, 1)
    assert wilson(right, count) == pytest.approx(expected, abs=1e-12)


def test_bootstrap_intervals_are_quantiles_over_sets_drawn_with_replacement() -> None:
    data = np.random.default_rng(5).gamma(2, size=12)
    draws = data[np.random.default_rng(0).integers(12, size=(200, 12))]
    expected = np.quantile(np.median(draws, 1), [0.025, 0.975])
    assert bootstrap_median(data.tolist()) == pytest.approx(expected, abs=1e-12)


def test_half_power_is_where_the_penalised_likelihood_is_largest() -> None:
    generator = np.random.default_rng(2)
    severity = generator.gamma(1, size=40) + 0.01
    seen = severity + generator.normal(0, 0.3, 40) > 0.7
    x = (np.log(severity) - np.log(severity).mean()) / np.log(severity).std()

    def loss(weights: np.ndarray) -> float:  # type: ignore[type-arg]
        at = weights[0] + weights[1] * x
        return float(np.logaddexp(0, at).sum() - at[seen].sum() + 0.05 / 2 * weights @ weights)

    grid = np.stack(np.meshgrid(np.linspace(-3, 3, 241), np.linspace(0, 6, 241)), -1).reshape(-1, 2)
    best = min(grid, key=loss)
    expected = np.exp(np.log(severity).mean() - np.log(severity).std() * best[0] / best[1])
    assert half_power(severity.tolist(), seen.tolist()) == pytest.approx(expected, rel=0.02)
