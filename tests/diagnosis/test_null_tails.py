"""How far gains reach by chance: the law of chi-squared, whatever the number of parameters."""

from __future__ import annotations

import pytest
import torch

from physid.diagnosis.testing.null_tails import Tail, together

RARE = {1: 10.83, 2: 13.82, 3: 16.27}  # chi-squared that is exceeded once in a thousand, by degrees of freedom
DEVIATION = 3.09  # the same of a normal variable


def chi_squared(degrees: int) -> Tail:
    return Tail(torch.tensor(float(degrees)), torch.tensor(2.0 * degrees))


@pytest.mark.parametrize("degrees", RARE)
def test_a_rare_gain_deviates_alike_for_any_number_of_parameters(degrees: int) -> None:
    assert float(chi_squared(degrees).deviation(RARE[degrees])) == pytest.approx(DEVIATION, abs=0.15)


@pytest.mark.parametrize("tail", [chi_squared(1), chi_squared(3), Tail(torch.tensor(4.0), torch.tensor(90.0))])
def test_gain_undoes_deviation(tail: Tail) -> None:
    gains = torch.tensor([4.0, 20.0, 300.0])
    assert torch.allclose(tail.gain(tail.deviation(gains)), gains, rtol=1e-4)


def test_a_tail_is_that_of_the_draws_and_at_least_that_of_chance_without_impacts() -> None:
    generator = torch.Generator().manual_seed(0)
    normal = torch.randn(2, 4000, 3, generator=generator, dtype=torch.float64)
    three, nothing = normal[0].square().sum(-1), 1e-3 * normal[1, :, 0].square()
    tail = Tail.of(torch.stack([three, nothing]))
    assert tail.mean.tolist() == pytest.approx([3, 1], rel=0.05)
    assert tail.variance.tolist() == pytest.approx([6, 2], rel=0.1)


def test_each_of_many_gains_has_the_tail_of_its_own_draws() -> None:
    draws = torch.randn(2, 3, 4000, generator=torch.Generator().manual_seed(1)).double().square() * 5
    tail = Tail.of(draws)
    for row, place in ((0, 2), (1, 0)):
        alone = Tail.of(draws[row, place])
        assert float(tail.mean[row, place]) == pytest.approx(float(alone.mean))
        assert float(tail.variance[row, place]) == pytest.approx(float(alone.variance))


def test_impacts_that_let_an_effect_gain_much_by_chance_make_the_same_gain_common() -> None:
    impacts = Tail(torch.tensor(3.0), torch.tensor(60.0))
    assert float(impacts.deviation(30.0)) < 2.5 < float(chi_squared(3).deviation(30.0))


def test_two_effects_gain_together_what_chi_squared_of_all_their_parameters_gains() -> None:
    both = together([chi_squared(1), chi_squared(2)])
    assert float(both.gain(DEVIATION)) == pytest.approx(RARE[3], rel=0.05)
    assert float(together([]).gain(DEVIATION)) == pytest.approx(RARE[1], rel=0.1)
