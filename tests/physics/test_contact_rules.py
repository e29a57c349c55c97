"""When a contact acts, and with which velocity it parts bodies: both rules, value by value."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from physid.physics.contact import ContactRule, Penetrating, Speculative, Split

STEP = torch.tensor(0.01, dtype=torch.float64)
E = 0.5
"""Restitution."""


def offset(rule: ContactRule, gap: float, speed: float, free: float, restitution: float = E) -> float:
    """Return c of one contact; `free` is the normal velocity after a step without contacts."""
    numbers = (torch.tensor(value, dtype=torch.float64) for value in (gap, speed, free, restitution))
    gap_of, speed_of, free_of, restitution_of = numbers
    found: Tensor = rule.offset(gap_of, speed_of, free_of, restitution_of, STEP)
    return float(found)


RULES = pytest.mark.parametrize("rule", [Speculative(), Penetrating()])


def test_a_body_that_is_apart_may_come_as_close_as_it_touches() -> None:
    assert offset(Speculative(), 0.002, -0.1, -0.1) == pytest.approx(0.2)
    assert offset(Speculative(), 0.0, 0.0, -0.1) == 0.0


@RULES
def test_an_overlap_is_removed_by_its_share_but_not_faster_than_the_limit(rule: ContactRule) -> None:
    assert offset(rule, -0.001, 0.0, 0.0) == pytest.approx(-rule.correction * 0.001 / 0.01)  # type: ignore[attr-defined]
    assert offset(rule, -10.0, 0.0, 0.0) == pytest.approx(-rule.speed_limit)  # type: ignore[attr-defined]


@pytest.mark.parametrize(("gap", "bounces"), [(0.0, True), (0.002, True), (0.005, False), (0.00499, True)])
def test_a_body_bounces_if_it_would_pass_the_surface_in_this_step_and_no_earlier(gap: float, bounces: bool) -> None:
    found = offset(Speculative(), gap, -0.5, -0.5)  # 5 mm in a step: from 5 mm it arrives with nothing left to pass
    assert found == pytest.approx(-E * 0.5 if bounces else gap / 0.01)


def test_what_parts_or_rests_or_has_no_restitution_does_not_bounce() -> None:
    for speed, restitution in ((0.3, E), (0.0, E), (-0.3, 0.0)):
        assert offset(Speculative(), 0.001, speed, -0.5, restitution) == pytest.approx(0.1)
        assert offset(Penetrating(), -0.001, speed, -0.5, restitution) == pytest.approx(-0.008)


@pytest.mark.parametrize("rule", [Speculative(), Penetrating(), Split()])
@pytest.mark.parametrize("gap", [-0.1, -0.001, 0.0, 0.001, 0.1])
@pytest.mark.parametrize("speed", [0.0, 1e-3, 0.5, 3.0])
def test_restitution_changes_nothing_where_bodies_part_or_rest(rule: ContactRule, gap: float, speed: float) -> None:
    for free in (-2.0, 2.0):
        assert offset(rule, gap, speed, free, 0.9) == offset(rule, gap, speed, free, 0.0)


def test_in_an_overlap_the_faster_of_bounce_and_removal_acts() -> None:
    assert offset(Speculative(), -0.1, -0.3, -0.3) == pytest.approx(-1.0)
    assert offset(Speculative(), -0.001, -0.3, -0.3) == pytest.approx(-0.15)
    assert offset(Penetrating(), -0.1, -0.3, -0.3) == pytest.approx(-0.8)
    assert offset(Penetrating(), -0.001, -0.3, -0.3) == pytest.approx(-0.15)


def test_split_impulses_reflect_velocities_and_leave_overlaps_to_the_displacement() -> None:
    rule = Split()
    assert offset(rule, -0.001, -0.3, -0.3) == pytest.approx(-0.15)
    for speed, restitution in ((0.3, E), (0.0, E), (-0.3, 0.0)):
        assert offset(rule, -0.001, speed, -0.5, restitution) == 0.0
    gaps = torch.tensor([-0.001, -rule.slop, 0.0], dtype=torch.float64)
    assert torch.allclose(
        rule.displacement(gaps), rule.correction * torch.tensor([0.001 - rule.slop, 0, -rule.slop]).double()
    )


def test_a_contact_is_looked_at_below_its_reach_and_not_at_it() -> None:
    gaps = torch.tensor([0.25, 0.5, 0.75])
    assert Speculative().exists(gaps, torch.tensor(0.5)).tolist() == [True, False, False]


def test_contacts_that_only_overlaps_make_do_not_exist_before() -> None:
    gaps, reach = torch.tensor([-1e-6, 0.0, 1e-3, 0.1]), torch.tensor(0.01)
    assert Speculative().exists(gaps, reach).tolist() == [True, True, True, False]
    for rule in (Penetrating(), Split()):
        assert rule.exists(gaps, reach).tolist() == [True, False, False, False]
