"""Probabilities of causes: laws of the model, both sides of what its evidence says, and the table that it came from."""

from __future__ import annotations

from dataclasses import asdict, replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from tests.diagnosis.documents import said

from physid.benchmark.scoring.training import OFFSETS, REST, SLOPED, SLOPES, Case, read_table, train
from physid.diagnosis.document.evidence import Evidence
from physid.diagnosis.inputs import Observations
from physid.diagnosis.posterior.evidence import _group, bend, evidence_of
from physid.diagnosis.posterior.posterior import confidence, features, shipped
from physid.diagnosis.settings.settings import Settings
from physid.estimation.prediction import Timeline
from physid.scenes.setups.push import PUSH

CLEAR = Evidence(said=("viscous_drag",), behind={"viscous_drag": 0.0, "tether": 4.0}, gap=20.0, bend=0.2, poses=3000)
FREE = Evidence(said=("none",), behind={"viscous_drag": 0.0, "tether": 0.2}, gap=0.0, bend=0.2, poses=3000)
UNKNOWN = replace(CLEAR, said=("unknown",))


@cache
def table() -> tuple[Case, ...]:
    """Return the table that ships, of which reading alone takes seconds."""
    return tuple(read_table())


def sure(evidence: Evidence) -> float:
    return confidence(evidence, shipped().probabilities(evidence))


@pytest.mark.parametrize("evidence", [CLEAR, FREE, UNKNOWN])
def test_probabilities_are_positive_and_sum_to_one(evidence: Evidence) -> None:
    found = shipped().probabilities(evidence)
    assert set(found) == {"none", "unknown", "other", "viscous_drag", "tether"}
    assert sum(found.values()) == pytest.approx(1)
    assert min(found.values()) > 0
    assert [*found.values()] == sorted(found.values(), reverse=True)


@pytest.mark.parametrize("evidence", [CLEAR, FREE, UNKNOWN])
def test_a_weak_case_and_a_case_beyond_doubt_differ(evidence: Evidence) -> None:
    coarse = replace(evidence, bend=10.0, poses=300)
    assert sure(evidence) > 0.9
    assert 1 - sure(coarse) > 2 * (1 - sure(evidence)), "few frames that hardly resolve the motion leave doubt"


def test_a_gap_speaks_for_an_effect_and_against_none() -> None:
    assert 1 - sure(replace(CLEAR, gap=0.5)) > 1.3 * (1 - sure(CLEAR))
    assert 1 - sure(replace(FREE, gap=3.0)) > 1.2 * (1 - sure(FREE))


def test_no_evidence_makes_certain() -> None:
    most = sure(replace(CLEAR, gap=1e9, poses=10**9))
    assert most < 1 - 0.5 * shipped().rest


def test_a_rival_that_scores_alike_takes_its_share() -> None:
    names = ("viscous_drag", "quadratic_drag")
    both = replace(CLEAR, said=names, behind=dict.fromkeys(names, 0.0))
    found = shipped().probabilities(both)
    assert found["viscous_drag"] == pytest.approx(found["quadratic_drag"])
    assert sure(both) > found["viscous_drag"] * 1.9


@pytest.mark.slow
def test_the_coefficients_follow_from_the_table_that_ships() -> None:
    cases = table()
    trained = train(cases)
    assert trained.sets == shipped().sets == len(cases)
    for name, value in asdict(trained.coefficients).items():
        assert value == pytest.approx(getattr(shipped().coefficients, name), rel=0.01, abs=0.01), name


@pytest.mark.slow
def test_the_gradient_of_the_log_score_vanishes_at_the_fit_but_for_its_ridge() -> None:
    """Of p = (1 - e) s + e / m, with s of the true cause, the slope is (1 - e) s (x - mean x) / p."""
    cases = [case for case in table() if len(case.truth) == 1]
    weights = train(cases).coefficients.vector()
    difference = np.zeros(len(weights))
    for case in cases:
        column = features(case.evidence)
        listed = ["none", "unknown", "other", *case.evidence.behind]
        found = np.exp(column @ weights)
        found /= found.sum()
        place = listed.index(case.truth[0])
        share = (1 - REST) * found[place]
        difference += share / (share + REST / len(found)) * (column[place] - found @ column)
    ridge = np.array([SLOPES if name in SLOPED else OFFSETS for name in asdict(shipped().coefficients)])
    assert difference == pytest.approx(ridge * weights, abs=0.05)


@pytest.mark.slow
def test_probabilities_of_a_world_that_follows_the_model_are_calibrated() -> None:
    """Truths are drawn from the shipped model; a model that is trained on half of them says how often it is right."""
    generator = np.random.default_rng(0)
    cases: list[Case] = []
    for case in table() * 4:
        found = shipped().probabilities(case.evidence)
        true = generator.choice([*found], p=np.array([*found.values()]) / sum(found.values()))
        cases.append(replace(case, truth=(str(true),)))
    trained = train(cases[::2])
    said = [(confidence(one.evidence, trained.probabilities(one.evidence)), one.right) for one in cases[1::2]]
    probability, right = np.array(said, float).T
    error = float((probability * (1 - probability)).mean() / len(said)) ** 0.5
    assert probability.mean() == pytest.approx(right.mean(), abs=3 * error + 0.01)


def test_sets_that_were_left_out_are_predicted_better_than_by_counting_verdicts() -> None:
    cases, score = table(), []
    for fold in range(5):
        trained = train([case for k, case in enumerate(cases) if k % 5 != fold])
        for case in cases[fold::5]:
            p = confidence(case.evidence, trained.probabilities(case.evidence))
            score.append(-np.log(p if case.right else 1 - p))
    share = np.mean([case.right for case in cases])
    assert np.mean(score) < -(share * np.log(share) + (1 - share) * np.log(1 - share))


def test_positions_on_a_line_do_not_bend_and_noise_is_taken_off() -> None:
    time = torch.linspace(0, 1, 200, dtype=torch.float64)[None] ** 1.3  # stamps need not be even
    position = (time[..., None, None] * torch.tensor([1.0, -2.0, 0.5])).double()
    seen = torch.ones(1, 200, 1, dtype=torch.bool)
    assert bend(position, seen, time, 1e-3) == pytest.approx(0, abs=1e-6)
    even = torch.linspace(0, 1, 200, dtype=torch.float64)[None]
    fall = even[..., None, None] ** 2 * torch.tensor([0.0, 0.0, -4.9])
    step = 1 / 199
    assert bend(fall.double(), seen, even, 1e-4) == pytest.approx(((9.8 * step**2) ** 2 - 6e-8) ** 0.5 / 1e-4, rel=1e-6)
    uneven = (torch.arange(200, dtype=torch.float64) + 0.3 * (torch.arange(200) % 2))[None] / 199
    between = (uneven[:, 2:] - uneven[:, :-2]) / 2
    bent = 9.8 * between.square().square().mean() ** 0.5
    fall = uneven[..., None, None] ** 2 * torch.tensor([0.0, 0.0, -4.9], dtype=torch.float64)
    assert bend(fall, seen, uneven, 1e-9) == pytest.approx(float(bent) / 1e-9, rel=1e-6)
    noise = 1e-3 * torch.randn(1, 200, 1, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    assert bend(position * 0 + noise, seen, even, 3**0.5 * 1e-3) < 1


def test_the_evidence_is_that_of_the_document() -> None:
    pose = torch.zeros(2, 30, 1, 7, dtype=torch.float64)
    pose[..., 6] = 1
    timeline = Timeline.regular(torch.zeros(2, 30, 1, 6, dtype=torch.float64), PUSH.scene.time_step)
    still = Observations(PUSH.scene, pose, torch.ones(2, 30, 1, dtype=torch.float64), timeline, ("fit", "same"), (0, 1))
    document = said("group")
    found = evidence_of(document, still, Settings())
    assert found.poses == 60
    assert found.bend == 0
    pose[0, 12, 0, :3], still.present[0, 12, 0] = 5.0, 0.0
    assert evidence_of(document, still, Settings()).bend == 0, "a frame in which the body was not seen"
    assert set(found.said) == set(document.group)
    assert found.behind[document.ranking[0].effects[0]] == 0
    assert found.gap == pytest.approx((0.021**2 - 0.0014**2) ** 0.5 / 0.0004)


def test_a_group_of_several_effects_allows_what_was_fitted_and_a_twin_in_the_place_of_any() -> None:
    """Of a and b the search fitted b with c as well, and never d, whose signature is that of one of them."""
    row = SimpleNamespace
    fitted = [row(effects=("a", "b")), row(effects=("b", "c")), row(effects=("b", "e")), row(effects=("c",))]
    document: Any = row(blamed=("a", "b"), group=("a", "b", "c", "d"), ranking=fitted)
    assert _group(document) == ["a + b", "b + c", "b + d", "a + d"]
    alone: Any = row(blamed=("a",), group=("a", "c", "d"), ranking=[row(effects=("a",)), row(effects=("c",))])
    assert _group(alone) == ["a", "c", "d"]
