"""What is concluded from a search: both sides of every judgement, on made-up findings."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import pytest
import torch

from physid.diagnosis.conclusion.gap import POSITION, ROTATION, Closing, Interval, clearer
from physid.diagnosis.conclusion.verdict import in_all_frames, indistinguishable_from_zero, judge, reconsider
from physid.diagnosis.selection import evidence
from physid.diagnosis.selection.evidence import all_needed, clearly_preferred, complete, distinguishable, preferred
from physid.diagnosis.selection.materiality import Tolerance
from physid.diagnosis.selection.search import Attribution
from physid.diagnosis.settings.settings import Settings
from physid.diagnosis.testing.hypothesis import Hypothesis
from physid.diagnosis.testing.lack_of_fit import LackOfFit, Row
from physid.diagnosis.testing.null_tails import Tail
from physid.effects import CATALOGUE
from physid.estimation.prediction.effect_parameters import EffectParameter

FLOOR = 1e-3
SETTINGS = Settings()


def hypothesis(*held_out: float) -> Any:
    scale, every = torch.ones(len(held_out), 10, 1, 6), torch.ones(len(held_out), dtype=torch.bool)
    fitted = SimpleNamespace(fitted=every, scale=scale)
    held = torch.tensor(held_out, dtype=torch.float64)
    return SimpleNamespace(names=("viscous_drag",), held_out=held, experiment=fitted, settings=SETTINGS)


def left(excess: float, p_value: float) -> Any:
    return SimpleNamespace(excess=excess, missing=excess, p_value=p_value, p_free=p_value)


def found(open_share: float = 0.0, p_value: float = 1.0, alike: tuple[str, ...] = ()) -> Attribution:
    nominal, best = hypothesis(600, 600), hypothesis(100, 100)
    return Attribution(nominal, left(500.0, 0.001), [best], best, left(1000 * open_share, p_value), [best], alike)


def transfer(after: float, closed: float) -> Closing:
    return Closing(3 * FLOOR, after * FLOOR, Interval(closed, closed - 0.1, closed + 0.05), FLOOR, 90_000)


def judged(what: Attribution, closing: Closing | None) -> str:
    """Judge a gap that is material, and stays so where something is left."""
    return judge(what, closing, before=True, after=True)


def test_a_gap_within_the_tolerance_is_none_whatever_is_significant() -> None:
    assert judge(found(), None, before=False, after=False) == "none"
    assert judge(found(0.6, 0.001), None, before=False, after=False) == "none"


@pytest.mark.parametrize(
    ("p_free", "said"), [(SETTINGS.evidence.alpha / 4, "unknown"), (0.9 * SETTINGS.evidence.alpha, "none")]
)
def test_a_gap_that_no_effect_explains_is_unknown_only_where_it_is_beyond_doubt(p_free: float, said: str) -> None:
    quiet = hypothesis(0.0)  # all trajectories were fitted: none shows a gap where nothing was
    quiet.experiment.scale = torch.ones(1, 10, 1, 6)
    assert judged(Attribution(quiet, left(500.0, p_free), [], None, None, []), None) == said


def test_a_gap_is_judged_in_what_shows_it_more_clearly_positions_or_rotations() -> None:
    allowed = Tolerance(position=1e-3, rotation=5e-3)
    moved, little = Closing(5e-3, 1e-3, None, 1e-3, 300), Closing(1.5e-3, 1.4e-3, None, 1e-3, 300)
    turned, hardly = Closing(0.08, 0.02, None, 0.02, 300), Closing(0.0205, 0.02, None, 0.02, 300)
    nothing = Closing(1e-3, 1e-3, None, 1e-3, 300)
    assert clearer(little, turned, allowed) == ROTATION
    assert clearer(moved, turned, Tolerance(1e-3, 0.02)) == POSITION
    assert clearer(moved, hardly, allowed) == POSITION
    assert clearer(nothing, hardly, allowed) == POSITION, "less than the tolerance"
    more = Closing((0.02**2 + (1.5 * 5e-3) ** 2) ** 0.5, 0.02, None, 0.02, 300)
    assert clearer(nothing, more, allowed) == ROTATION, "half as much again as the tolerance"
    assert clearer(moved, None, allowed) == POSITION
    assert clearer(None, turned, allowed) == POSITION


def test_what_is_left_within_the_tolerance_does_not_make_a_cause_a_part() -> None:
    assert judge(found(0.1, 0.001), None, before=True, after=False) == "named"
    assert judge(found(0.1, 0.001), None, before=True, after=True) == "partial"


def test_what_leaves_nothing_and_carries_over_is_named() -> None:
    assert judged(found(), None) == "named"
    assert judged(found(), transfer(1.01, 0.99)) == "named"


def test_what_cannot_be_distinguished_from_another_is_a_group() -> None:
    assert judged(found(alike=("clock_rate",)), None) == "group"


@pytest.mark.parametrize(("after", "closed", "verdict"), [(2.8, 0.1, "unknown"), (1.04, 0.1, "named")])
def test_what_closes_nothing_under_another_protocol_is_no_cause_unless_little_is_open(
    after: float, closed: float, verdict: str
) -> None:
    assert judged(found(), transfer(after, closed)) == verdict


@pytest.mark.parametrize(("values", "verdict"), [(360, "named"), (90_000, "unknown")])
def test_an_error_that_few_frames_show_by_chance_contradicts_nothing(values: int, verdict: str) -> None:
    # 6 % over the floor: 1.6 standard deviations of 360 values, 25 of 90,000.
    closing = Closing(1.065 * FLOOR, 1.06 * FLOOR, Interval(0.08, None, None), FLOOR, values)
    assert judged(found(), closing) == verdict


@pytest.mark.parametrize(("closed", "verdict"), [(0.8, "partial"), (0.5, "unknown")])
def test_a_part_of_the_cause_closes_most_of_the_gap_under_another_protocol(closed: float, verdict: str) -> None:
    assert judged(found(0.1, 0.001), transfer(2.0, closed)) == verdict


@pytest.mark.parametrize("verdict", ["named", "group", "partial"])
@pytest.mark.parametrize(("same", "other", "most"), [(0.8, 0.7, True), (0.8, 0.4, False), (0.1, 0.9, False)])
def test_what_is_blamed_closes_most_of_the_gap_in_all_frames_of_each_protocol(
    verdict: Any, same: float, other: float, most: bool
) -> None:
    known = [transfer(1.5, same), transfer(1.5, other)]
    assert in_all_frames(verdict, known, SETTINGS.verdict) == (verdict if most else "unknown")
    assert in_all_frames(verdict, [known[0], None], SETTINGS.verdict) == (verdict if same >= 0.6 else "unknown")


def test_where_no_protocol_shows_a_gap_nothing_is_a_part_of_it_and_a_whole_stays() -> None:
    nothing = [Closing(FLOOR, FLOOR, None, FLOOR, 90_000), None]
    said: list[Any] = ["partial", "named", "none", "unknown"]
    assert [in_all_frames(one, nothing, SETTINGS.verdict) for one in said] == ["unknown", "named", "none", "unknown"]


def test_more_than_a_part_that_is_open_is_unknown() -> None:
    assert judged(found(0.1, 0.001), None) == "partial"
    assert judged(found(0.6, 0.001), None) == "unknown"


@pytest.mark.parametrize(("behind", "apart"), [(8.0, False), (60.0, True)])
def test_a_rival_is_told_apart_by_more_than_chance(behind: float, apart: bool) -> None:
    nominal, best, other = hypothesis(500, 500), hypothesis(100, 100), hypothesis(100 + behind, 100)
    assert distinguishable(nominal, best, other, cast(Any, left(0.0, 1.0))) is apart


@pytest.mark.parametrize(("behind", "apart"), [(60.0, False), (6000.0, True)])
def test_and_by_more_than_the_numerics_know(behind: float, apart: bool) -> None:
    nominal, best, other = hypothesis(50000, 50000), hypothesis(100, 100), hypothesis(100 + behind, 100)
    assert distinguishable(nominal, best, other, cast(Any, left(0.0, 1.0))) is apart


@pytest.mark.parametrize(("whole", "apart"), [(True, True), (False, False)])
def test_where_something_is_left_a_rival_must_be_worse_in_all_trajectories(whole: bool, apart: bool) -> None:
    nominal, best, other = hypothesis(900, 900, 900), hypothesis(100, 100, 100), hypothesis(800, 100, 100)
    assert distinguishable(nominal, best, other, cast(Any, left(20.0, 0.001)), whole) is apart


def pair(absent: list[str], *held_out: float) -> Any:
    one = hypothesis(*held_out)
    one.names, one.covariance, one.absent = ("tether", "viscous_drag"), lambda: 0.0, lambda _: absent
    return one


@pytest.fixture
def calm(monkeypatch: pytest.MonkeyPatch) -> torch.Generator:
    """Let impacts amplify nothing."""
    monkeypatch.setattr(evidence, "bootstrap_spread", lambda *_: 0.0)
    return torch.Generator()


def left_by_drag(missing: float) -> Any:
    """Return what a drag leaves; two effects must explain more than 30 together."""
    return SimpleNamespace(missing=missing, reach=lambda names: 15.0 * len(names))


@pytest.mark.parametrize(
    ("missing", "behind", "absent", "least", "needed"),
    [
        (200.0, 150.0, [], 7.45, True),
        (400.0, 150.0, [], 0.0, False),  # most of what the drag leaves is left by the pair as well
        (20.0, 15.0, [], 0.0, False),  # so much is chance
        (200.0, 150.0, ["tether"], 0.0, False),  # its stiffness may be zero
        (200.0, 150.0, [], 7.55, False),  # it moves predictions by less than the tolerance
    ],
)
def test_a_pair_is_needed_if_it_explains_most_of_what_one_effect_leaves(
    calm: torch.Generator, missing: float, behind: float, absent: list[str], least: float, needed: bool
) -> None:
    nominal, drag, both = hypothesis(900, 900), hypothesis(100 + behind, 100), pair(absent, 100, 100)
    assert all_needed(both, nominal, [drag], left_by_drag(missing), least, calm) is needed


@pytest.mark.parametrize(
    ("gained", "least", "needed"),
    [(41.0, 10.0, True), (39.0, 10.0, False), (0.0, 0.0, True), (-1.0, 0.0, False)],
)
def test_a_pair_is_needed_if_it_moves_predictions_by_the_tolerance_where_nothing_was_fitted(
    calm: torch.Generator, gained: float, least: float, needed: bool
) -> None:
    """In four frames of the last trajectory; ten of the first, which it was fitted to, show more by far."""
    nominal, drag, both = hypothesis(900, 900), hypothesis(250, 100 + gained), pair([], 100, 100)
    for one in (nominal, drag, both):
        one.experiment.fitted[-1], one.experiment.scale[-1, 4:] = False, 0.0
    assert all_needed(both, nominal, [drag], left_by_drag(200.0), least, calm) is needed


@pytest.mark.parametrize(
    ("better", "beyond"),
    [
        ([40.0, 20.0, 30.0, -1.0, 10.0, -0.5, 50.0, 3.0], True),  # nothing is lost where the effect does not act
        ([28.0, 6.0, 10.0, -7.0, -10.0, 9.0, 7.0, -2.0], False),  # impacts: better here, worse there
        ([500.0, -1.0, -2.0, -1.5, -0.5, -2.5, 1.0, -3.0], False),  # a single one
        ([0.0] * 8, False),
        ([-20.0] * 8, False),
    ],
)
def test_what_impacts_amplify_is_not_preferred_beyond_chance(better: list[float], beyond: bool) -> None:
    other = hypothesis(*(100 + one for one in better))
    assert clearly_preferred(hypothesis(*[100] * 8), other) is beyond


@pytest.mark.parametrize("lost", [5.0, 1e4])
def test_one_trajectory_counts_as_one_however_much_it_says(lost: float) -> None:
    one, other = hypothesis(10, 10, 10, 10), hypothesis(13, 12, 14, 10 - lost)
    assert preferred(one, other)  # ranks 2, 1 and 3 against 4
    assert not preferred(other, one)
    assert not preferred(one, one)


@pytest.mark.parametrize(("factor", "needed"), [(0.9, False), (1.2, True)])
def test_a_pair_must_gain_over_all_trajectories_together(calm: torch.Generator, factor: float, needed: bool) -> None:
    nominal, both = hypothesis(900, 900), pair([], 100, 100)
    least = max(SETTINGS.evidence.least, SETTINGS.evidence.same * 1600)
    drag = hypothesis(100 + factor * least / 2, 100 + factor * least / 2)
    chance: Any = SimpleNamespace(missing=factor * least, reach=lambda _: 0.0)
    assert all_needed(both, nominal, [drag], chance, 0.0, calm) is needed


@pytest.mark.parametrize(
    ("name", "loss", "needed"), [("tether", 100.0, False), ("tether", 400.0, True), ("hill", 100.0, True)]
)
def test_a_second_effect_that_explains_as_much_alone_needs_no_first_one(
    calm: torch.Generator, name: str, loss: float, needed: bool
) -> None:
    nominal, drag, both, other = hypothesis(900, 900), hypothesis(400, 100), pair([], 100, 100), hypothesis(loss, 100)
    other.names = (name,)
    assert all_needed(both, nominal, [drag, other], left_by_drag(300.0), 0.0, calm) is needed


@pytest.mark.parametrize("amplified", [0.0, 1.0])
def test_an_effect_that_impacts_may_feign_is_not_needed(monkeypatch: pytest.MonkeyPatch, amplified: float) -> None:
    """Noise alone would let its size be known."""
    monkeypatch.setattr(evidence, "bootstrap_spread", lambda *_: amplified)
    nominal, drag, both = hypothesis(900, 900), hypothesis(250, 100), pair([], 100, 100)
    both.absent = lambda spread: ["tether"] if spread > 0.5 else []
    needed = all_needed(both, nominal, [drag], left_by_drag(200.0), 0.0, torch.Generator())
    assert needed == (amplified < 0.5)


def test_a_pair_must_explain_more_than_a_single_effect_to_be_the_whole() -> None:
    nominal, single, two = hypothesis(1100, 1100), hypothesis(100, 100), pair([], 100, 100)
    stage_of = cast(Any, SimpleNamespace(excess=0.0))
    assert complete(nominal, single, stage_of, left(20.0, 0.001))
    assert not complete(nominal, two, stage_of, left(20.0, 0.001))
    assert complete(nominal, two, stage_of, left(5.0, 0.001))
    three = SimpleNamespace(**{**vars(two), "names": ("tether", "viscous_drag", "force_gain")})
    assert not complete(nominal, cast(Any, three), stage_of, left(5.0, 0.001))
    assert complete(nominal, cast(Any, three), stage_of, left(2.0, 0.001))


def test_a_hair_is_left_by_laws_that_differ_a_little_and_is_no_part() -> None:
    assert judged(found(0.01, 0.001), None) == "named"
    assert judged(found(0.03, 0.001), None) == "partial"


def lack(*rows: Row) -> LackOfFit:
    """Return a stage whose null simulations deviate by 3 at most."""
    null = torch.linspace(0, 3, 300)
    nothing, settings = cast(Any, None), SETTINGS.lack_of_fit
    fitted = torch.tensor([True, False])
    return LackOfFit(
        nothing,
        [],
        list(rows),
        null,
        null,
        torch.zeros(2),
        torch.stack([null, torch.zeros(300)]),
        nothing,
        [],
        fitted,
        torch.ones(2, dtype=torch.bool),
        null,
        settings,
    )


def row(name: str, gain: float, scale: float) -> Row:
    mean = torch.tensor(scale, dtype=torch.float64)
    tail = Tail(mean, 2 * mean**2)
    return Row((name,), gain, gain, torch.zeros(1), torch.zeros(1), tail, tail, 1.0)


def test_an_effect_that_impacts_let_gain_by_chance_hides_no_other() -> None:
    by_chance, true = row("ground_restitution", 250.0, 60.0), row("length_scale", 60.0, 2.0)
    assert lack(by_chance).p_best > 0.05
    assert lack(by_chance, true).p_best < 0.01
    assert [one.names for one in lack(by_chance, true).significant] == [("length_scale",)]


def test_what_is_left_is_as_rare_as_the_rarer_of_two_looks_at_it_and_never_rarer_than_nothing() -> None:
    quiet = lack(row("viscous_drag", 0.0, 2.0))
    assert quiet.p_value == 1.0
    assert replace(quiet, rows=[]).p_best == 1.0
    one = lack(row("viscous_drag", 60.0, 2.0))
    assert one.p_free > 0.5 > one.p_best
    assert one.p_value == pytest.approx(2 * one.p_best)


def test_what_a_free_wrench_explains_beyond_chance_counts_by_its_margin() -> None:
    quiet = lack()
    null = quiet.null_free[0]
    for excess in (0.5, 1.0):
        free = torch.tensor([float(null.mean()) + excess, 0.0])
        least = float(null.mean()) + excess / SETTINGS.lack_of_fit.margin
        share = float((null >= least).double().mean())
        assert replace(quiet, free=free).p_free == pytest.approx(share, abs=0.01)


@pytest.mark.parametrize(("held_out", "there"), [(0.5, False), (1.5, False), (3.0, True), (3.5, True)])
def test_a_gap_that_a_free_wrench_shows_is_there_in_held_out_trajectories_as_well(held_out: float, there: bool) -> None:
    """Both scatter by the same law about 1.5, independently; what chance gives one it does not give the sum."""
    quiet = lack()
    null = torch.stack(
        [quiet.null_free[0], quiet.null_free[0][torch.randperm(300, generator=torch.Generator().manual_seed(0))]]
    )
    beyond = SETTINGS.lack_of_fit.margin * 1.5
    free = torch.tensor([1.5 + beyond, held_out])
    found = replace(quiet, free=free, null_free=null)
    assert found.excess == pytest.approx(beyond, abs=1e-5)
    assert (found.p_free <= 0.02) == there
    assert replace(found, sound=found.counted).p_free <= 0.02


def test_the_more_effects_gain_the_less_chance_gives_it_and_a_loss_is_no_gain() -> None:
    some = lack(row("viscous_drag", 60.0, 2.0))
    chances = [some.chance(("viscous_drag",), gain) for gain in (-5.0, 0.0, 5.0, 10.0, 1000.0)]
    assert chances[0] == chances[1]
    assert chances == sorted(chances, reverse=True)
    assert chances[1] > 0.9 > 0.01 > chances[-1]
    assert some.chance(("viscous_drag",), some.reach(("viscous_drag",))) == pytest.approx(0.01, abs=0.01)


@pytest.mark.parametrize(
    ("size", "gap", "absent"), [(0.1, False, True), (0.3, False, False), (0.1, True, False), (-0.1, False, True)]
)
def test_wind_that_may_be_zero_and_closes_no_gap_is_not_there(size: float, gap: bool, absent: bool) -> None:
    """Its size is known to 0.2 N (90 %); the mass beside it does not matter."""
    wind = next(kind for kind in CATALOGUE if kind.name == "constant_force")
    terms = [EffectParameter(wind, "x"), EffectParameter(wind, "y")]
    point = SimpleNamespace(nominal=torch.zeros(1, 1), effects=torch.tensor([[size, 0.05]], dtype=torch.float64))
    null = torch.zeros(2, dtype=torch.float64)
    predictor = SimpleNamespace(terms=terms, candidates=[wind], null=null)
    chosen = Hypothesis(
        names=("constant_force",),
        columns=torch.tensor([0, 1]),
        fit=cast(Any, SimpleNamespace(point=point)),
        experiment=cast(Any, SimpleNamespace(predictor=predictor, fitted=torch.ones(1000, dtype=torch.bool))),
        normal=cast(Any, None),
        held_out=null,
        settings=SETTINGS,
    )
    covariance = torch.eye(4, dtype=torch.float64) * (0.2 / 1.646) ** 2
    closings = [Closing(FLOOR, FLOOR, None, FLOOR, 90_000), transfer(1.5, 0.7) if gap else None]
    assert indistinguishable_from_zero(chosen, covariance, closings) is absent


@pytest.mark.parametrize(
    ("p_value", "others", "verdict"),
    [
        (1.0, 1.0, "none"),
        (1.0, 29.0, "named"),  # it shows in a few impacts, and those of other trajectories are foretold
        (0.001, 29.0, "unknown"),  # what it leaves is there, whatever it is
    ],
)
def test_what_may_be_nothing_is_blamed_where_it_predicts_others_and_leaves_nothing(
    p_value: float, others: float, verdict: str
) -> None:
    nominal, best = hypothesis(600, 100 + others), hypothesis(100, 100)
    nominal.experiment.fitted = torch.tensor([True, False])
    assert reconsider(judged(found(0.1, p_value), None), nominal, best) == verdict
