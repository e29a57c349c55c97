"""The search goes on past what cannot be simulated, and keeps what it has found.

Which fit a solver gives up on is not to be had on purpose: fits and looks at them are stand-ins here.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest
import torch

from physid.diagnosis.progress import silent
from physid.diagnosis.selection import all_frames, attribution, further, search, several
from physid.diagnosis.selection import comparison as compare_candidates
from physid.diagnosis.settings.settings import Settings
from physid.physics import SolverError


def hypothesis(*names: str, loss: float = 1.0) -> Any:
    """Stand in for a fitted hypothesis of two trajectories."""
    experiment = SimpleNamespace(fitted=torch.ones(2, dtype=torch.bool))
    given = {"experiment": experiment, "fit": None, "settings": Settings(), "columns": ()}
    return SimpleNamespace(names=names, held_out=torch.full((2,), loss), **given)


def spread(*names: str, loss: torch.Tensor) -> Any:
    """Stand in for a fitted hypothesis with a loss of each trajectory."""
    return SimpleNamespace(**vars(hypothesis(*names)) | {"held_out": loss})


def lack(p_value: float) -> Any:
    """Stand in for what a hypothesis leaves."""
    return SimpleNamespace(p_value=p_value, p_free=p_value, missing=0.0, fit=None, significant=[])


def test_a_hypothesis_that_cannot_be_looked_at_is_passed_over_and_the_next_one_answers(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    nominal, first, second = hypothesis(), hypothesis("first"), hypothesis("second")

    def find_lack_of_fit(_: object, one: Any, __: object) -> Any:
        if one is first:
            raise SolverError("no solution")
        return lack(0.001 if one is nominal else 1.0)

    for name, stand_in in (
        ("conclude", lambda *_: nominal),
        ("find_lack_of_fit", find_lack_of_fit),
        ("survivors", lambda *_: [first.names, second.names]),
        ("compare_candidates", lambda *_: [first, second]),
        ("evident", lambda _: False),
        ("sound", lambda *_: True),
        ("complete", lambda *_: True),
        ("distinguishable", lambda *_: False),
        ("alike", lambda *_: ()),
        ("least_gain", lambda *_: 0.0),
    ):
        monkeypatch.setattr(search, name, stand_in)
    monkeypatch.setattr(attribution, "contact_free", lambda *_: None)
    found = attribution.attribute(cast(Any, hypothesis()), torch.Generator())
    assert found.best is second
    assert found.group == [second]
    assert found.left is not None


@pytest.mark.parametrize(
    ("most", "chosen"),
    [
        (0, []),
        (1, ["ef"]),
        (2, ["ad", "ef"]),
        (5, ["ad", "ac", "ef", "bf", "be"]),
        (7, ["ad", "ac", "ab", "ef", "bf", "be"]),
    ],
)
def test_half_of_the_pairs_are_the_best_effect_with_what_it_leaves_and_half_the_best_pairs(
    most: int, chosen: list[str]
) -> None:
    ranked: list[Any] = [tuple(pair) for pair in ("ef", "bf", "be", "ab", "ac", "ad")]
    rows = [SimpleNamespace(names=(name,)) for name in "gdcb"]  # with g the best was no pair of significant effects
    assert several.first_combinations(ranked, hypothesis("a"), cast(Any, SimpleNamespace(significant=rows)), most) == [
        tuple(pair) for pair in chosen
    ]


def test_what_has_one_effect_more_shares_all_effects_of_the_best_or_all_but_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of five effects that are significant alone, and a sixth that is not, by the sum of what they are worth."""
    worth = dict(zip("abcde", (1.0, 2.0, 4.0, 8.0, 16.0), strict=True))
    monkeypatch.setattr(several, "joined", lambda chosen: [group.names[0] for group in chosen])
    monkeypatch.setattr(several, "gains", lambda _matrix, names, _settings: [sum(worth[name] for name in names)])
    rows = [SimpleNamespace(names=(name,)) for name in "abcde"]
    stage: Any = SimpleNamespace(significant=rows, groups=[*rows, SimpleNamespace(names=("f",))], conditional=None)

    def ranked(best: str) -> list[str]:
        return ["".join(names) for names in several.one_more(stage, tuple(best), Settings().score_test)]

    assert ranked("a") == ["de", "ce", "be", "ae", "cd", "bd", "ad", "bc", "ac", "ab"]
    assert ranked("ab") == ["bde", "ade", "bce", "ace", "abe", "bcd", "acd", "abd", "abc"]
    assert ranked("abc") == ["bcde", "acde", "abde", "abce", "abcd"]


def test_an_exchange_is_ranked_by_what_it_explains_and_tries_nothing_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without b, a leaves 10 and d explains 9 of it; without a, b leaves 4, of which c explains 2 and d as much."""

    def without(name: str, loss: float, **gained: float) -> Any:
        one = hypothesis(name)
        one.fit = SimpleNamespace(loss=torch.tensor([loss, 50.0]))  # the second trajectory is held out
        one.experiment = SimpleNamespace(
            fitted=torch.tensor([True, False]),
            predictor=SimpleNamespace(segments=SimpleNamespace(trajectory=torch.tensor([0, 1]))),
        )
        rows = [SimpleNamespace(names=(other,), gain=gain) for other, gain in gained.items()]
        tests[name] = SimpleNamespace(fit=f"beside {name}", observed=lambda: (None, rows))
        return one

    tests: dict[str, Any] = {}
    monkeypatch.setattr(several, "score_test_of", lambda one: tests[one.names[0]])
    bases = [without("a", 10.0, b=9.5, c=1.0, d=9.0), without("b", 4.0, a=3.5, c=2.0, d=2.0)]
    fits, both = several.Fitted(hypothesis(), SimpleNamespace(), bases), hypothesis("a", "b")
    assert fits.exchanges(both, {frozenset("ab"), frozenset("bc")}, 2) == [("a", "d"), ("b", "d")]
    assert fits.exchanges(both, set(), 9) == [("a", "b"), ("a", "d"), ("b", "c"), ("b", "d"), ("a", "c")]


def test_a_combination_begins_at_the_best_hypothesis_of_most_effects_that_it_holds(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Only what is new has to be found then; with nothing that it holds it begins at the nominal model."""
    begun: list[tuple[str, tuple[str, ...]]] = []
    monkeypatch.setattr(several, "score_test_of", lambda one: SimpleNamespace(fit="".join(one.names)))
    monkeypatch.setattr(several, "begin_hypothesis", lambda _one, start, names, _set: begun.append((start, names)))

    def fitted(score: float, *names: str) -> Any:
        one = hypothesis(*names)
        one.held_out = torch.tensor([score])
        return one

    known = [fitted(3.0, "a"), fitted(2.0, "b"), fitted(5.0, "a", "c"), fitted(1.0, "d")]
    fits = several.Fitted(fitted(9.0), cast(Any, "nominal"), known)
    for names in ("ab", "abc", "ad", "ef", "abd"):
        fits.begin(tuple(names))
    assert [start for start, _ in begun] == ["b", "ac", "d", "nominal", "d"]


def test_what_flights_showed_stays_where_what_it_leaves_at_impacts_cannot_be_simulated(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fails(*_: object) -> None:
        raise SolverError("no solution")

    drag = hypothesis("drag")
    named = search.Attribution(hypothesis(), lack(0.001), [drag], drag, lack(1.0), [drag])
    for module, name, stand_in in (
        (attribution, "contact_free", lambda *_: "calm windows"),
        (attribution, "search_catalogue", lambda *_: named),
        (attribution, "is_material", lambda *_: True),
        (all_frames, "refit_all_segments", lambda *_: drag),
        (all_frames, "conclude", lambda *_: hypothesis()),
        (further, "find_lack_of_fit", fails),
    ):
        monkeypatch.setattr(module, name, stand_in)
    found = attribution.attribute(cast(Any, hypothesis()), torch.Generator())
    assert found.contact_free
    assert found.whole_best is drag
    assert found.best is drag


NOTHING, UNEXPLAINED, PART, WHOLE = "nothing", "unexplained", "part", "whole"


@pytest.mark.parametrize(
    ("calm", "material", "everywhere", "decides"),
    [
        (WHOLE, True, WHOLE, "calm"),
        (UNEXPLAINED, True, WHOLE, "calm"),
        (PART, True, WHOLE, "all"),
        (PART, True, PART, "calm"),
        (WHOLE, False, WHOLE, "all"),
        (WHOLE, False, UNEXPLAINED, "calm"),
        (PART, False, NOTHING, "calm"),
        (UNEXPLAINED, False, PART, "all"),
        (NOTHING, False, PART, "all"),
    ],
)
def test_contact_free_segments_decide_alone_what_they_explain_whole_or_not_at_all_if_it_matters(
    calm: str, material: bool, everywhere: str, decides: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def shown(what: str) -> Any:
        effect = hypothesis("effect") if what in (PART, WHOLE) else None
        left = None if effect is None else lack(1.0 if what == WHOLE else 0.001)
        gap = lack(1.0 if what == NOTHING else 0.001)
        gap.missing, gap.excess = 100.0, 100.0
        if left is not None:
            left.missing = 0.0 if what == WHOLE else 90.0
        return search.Attribution(hypothesis(), gap, [], effect, left, [effect] if effect else [])

    found = {"calm windows": shown(calm), "all windows": shown(everywhere)}
    for name, stand_in in (
        ("contact_free", lambda *_: "calm windows"),
        ("search_catalogue", lambda fit, *_: found["calm windows" if fit == "calm windows" else "all windows"]),
        ("is_material", lambda *_: material),
        ("fit_all_frames", lambda _, one, __: one),
        ("further_effects", lambda _, one, *__: one),
    ):
        monkeypatch.setattr(attribution, name, stand_in)
    monkeypatch.setattr(search, "evident", lambda _: False)
    answer = attribution.attribute(cast(Any, hypothesis()), torch.Generator())
    assert answer is found["calm windows" if decides == "calm" else "all windows"]


@pytest.mark.parametrize(("share", "there"), [(0.49, True), (0.51, False)])
def test_a_free_wrench_has_half_of_what_chance_is_allowed_and_what_is_evident_needs_none(
    share: float, there: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    chance = lack(share * Settings().evidence.alpha)
    found = search.Attribution(hypothesis(), chance, [], None, None, [])
    monkeypatch.setattr(search, "evident", lambda _: False)
    assert search.unexplained(found) == there
    monkeypatch.setattr(search, "evident", lambda _: True)
    assert search.unexplained(found)


@pytest.mark.parametrize(
    ("aside", "first"),
    [
        ([40.0, 45.0, 50.0, 42.0], "camera_offset"),  # each trajectory says so
        ([-4.0, 45.0, 50.0, 42.0], "camera_offset"),  # all but one that hardly cares
        ([220.0, -3.0, -6.0, -4.0], "object_size"),  # one impact went another way
        ([-40.0, -45.0, -50.0, -42.0], "object_size"),
        ([0.0, 0.0, 0.0, 0.0], "object_size"),
    ],
)
def test_of_a_group_that_hypothesis_is_first_which_trajectories_prefer_in_all_frames_one_impact_counting_as_one(
    monkeypatch: pytest.MonkeyPatch, aside: list[float], first: str
) -> None:
    size, offset = hypothesis("object_size"), hypothesis("camera_offset")
    losses = {"object_size": 100 + torch.tensor(aside), "camera_offset": torch.full((4,), 100.0)}
    monkeypatch.setattr(all_frames, "refit_all_segments", lambda _, one: spread(*one.names, loss=losses[one.names[0]]))
    monkeypatch.setattr(all_frames, "refitted_from_new_states", lambda one, _: one)
    monkeypatch.setattr(all_frames, "conclude", lambda *_: spread(loss=torch.full((4,), 1000.0)))
    calm = search.Attribution(hypothesis(), lack(0.001), [size, offset], size, lack(1.0), [size, offset])
    found = all_frames.fit_all_frames(cast(Any, hypothesis()), calm, lambda *_: None)
    assert found.best is not None
    assert found.best.names == (first,)
    assert [one.names for one in found.group] == [one.names for one in found.whole_group]
    assert len(found.group) == 2  # none is dropped
    assert found.whole_best is found.whole_group[0]


def test_hypotheses_are_compared_in_all_frames_from_the_initial_states_that_the_best_of_the_others_found(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked = []

    def again(one: Any, rival: Any) -> Any:
        asked.append((one.names[0], rival.names[0]))
        return one

    names, losses = ("size", "offset", "scale"), {"size": 3.0, "offset": 2.0, "scale": 4.0}
    group = [hypothesis(name) for name in names]
    monkeypatch.setattr(
        all_frames, "refit_all_segments", lambda _, one: hypothesis(*one.names, loss=losses[one.names[0]])
    )
    monkeypatch.setattr(all_frames, "refitted_from_new_states", again)
    monkeypatch.setattr(all_frames, "conclude", lambda *_: hypothesis(loss=100.0))
    calm = search.Attribution(hypothesis(), lack(0.001), group, group[0], lack(1.0), group)
    all_frames.fit_all_frames(cast(Any, hypothesis()), calm, lambda *_: None)
    assert asked == [("size", "offset"), ("offset", "size"), ("scale", "offset")]


def test_a_hypothesis_that_the_reference_simulator_cannot_follow_stays_as_it_was_fitted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fails(*_: object) -> None:
        raise SolverError("no solution")

    fitted = hypothesis("drag", loss=0.1)
    monkeypatch.setattr(compare_candidates, "finish_hypothesis", lambda one: one)
    monkeypatch.setattr(compare_candidates, "refitted_from_new_states", lambda one, _: one)
    monkeypatch.setattr(compare_candidates, "fit_with_reference", fails)
    assert compare_candidates.compare_candidates([fitted.names], lambda _: fitted, hypothesis(), silent) == [fitted]
