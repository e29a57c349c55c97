"""The score test against closed forms: what one column explains, with and without nuisances."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest
import torch

from physid.diagnosis.reference.null_simulations import p_value
from physid.diagnosis.settings.testing import ScoreTestSettings
from physid.diagnosis.testing.score_test import Conditional, Group, condition, gains, groups_of, signals, steady_gains
from physid.estimation.least_squares.normal_equations import Normal
from physid.physics import Quantity

ONE = torch.ones(1, dtype=torch.float64)
NO_NUISANCE = (torch.zeros(0, dtype=torch.int64), *2 * [torch.zeros(0, 1, dtype=torch.float64)])
SETTINGS = ScoreTestSettings()
NO_RIDGE = torch.zeros(1, dtype=torch.float64)


def normal(columns: torch.Tensor, data: torch.Tensor) -> Normal:
    """Return the normal equations of columns (M, P) and data (M,), as one trajectory."""
    return Normal((columns.T @ columns)[None], (columns.T @ data)[None], data.square().sum()[None])


def group(column: int, low: float = -1e9, high: float = 1e9, largest: float = 10.0) -> Group:
    limits = (torch.tensor([each], dtype=torch.float64) for each in (low, high))
    return Group(("effect",), torch.tensor([column]), ONE, largest * ONE, *limits)


def drawn(count: int) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(count)
    return torch.randn(50, count, generator=generator).double() * 3, torch.randn(50, generator=generator).double()


def test_one_column_explains_its_projection() -> None:
    columns, data = drawn(1)
    equations = normal(columns, data)
    gain, change = gains(
        Conditional(equations.matrix[0], equations.vector[0][:, None], *NO_NUISANCE), group(0), SETTINGS
    )
    best = float(columns[:, 0] @ data / columns[:, 0].square().sum())
    assert float(change) == pytest.approx(best)
    assert float(gain) == pytest.approx(best**2 * float(columns[:, 0].square().sum()))


def test_two_columns_explain_their_common_projection() -> None:
    columns, data = drawn(2)
    columns[:, 1] += columns[:, 0]
    equations, many = normal(columns, data), 1e9 * torch.ones(2, dtype=torch.float64)
    both = Group(("effect",), torch.tensor([0, 1]), torch.ones(2).double(), 10 * torch.ones(2).double(), -many, many)
    gain, change = gains(Conditional(equations.matrix[0], equations.vector[0][:, None], *NO_NUISANCE), both, SETTINGS)
    best = torch.linalg.lstsq(columns, data[:, None]).solution[:, 0]
    assert torch.allclose(change.flatten(), best)
    assert float(gain) == pytest.approx(float((columns @ best).square().sum()))


def test_beside_a_nuisance_only_what_is_orthogonal_to_it_counts() -> None:
    columns, data = drawn(2)
    clean = columns[:, 1] - columns[:, 0] * (columns[:, 0] @ columns[:, 1] / columns[:, 0].square().sum())
    given = condition(normal(columns, data), torch.tensor([0]), NO_RIDGE)
    gain, _ = gains(given, group(1), SETTINGS)
    assert float(gain) == pytest.approx(float((clean @ data) ** 2 / clean.square().sum()))


def test_a_column_that_the_nuisance_absorbs_explains_nothing() -> None:
    columns, data = drawn(1)
    given = condition(normal(torch.cat([columns, 2 * columns], 1), data), torch.tensor([0]), NO_RIDGE)
    assert float(gains(given, group(1), SETTINGS)[0]) == 0


@pytest.mark.parametrize("visible", [0.5, 1.0, 3.0])
def test_a_direction_counts_from_the_largest_size_that_its_range_admits(visible: float) -> None:
    """However small an effect is in practice, what the recordings demand may be many times as large."""
    columns, _ = drawn(1)
    faint = 0.5 * columns / columns.norm()
    equations = normal(faint, 6 * faint[:, 0])
    given = Conditional(equations.matrix[0], equations.vector[0][:, None], *NO_NUISANCE)
    settings = ScoreTestSettings(visible=visible)
    seen, unseen = (gains(given, group(0, largest=visible * largest), settings) for largest in (2.1, 1.9))
    assert [float(each) for each in seen] == pytest.approx([0.25 * 6**2, 6.0])
    assert [float(each) for each in unseen] == [0, 0]


def test_what_is_seen_gains_the_same_however_little_is_asked_for_to_see_it() -> None:
    columns, _ = drawn(1)
    faint = 0.5 * columns / columns.norm()
    equations = normal(faint, 6 * faint[:, 0])
    given = Conditional(equations.matrix[0], equations.vector[0][:, None], *NO_NUISANCE)
    for visible, largest in ((1.0, 2.1), (0.1, 2.1), (0.1, 0.3), (0.01, 0.03)):
        found = gains(given, group(0, largest=largest), ScoreTestSettings(visible=visible))
        assert [float(each) for each in found] == pytest.approx([0.25 * 6**2, 6.0])


def test_sizes_of_an_effect_count_from_none_of_it_and_its_range_from_the_present_values() -> None:
    gain, drift = (
        Quantity("-", low=0.5, high=2.0, typical=1.2, null=1.0),
        Quantity("-", low=-3.0, high=4.0, typical=-0.5),
    )
    lens, drag = SimpleNamespace(name="lens"), SimpleNamespace(name="drag")
    terms: list[Any] = [
        SimpleNamespace(effect=effect, quantity=known) for effect, known in ((lens, gain), (drag, drift), (lens, drift))
    ]
    found = groups_of(terms, 3, torch.tensor([1.5, 0.25, 1.0], dtype=torch.float64))
    expected = {
        "lens": ([3, 5], [0.2, -0.5], [1.0, 4.0], [-1.0, -4.0], [0.5, 3.0]),
        "drag": ([4], [-0.5], [4.0], [-3.25], [3.75]),
    }
    assert [one.names for one in found] == [(name,) for name in expected]
    for one, sizes in zip(found, expected.values(), strict=True):
        for each, size in zip((one.columns, one.typical, one.largest, one.low, one.high), sizes, strict=True):
            assert each.tolist() == pytest.approx(size)


def test_a_range_without_an_end_ends_at_a_thousand_typical_sizes() -> None:
    assert Quantity("N", low=-math.inf, high=math.inf, typical=0.5).largest == 500
    assert Quantity("N", low=-2.0, high=1.0, typical=0.5, null=0.25).largest == 2.25


def test_a_change_stays_in_its_range() -> None:
    columns, _ = drawn(1)
    equations = normal(columns, 5 * columns[:, 0])
    given = Conditional(equations.matrix[0], equations.vector[0][:, None], *NO_NUISANCE)
    gain, change = gains(given, group(0, low=0.0, high=2.0), SETTINGS)
    assert float(change) == pytest.approx(2.0)
    assert float(gain) == pytest.approx((2 * 5 * 2 - 2**2) * float(columns.square().sum()))


def test_the_p_value_counts_and_is_never_zero() -> None:
    null = torch.arange(99.0)
    assert p_value(1e9, null) == pytest.approx(0.01)
    assert p_value(-1.0, null) == 1.0
    assert p_value(50.0, null) == pytest.approx((1 + 49) / 100)


def impacts(columns: torch.Tensor, data: torch.Tensor, count: int = 5) -> Normal:
    """Return the normal equations of as many equal parts of the data as there shall be impacts."""
    rows, values = columns.unflatten(0, (count, -1)), data.unflatten(0, (count, -1))[..., None]
    return Normal(rows.mT @ rows, rows.mT @ values, values.square().sum(1))


@pytest.mark.parametrize("nuisances", [1, 2])
def test_what_is_steady_is_what_a_test_without_the_most_informative_impact_finds(nuisances: int) -> None:
    columns, data = drawn(1 + nuisances)
    shown = torch.tensor([0.1, 0.1, 2.0, 0.1, 0.1], dtype=torch.float64).repeat_interleave(10)
    data = data + columns[:, -1] * shown + 3 * columns[:, 0]
    given = condition(normal(columns, data), torch.arange(nuisances), NO_RIDGE.expand(nuisances))
    clean = columns[:, -1] - columns[:, :nuisances] @ given.absorbed[:, -1]
    left = data - columns[:, :nuisances] @ given.solved[:, 0]
    others = torch.cat([torch.arange(20), torch.arange(30, 50)])
    expected = float((clean[others] @ left[others]) ** 2 / clean[others].square().sum())
    steady = float(steady_gains(given, group(nuisances), impacts(columns, data), SETTINGS))
    assert steady == pytest.approx(expected)
    assert steady < 0.2 * float(gains(given, group(nuisances), SETTINGS)[0])


def test_the_impact_that_is_left_out_says_most_for_the_change_of_all_and_is_not_the_loudest() -> None:
    """Of a change of 1 the first would gain 2 x 5.5 - 10 = 1, the second 2 x 2 - 1 = 3, the others 1 each."""
    column = torch.tensor([10**0.5, 1.0, *7 * [0.01]], dtype=torch.float64)[:, None]
    data = torch.tensor([5.5 / 10**0.5, 2.0, *7 * [50.0]], dtype=torch.float64)
    equations = normal(column, data)
    given = Conditional(equations.matrix[0], equations.vector[0][:, None], *NO_NUISANCE)
    steady = float(steady_gains(given, group(0), impacts(column, data, 9), SETTINGS))
    assert float(gains(given, group(0), SETTINGS)[0]) == pytest.approx(11, rel=1e-3)
    assert steady == pytest.approx((11 - 2) ** 2 / (11 - 1), rel=1e-3)


def test_without_impacts_and_for_what_all_impacts_show_alike_nearly_all_is_steady() -> None:
    columns, _ = drawn(1)
    data = 2 * columns[:, 0]
    equations = normal(columns, data)
    given = Conditional(equations.matrix[0], equations.vector[0][:, None], *NO_NUISANCE)
    whole = float(gains(given, group(0), SETTINGS)[0])
    none = Normal(torch.zeros(0, 1, 1), torch.zeros(0, 1, 1), torch.zeros(0, 1))
    assert float(steady_gains(given, group(0), none, SETTINGS)) == whole
    assert float(steady_gains(given, group(0), impacts(columns, data), SETTINGS)) > 0.5 * whole


def test_a_change_of_the_nuisance_leaves_what_is_steady() -> None:
    columns, data = drawn(2)
    nuisance = torch.tensor([0])
    steady = [
        float(
            steady_gains(
                condition(normal(columns, moved), nuisance, NO_RIDGE), group(1), impacts(columns, moved), SETTINGS
            )
        )
        for moved in (data, data + 7 * columns[:, 0])
    ]
    assert steady[0] == pytest.approx(steady[1])


def test_it_does_not_matter_how_the_data_are_split_into_trajectories() -> None:
    columns, data = drawn(3)
    nuisance = torch.tensor([0])
    ridge = torch.ones(1, dtype=torch.float64)
    whole, split = (condition(each, nuisance, ridge) for each in (normal(columns, data), impacts(columns, data)))
    for one, other in ((whole.matrix, split.matrix), (whole.vector, split.vector), (whole.solved, split.solved)):
        assert torch.allclose(one, other, atol=1e-9)


def test_the_signal_of_each_parameter_is_what_data_made_by_it_alone_at_its_typical_size_gain_steadily() -> None:
    columns, _ = drawn(4)
    nuisance, ridge = torch.arange(2), torch.zeros(2, dtype=torch.float64)
    typical = torch.tensor([0.3, 2.0], dtype=torch.float64)
    most = torch.full((2,), 1e9, dtype=torch.float64)
    both = Group(("effect",), torch.tensor([2, 3]), typical, 10 * typical, -most, most)
    made = [columns[:, 2 + k] * typical[k] for k in range(2)]
    found = signals(condition(normal(columns, 0 * made[0]), nuisance, ridge), both, impacts(columns, made[0]), SETTINGS)
    for signal, data in zip(found.tolist(), made, strict=True):
        given = condition(normal(columns, data), nuisance, ridge)
        assert signal == pytest.approx(float(steady_gains(given, both, impacts(columns, data), SETTINGS)))
        assert signal > 0
