"""Fits to segments around impacts: what segments that no initial state explains still say."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from physid.estimation.least_squares import Normal
from physid.estimation.prediction import Segmentation
from physid.estimation.segmented_fit import AgreementSettings, agreed_weights, own_weights, usual_misfit

SEGMENTS = Segmentation(
    1, 40, torch.zeros(4, dtype=torch.int64), torch.arange(0, 40, 10), torch.full((4,), 10),
    torch.tensor([True, True, True, False]), torch.tensor([False, True, True, False]),
)  # fmt: skip


def test_a_doubtful_segment_counts_as_if_its_noise_were_its_misfit_and_no_other_counts_less() -> None:
    misfit = torch.tensor([0.8, 2.0, 8.0, 100.0], dtype=torch.float64)
    assert usual_misfit(SEGMENTS, misfit) == 2.0  # the median of those in contact
    assert own_weights(misfit, usual_misfit(SEGMENTS, misfit), SEGMENTS.contact).tolist() == [1.0, 1.0, 0.25, 1.0]
    assert own_weights(misfit, misfit[1], torch.zeros(4, dtype=torch.bool)).tolist() == [1.0] * 4


def test_segments_that_noise_explains_set_no_standard_below_noise() -> None:
    assert usual_misfit(SEGMENTS, torch.tensor([0.1, 0.2, 0.3, 5.0])) == 1.0
    assert usual_misfit(SEGMENTS.only(torch.tensor([3])), torch.tensor([5.0])) == 1.0


def stated(values: Tensor, deviation: Tensor) -> Normal:
    """Return normal equations of K trajectories that say values (K, P), each known to a deviation (K, P)."""
    matrix = torch.diag_embed(deviation**-2)
    vector = (matrix @ values[..., None])[..., 0]
    return Normal(matrix, vector, (values * vector).sum(-1) + 100)


def best(normal: Normal, weight: Tensor) -> Tensor:
    return torch.linalg.solve((weight[:, None, None] * normal.matrix).sum(0), (weight[:, None] * normal.vector).sum(0))


def test_trajectories_that_agree_within_noise_all_count_alike() -> None:
    """Of a hundred sets in which nothing but noise is at work at most a few are taken for others."""
    torch.manual_seed(0)
    deviation = 10 ** torch.empty(100, 12, 2, dtype=torch.float64).uniform_(-3, -1)  # some know a hundred times as much
    values = deviation * torch.randn_like(deviation)
    alike = [
        bool((agreed_weights(stated(*one), AgreementSettings()) == 1).all())
        for one in zip(values, deviation, strict=True)
    ]
    assert sum(alike) >= 97


def test_one_that_claims_much_and_contradicts_the_others_counts_as_little_as_they_agree_on() -> None:
    torch.manual_seed(1)
    deviation = torch.full((12, 1), 1e-2, dtype=torch.float64)
    values = deviation * torch.randn_like(deviation)
    deviation[5], values[5] = 1e-5, 0.06
    normal = stated(values, deviation)
    assert float(best(normal, torch.ones(12).double())) == pytest.approx(0.06, abs=1e-4)
    weight = agreed_weights(normal, AgreementSettings())
    assert float(weight[5]) < 1e-5
    assert float(weight[torch.arange(12) != 5].min()) > 0.1
    assert abs(float(best(normal, weight))) < 0.02
    assert torch.equal(agreed_weights(normal, AgreementSettings(chance=0)), torch.ones(12).double())


def test_deviations_of_the_trajectories_own_are_found_parameter_by_parameter() -> None:
    """The largest restricted likelihood of many trajectories is near the deviation that they were drawn with."""
    torch.manual_seed(2)
    count, own = 400, torch.tensor([0.03, 0.0], dtype=torch.float64)
    deviation = torch.full((count, 2), 1e-2, dtype=torch.float64)
    values = deviation * torch.randn_like(deviation) + own * torch.randn_like(deviation)
    weight = agreed_weights(stated(values, deviation), AgreementSettings())
    assert weight.mean() == pytest.approx(1 / (1 + (0.03 / 0.01) ** 2), rel=0.3)
    swapped = agreed_weights(stated(values.flip(1), deviation), AgreementSettings())
    assert torch.allclose(weight, swapped)


def test_a_parameter_of_which_nothing_is_known_changes_no_weight() -> None:
    torch.manual_seed(3)
    deviation = torch.full((8, 1), 1e-2, dtype=torch.float64)
    values = 5 * deviation * torch.randn_like(deviation)
    known = stated(values, deviation)
    beside = stated(torch.cat([values, 0 * values], 1), torch.cat([deviation, math.inf * deviation], 1))
    assert torch.equal(agreed_weights(known, AgreementSettings()), agreed_weights(beside, AgreementSettings()))
    nothing = known.select(torch.zeros(1, dtype=torch.bool))
    assert agreed_weights(nothing, AgreementSettings()).tolist() == [1.0] * 8


def test_parameters_of_which_only_the_sum_is_known_are_weighed_by_the_sum() -> None:
    torch.manual_seed(4)
    deviation = torch.full((12, 1), 1e-2, dtype=torch.float64)
    values = deviation * torch.randn_like(deviation)
    deviation[5], values[5] = 1e-6, 0.06
    one, both = stated(values, deviation), torch.ones(1, 2, dtype=torch.float64)
    summed = Normal(both.mT @ one.matrix @ both, one.vector @ both, one.square)
    weight = agreed_weights(summed, AgreementSettings())
    assert bool(weight.isfinite().all())
    assert float(weight[5]) < 1e-5 * float(weight[torch.arange(12) != 5].min())


@pytest.mark.parametrize("known", [1e16, 1e22])
def test_a_slope_without_bounds_gives_a_weight_and_no_number_that_is_none(known: float) -> None:
    torch.manual_seed(5)
    deviation = torch.full((12, 2), 1e-2, dtype=torch.float64)
    values = deviation * torch.randn_like(deviation)
    deviation[3], values[3, 0] = known**-0.5, 0.08
    weight = agreed_weights(stated(values, deviation), AgreementSettings())
    assert bool(weight.isfinite().all())
    assert float(weight[3]) < 1e-5 * float(weight[torch.arange(12) != 3].min())
