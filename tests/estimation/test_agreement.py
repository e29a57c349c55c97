"""How much trajectories count that disagree: closed forms and the likelihood written out, where they are known."""

from __future__ import annotations

import math

import pytest
import torch
from scipy.stats import chi2
from torch import Tensor

from physid.estimation.least_squares import Normal
from physid.estimation.segmented_fit import AgreementSettings, agreed_weights, own_weights

FINE = AgreementSettings(tries=4000)
COUNT, KNOWN = 9, 1e4  # trajectories, and what each knows: one over its variance


def stated(values: Tensor, known: Tensor) -> Normal:
    """Return normal equations of K trajectories that say values (K, P), with curvatures (K, P, P)."""
    vector = (known @ values[..., None])[..., 0]
    return Normal(known, vector, (values * vector).sum(-1) + 3.0)


def spread_by(ratio: float, columns: int = 1) -> Tensor:
    """Return values (K, P) around 0.2 whose sample variance is so many times that of noise."""
    values = torch.randn(COUNT, columns, generator=torch.Generator().manual_seed(1)).double()
    values = values - values.mean(0)
    values, _ = torch.linalg.qr(values)  # several parameters whose values are uncorrelated
    return 0.2 + values * (ratio * (COUNT - 1) / KNOWN) ** 0.5


def alike(columns: int = 1) -> Tensor:
    return KNOWN * torch.eye(columns).double().expand(COUNT, columns, columns)


@pytest.mark.parametrize("ratio", [5.0, 30.0, 2000.0])
@pytest.mark.parametrize("columns", [1, 2])
def test_trajectories_that_know_alike_count_by_the_variance_of_noise_over_that_of_their_values(
    ratio: float, columns: int
) -> None:
    """The restricted likelihood is largest where both variances add up to the sample's: w = 1 / (a s^2)."""
    values = spread_by(ratio, columns)
    if columns == 2:
        values[:, 1] = 0.2  # all agree on the other one, and on it nothing is lost
    weight = agreed_weights(stated(values, alike(columns)), FINE)
    assert weight.tolist() == pytest.approx([1 / ratio] * COUNT, rel=5e-3)


@pytest.mark.parametrize("columns", [1, 2])
@pytest.mark.parametrize("chance", [1e-3, 0.05])
@pytest.mark.parametrize(("factor", "counts_less"), [(0.97, False), (1.03, True)])
def test_a_disagreement_counts_from_an_improbable_ratio_of_likelihoods_on(
    columns: int, chance: float, factor: float, counts_less: bool
) -> None:
    """Of P parameters it is P (n - 1) (r - 1 - ln r) for a variance that is r times that of noise."""
    limit, low, high = chi2.isf(chance, columns) / (columns * (COUNT - 1)), 1.0, 50.0
    for _ in range(60):
        ratio = (low + high) / 2
        low, high = (ratio, high) if ratio - 1 - math.log(ratio) < factor * limit else (low, ratio)
    weight = agreed_weights(
        stated(spread_by(ratio, columns), alike(columns)), FINE.model_copy(update={"chance": chance})
    )
    assert bool((weight < 1).all()) is counts_less
    assert weight.tolist() == pytest.approx([1 / ratio if counts_less else 1.0] * COUNT, rel=5e-3)


@pytest.mark.parametrize("seed", range(3))
def test_of_trajectories_that_know_different_things_the_likelihood_written_out_is_the_largest(seed: int) -> None:
    """Of values y with variances v = 1 / a + t^2 it is sum ln v + sum (y - m)^2 / v + ln sum 1 / v, m their mean."""
    generator = torch.Generator().manual_seed(seed)
    own = 10 ** (3 * torch.rand(COUNT, generator=generator).double() - 4)
    values = 0.3 + (own.square() + 0.02**2).sqrt() * torch.randn(COUNT, generator=generator).double()
    settings = AgreementSettings(chance=0.99, tries=400)
    tried = torch.logspace(*settings.deviations, settings.tries).double()
    variance = own.square() + tried[:, None].square()
    mean = (values / variance).sum(1) / (1 / variance).sum(1)
    square = ((values - mean[:, None]).square() / variance).sum(1)
    unlikely = variance.log().sum(1) + square + (1 / variance).sum(1).log()
    best = tried[unlikely.argmin()]
    weight = agreed_weights(stated(values[:, None], own[:, None, None] ** -2), settings)
    assert weight.tolist() == pytest.approx((1 / (1 + (best / own).square())).tolist(), rel=1e-6)


def test_the_unit_of_what_is_explained_in_all_alike_and_the_order_of_trajectories_do_not_matter() -> None:
    generator = torch.Generator().manual_seed(5)
    rows = torch.randn(COUNT, 4, 2, generator=generator).double() * 30
    values, known = 0.2 + 0.3 * torch.randn(COUNT, 2, generator=generator).double(), rows.mT @ rows
    one = stated(values, known)
    weight = agreed_weights(one, FINE)
    assert bool((weight < 0.9).any())
    more = Normal(one.matrix, one.vector, one.square + 1e3)
    assert torch.allclose(agreed_weights(more, FINE), weight)
    turned = Normal(*(part.flip(0) for part in (one.matrix, one.vector, one.square)))
    assert torch.allclose(agreed_weights(turned, FINE).flip(0), weight)
    moved = stated(values + torch.tensor([5.0, -7.0]), known)
    assert torch.allclose(agreed_weights(moved, FINE), weight, rtol=1e-4)


def test_a_doubtful_segment_that_fits_better_than_usual_counts_as_one_and_none_divides_by_nothing() -> None:
    misfit, usual = torch.tensor([0.0, 1.0, 2.0, 4.0]).double(), torch.tensor(2.0).double()
    assert own_weights(misfit, usual, torch.ones(4, dtype=torch.bool)).tolist() == [1.0, 1.0, 1.0, 0.5]
