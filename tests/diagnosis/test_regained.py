"""Impacts that effects explain count in the gap, however little in the nominal fit; other ones do not."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from diagnosis.flown import QUICK, hypothesis, nominal_fit_of
from estimation.flights import flights
from physid.diagnosis.reference.nominal_fit import NominalFit
from physid.diagnosis.selection.materiality import excess_left, regained
from physid.diagnosis.testing import Hypothesis
from physid.scenes.scene import Integration

ROLES = ("fit",) * 4 + ("same",) * 3
LITTLE = 0.05  # of what they would count without being set aside


def set_aside(struck: list[int], wind: float = 4.0) -> tuple[NominalFit, Hypothesis, Hypothesis]:
    """Return flights in a wind of which some segments are said to hold an impact, and to count little for it."""
    made = flights(kinds=("constant_force",), sizes=(wind, 0.0), trajectories=len(ROLES), cuts=1)
    nominal_fit = nominal_fit_of(made, ROLES)
    segments = nominal_fit.experiment.predictor.segments
    segments.struck[struck] = True
    few = segments.spread(segments.struck)[..., None, None]
    scale = torch.where(few, LITTLE * nominal_fit.experiment.scale, nominal_fit.experiment.scale)
    made = replace(made, experiment=made.experiment.replace(fitted=nominal_fit.experiment.fitted))
    nominal, best = (
        replace(one, experiment=one.experiment.replace(scale=scale))
        for one in (hypothesis(made, names, QUICK) for names in ((), ("constant_force",)))
    )
    return nominal_fit, nominal, best


def test_segments_that_effects_explain_count_like_others_and_show_the_gap() -> None:
    nominal_fit, nominal, best = set_aside(list(range(len(ROLES))))
    before, after = regained(nominal_fit, nominal, best)
    assert after is not None
    whole = nominal_fit.present[..., None] / nominal_fit.noise.spread()
    for one in (before, after):
        assert torch.allclose(one.experiment.scale, whole.expand_as(one.experiment.scale))
    excess = excess_left(nominal_fit, before).position
    assert excess > 10 * excess_left(nominal_fit, after).position
    assert excess > 5 * nominal_fit.noise.floor


def test_what_no_effect_explains_stays_set_aside() -> None:
    nominal_fit, nominal, _ = set_aside(list(range(len(ROLES))))
    assert regained(nominal_fit, nominal, nominal) == (nominal, nominal)
    assert regained(nominal_fit, nominal, None) == (nominal, None)


@pytest.mark.parametrize(("explained", "counts"), [(3, False), (4, True)])
def test_effects_that_explain_half_of_the_unexplained_impacts_or_fewer_may_do_so_by_chance(
    explained: int, counts: bool
) -> None:
    struck = list(range(6))
    nominal_fit, nominal, best = set_aside(struck)
    residual = best.fit.residual.clone()
    residual[explained:6] = nominal.fit.residual[explained:6]
    best = replace(best, fit=replace(best.fit, residual=residual))
    before, _ = regained(nominal_fit, nominal, best)
    changed = (before.experiment.scale != nominal.experiment.scale).flatten(1).any(1)
    assert changed.tolist() == [counts and row < explained for row in range(len(ROLES))]


def test_two_impacts_are_too_few_to_tell() -> None:
    nominal_fit, nominal, best = set_aside([0, 1])
    assert regained(nominal_fit, nominal, best) == (nominal, best)


def test_where_a_simulator_is_known_nothing_changes() -> None:
    nominal_fit, nominal, best = set_aside(list(range(len(ROLES))))
    known = replace(nominal_fit.observations.scene, integration=Integration("semi_implicit_euler", 1 / 240))
    nominal_fit = replace(nominal_fit, observations=replace(nominal_fit.observations, scene=known))
    assert regained(nominal_fit, nominal, best) == (nominal, best)
    assert nominal_fit.unexplained_events is None


def test_without_an_impact_nothing_changes() -> None:
    nominal_fit, nominal, best = set_aside([])
    assert regained(nominal_fit, nominal, best) == (nominal, best)
