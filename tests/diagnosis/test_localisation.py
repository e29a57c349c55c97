"""Where a gap lies when no effect is named: the site whose effects explain most together."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import pytest
import torch

from physid.diagnosis.conclusion.localisation import over_time, sites
from physid.diagnosis.selection.attribution import Attribution
from physid.diagnosis.settings.settings import Settings
from physid.diagnosis.testing.lack_of_fit import Row
from physid.diagnosis.testing.null_tails import together
from physid.diagnosis.testing.score_test import Conditional, Group
from physid.effects import CATALOGUE

STRENGTH = 100.0  # squared residual that a typical size makes
NAMES = ("viscous_drag", "tether", "adhesion")  # two of the dynamics, one of contact


def found(*sizes: float) -> Attribution:
    """Return a search that named nothing; of each effect (all are orthogonal) the data want so many typical sizes."""
    one, count = torch.ones(1, dtype=torch.float64), len(NAMES)
    groups = [Group((name,), torch.tensor([k]), one, one, -one, one) for k, name in enumerate(NAMES)]
    wanted = torch.tensor(sizes, dtype=torch.float64)[:, None]
    conditional = Conditional(
        STRENGTH * torch.eye(count, dtype=torch.float64), STRENGTH * wanted, *3 * [torch.zeros(0)]
    )
    rows = [
        Row((name,), STRENGTH * size**2, STRENGTH * size**2, one, one, together([]), together([]), 0.0)
        for name, size in zip(NAMES, sizes, strict=True)
    ]
    lack = SimpleNamespace(groups=groups, conditional=conditional, rows=rows)
    predictor = SimpleNamespace(candidates=CATALOGUE)
    experiment = SimpleNamespace(predictor=predictor)
    nominal = SimpleNamespace(experiment=experiment, held_out=torch.zeros(1), settings=Settings())
    return Attribution(cast(Any, nominal), cast(Any, lack), [], None, None, [])


def test_two_effects_of_one_site_outweigh_a_stronger_one_of_another_where_nothing_is_named() -> None:
    shares = sites(found(0.9, 0.9, 1.0), named=False)
    assert shares["dynamics"] > 0.8 > shares["contact"]
    assert sites(found(0.9, 0.9, 1.0), named=True)["contact"] > 0.9


def test_without_a_name_sizes_beyond_the_ranges_count() -> None:
    shares = sites(found(3.0, 0.0, 2.0), named=False)
    assert shares["dynamics"] > shares["contact"]


def test_shares_make_up_a_whole_and_sites_without_effects_have_none() -> None:
    shares = sites(found(1.0, 0.0, 1.0), named=False)
    assert abs(sum(shares.values()) - 1) < 1e-3
    assert shares["perception"] == shares["actuation"] == 0


def test_evidence_over_time_is_that_of_one_body_and_no_rounding() -> None:
    places = ((0, "y", 0), (0, "x", 1), (1, "x", 0), (0, "x", 0), (0, "x", None))
    cells = [SimpleNamespace(body=body, dof=dof, piece=piece) for body, dof, piece in places]
    gain = torch.tensor([[4.0, 5.0], [9.0, 7.0], [16.0, 3.0], [1e-9, 1.0], [25.0, 1.0]], dtype=torch.float64)
    lack = SimpleNamespace(cells=cells, cell_gain=gain, counted=torch.tensor([True, False]))
    table, dofs = over_time(lack, 0, rounding=1e-6)
    assert dofs == ["x", "y"]
    assert table.tolist() == [[0.0, 3.0], [2.0, 0.0]]


def test_what_was_tried_explains_all_that_it_gains_over_trajectories() -> None:
    """Three trajectories that a tried effect predicts better by 33 each count as a row of 99, not of 33."""
    search = found(1.0, 0.0, 1.0)
    nominal = SimpleNamespace(**vars(search.nominal) | {"held_out": torch.full((3,), 100.0)})
    tried = SimpleNamespace(names=("adhesion",), held_out=torch.full((3,), 67.0))
    shares = sites(replace(search, nominal=cast(Any, nominal), tried=[cast(Any, tried)]), named=True)
    assert shares == sites(found(1.0, 0.0, math.sqrt(0.99)), named=True)
    assert 0.1 < shares["contact"] < 0.5


def test_effects_of_two_sites_share_what_they_explain_together() -> None:
    search = found(3.0, 0.0, 0.0)  # the drag alone explains as much as with the other
    nominal = SimpleNamespace(**vars(search.nominal) | {"held_out": torch.full((3,), 300.0)})
    tried = SimpleNamespace(names=("viscous_drag", "adhesion"), held_out=torch.zeros(3))
    shares = sites(replace(search, nominal=cast(Any, nominal), tried=[cast(Any, tried)]), named=True)
    assert (shares["dynamics"], shares["contact"]) == pytest.approx((0.75, 0.25))


@pytest.mark.parametrize("strength", [1.0, 30.0])  # below and above what the least temperature belongs to
def test_an_explanation_that_falls_behind_weighs_less_by_the_temperature_of_the_best(strength: float) -> None:
    settings = Settings().localisation
    best, behind = STRENGTH * strength**2, STRENGTH * (0.97 * strength) ** 2
    shares = sites(found(strength, 0.0, 0.97 * strength), named=True)
    temperature = max(settings.least, settings.named * best)
    ratio = math.exp((behind - best) / (2 * temperature))
    nothing = math.exp(-best / (2 * temperature))  # the tether, which explains nothing
    assert shares["contact"] == pytest.approx(ratio / (1 + ratio + nothing), abs=2e-4)
