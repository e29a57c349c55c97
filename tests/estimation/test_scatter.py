"""Covariances: what leaving out changes, what white noise makes of the scatter, and units that do not matter."""

from __future__ import annotations

import math

import pytest
import torch
from scipy.stats import norm
from torch import Tensor

from physid.estimation.least_squares.covariance import (
    covariance_of,
    inflation,
    left_out,
    predictive_score,
    quantile,
    reach_of,
    scatter_of,
)
from physid.estimation.least_squares.normal_equations import Normal
from physid.estimation.least_squares.settings import IntervalSettings

ROWS, VALUES, COLUMNS = 5, 8, 2
RIDGE = torch.tensor([0.3, 0.1], dtype=torch.float64)


def drawn(rows: int = ROWS, seed: int = 0) -> tuple[Tensor, Tensor]:
    """Return columns (R, M, P) of trajectories that know different things, and data (R, M)."""
    generator = torch.Generator().manual_seed(seed)
    columns = torch.randn(rows, VALUES, COLUMNS, generator=generator, dtype=torch.float64)
    columns = columns * torch.linspace(0.5, 2.0, rows, dtype=torch.float64)[:, None, None]
    return columns, torch.randn(rows, VALUES, generator=generator, dtype=torch.float64)


def normal_of(columns: Tensor, data: Tensor) -> Normal:
    return Normal(columns.mT @ columns, (columns.mT @ data[..., None])[..., 0], data.square().sum(1))


def ridged(columns: Tensor, data: Tensor, ridge: Tensor) -> Tensor:
    """Return the least squares of rows (n, P) and data (n,) beside a ridge, by its own rows."""
    rows = torch.cat([columns, torch.diag(ridge.sqrt())])
    return torch.linalg.lstsq(rows, torch.cat([data, torch.zeros(len(ridge)).to(data)])[:, None]).solution[:, 0]


@pytest.mark.parametrize("held", [[], [1, 4]])
def test_a_trajectory_is_left_out_of_the_fit_and_predicted_by_what_the_others_say(held: list[int]) -> None:
    columns, data = drawn()
    fitted = torch.ones(ROWS, dtype=torch.bool)
    fitted[held] = False
    normal = normal_of(columns, data).solved(torch.zeros(COLUMNS).double())
    # At the fit of the fitted ones, from which changes count.
    best = ridged(columns[fitted].flatten(0, 1), data[fitted].flatten(), 0 * RIDGE)
    left = data - (columns @ best[:, None])[..., 0]
    normal = normal_of(columns, left)
    changes, scores = left_out(normal, fitted, RIDGE), predictive_score(normal, fitted, RIDGE)
    for k in range(ROWS):
        others = fitted.clone()
        others[k] = False
        change = ridged(columns[others].flatten(0, 1), left[others].flatten(), RIDGE) if fitted[k] else 0 * RIDGE
        assert torch.allclose(changes[k], change, atol=1e-9)
        known = (columns[others].mT @ columns[others]).sum(0) + torch.diag(RIDGE)
        root = torch.linalg.cholesky(known).mT
        rest = left[k] - columns[k] @ change
        rows = torch.cat([columns[k], root])
        follow = torch.linalg.lstsq(rows, torch.cat([rest, torch.zeros(COLUMNS).double()])[:, None]).solution[:, 0]
        least = (rest - columns[k] @ follow).square().sum() + (root @ follow).square().sum()
        volume = torch.eye(COLUMNS).double() + torch.linalg.solve(known, columns[k].mT @ columns[k])
        assert float(scores[k]) == pytest.approx(float(least + torch.linalg.slogdet(volume).logabsdet))


def test_of_white_residuals_the_scatter_is_right_on_average_and_has_the_degrees_of_freedom_of_its_own_variance() -> (
    None
):
    """It is a quadratic form r Q r of the data: of white ones its mean is tr Q, and its variance 2 tr Q^2."""
    columns, _ = drawn(4)
    nothing = torch.zeros(COLUMNS).double()

    def scatter(data: Tensor) -> Tensor:
        best = ridged(columns.flatten(0, 1), data.flatten(), 0 * RIDGE)
        left = data - (columns @ best[:, None])[..., 0]
        return scatter_of(normal_of(columns, left), nothing)[0].diagonal()

    units = torch.eye(4 * VALUES, dtype=torch.float64).unflatten(1, (4, VALUES))
    alone = torch.stack([scatter(one) for one in units])
    total = (columns.mT @ columns).sum(0)
    least = torch.linalg.inv(total).diagonal()
    _, freedom, shown = scatter_of(normal_of(columns, 0 * units[0]), nothing)
    assert torch.allclose(alone.sum(0), least), "no trajectory is alone with a parameter"
    assert torch.allclose(shown, torch.ones_like(shown))
    pairs = torch.stack([torch.stack([scatter(one + other) for other in units]) for one in units])
    form = (pairs - alone[None] - alone[:, None]) / 2
    form[range(len(units)), range(len(units))] = alone
    assert torch.allclose(freedom, least.square() / form.square().sum((0, 1)))
    assert bool(((freedom > 1) & (freedom < 3)).all()), "of four trajectories that know different things"


def test_the_unit_of_a_parameter_and_the_order_of_trajectories_do_not_matter() -> None:
    columns, data = drawn()
    unit = torch.tensor([1e-3, 50.0], dtype=torch.float64)
    one = covariance_of(normal_of(columns, data).solved(RIDGE), RIDGE)
    ridge = RIDGE * unit.square()
    other = covariance_of(normal_of((columns * unit).flip(0), data.flip(0)).solved(ridge), ridge)
    assert torch.allclose(other * torch.outer(unit, unit), one, rtol=1e-5)
    assert torch.allclose(one, one.mT)
    assert bool((torch.linalg.eigvalsh(one) > 0).all())


@pytest.mark.parametrize("noise", [1e-3, 7.0])
def test_intervals_are_as_wide_as_the_noise_that_is_known_and_that_shows(noise: float) -> None:
    columns, data = drawn()
    none, least = 0 * RIDGE, torch.linalg.inv((columns.mT @ columns).sum(0)).diagonal()
    one = covariance_of(normal_of(columns, data).solved(none), none, least)
    noisy = covariance_of(normal_of(columns, noise * data).solved(none), none, noise**2 * least)
    assert torch.allclose(noisy, noise**2 * one, rtol=1e-5)


def test_many_trajectories_of_white_noise_are_as_sure_as_their_curvature() -> None:
    columns, data = drawn(400, seed=1)
    normal = normal_of(columns, data).solved(0 * RIDGE)
    found, expected = covariance_of(normal, 0 * RIDGE), torch.linalg.inv(normal.matrix.sum(0))
    assert torch.allclose(found.diagonal(), expected.diagonal(), rtol=0.1)
    scatter, freedom, shown = scatter_of(normal, 0 * RIDGE)
    assert torch.allclose(scatter, expected, rtol=0.3, atol=float(expected.diagonal().max()) * 0.2)
    assert float(freedom.min()) > 100
    assert torch.allclose(shown, torch.ones_like(shown))
    correlation = found[0, 1] / (found[0, 0] * found[1, 1]).sqrt()
    assert float(correlation) == pytest.approx(float(scatter[0, 1] / (scatter[0, 0] * scatter[1, 1]).sqrt()))


def test_far_beyond_white_noise_the_scatter_alone_counts() -> None:
    """A scatter of 1e8 variances of white noise is as sure as if the noise were larger, up to the largest ratio."""
    columns, data = drawn()
    none, settings = 0 * RIDGE, IntervalSettings()
    normal = normal_of(columns, data).solved(none)
    scatter, freedom, shown = scatter_of(normal, none)
    least = scatter.diagonal() / (100 * settings.largest)
    found = covariance_of(normal, none, least).diagonal()
    ratio = torch.full_like(least, settings.largest)
    expected = (scatter.diagonal() + (1 - shown) * least) / settings.largest * inflation(ratio, freedom)
    assert torch.allclose(found, expected, rtol=1e-4)
    assert torch.allclose(found, covariance_of(normal, none, 1e-3 * least).diagonal(), rtol=1e-3)


def test_more_scatter_and_fewer_degrees_of_freedom_make_wider_intervals_but_never_narrower_than_white_noise() -> None:
    ratio, freedom = torch.logspace(-3, 6, 19).double(), torch.full((19,), 4.0).double()
    found = inflation(ratio, freedom)
    assert bool(found.diff().gt(0).all())
    assert float(found[0]) >= 1
    assert bool((inflation(10 * ratio[10:], 0.5 * freedom[10:]) > inflation(10 * ratio[10:], freedom[10:])).all())
    sure = inflation(torch.tensor([1e3]).double(), torch.tensor([1e6]).double())
    assert float(sure) == pytest.approx(1e3, rel=0.03), "many degrees of freedom know the ratio"
    only_white = IntervalSettings(white=1 - 1e-12)
    assert float(inflation(torch.tensor([1.0]).double(), torch.tensor([3.0]).double(), only_white)) == pytest.approx(1)


@pytest.mark.parametrize("confidence", [0.5, 0.9, 0.95])
def test_an_interval_reaches_as_many_deviations_as_a_normal_variable_with_that_probability(confidence: float) -> None:
    assert quantile(confidence) == pytest.approx(norm.ppf((1 + confidence) / 2))
    covariance = torch.tensor([[4.0, 1.0], [1.0, 9.0]], dtype=torch.float64)
    expected = [2 * norm.ppf((1 + confidence) / 2), 3 * norm.ppf((1 + confidence) / 2)]
    assert reach_of(covariance, confidence).tolist() == pytest.approx(expected)
    assert reach_of(covariance).tolist() == pytest.approx([2 * norm.ppf(0.95), 3 * norm.ppf(0.95)])


def test_a_parameter_that_one_trajectory_knows_shows_none_of_its_variance_and_has_a_degree_of_freedom() -> None:
    matrix = torch.zeros(3, 1, 1).double()
    matrix[1] = 4.0
    for vector in (torch.zeros(3, 1).double(), torch.tensor([[0.0], [1e-3], [0.0]]).double()):
        scatter, freedom, shown = scatter_of(Normal(matrix, vector, vector[:, 0]), torch.zeros(1).double())
        assert float(freedom) == pytest.approx(1, rel=1e-3)
        assert float(shown) == pytest.approx(0, abs=1e-9)
        assert math.isfinite(float(scatter))
    least = torch.tensor([0.25]).double()
    found = covariance_of(Normal(matrix, 0 * vector, vector[:, 0]), torch.zeros(1).double(), least)
    assert float(found) == pytest.approx(
        float(least * inflation(torch.ones(1).double(), torch.ones(1).double())), rel=1e-3
    )


@pytest.mark.parametrize("ridge", [0.0, 5.0, 100.0])
def test_a_prior_counts_as_curvature_that_no_trajectory_scatters(ridge: float) -> None:
    """With one parameter d_i = s_i / sqrt(T (1 - a_i / T)) for slopes s_i and curvatures a_i, T their sum with the
    ridge, and the covariance is sum d_i^2 / T."""
    curvature, slope = torch.tensor([4.0, 9.0, 1.0]).double(), torch.tensor([1.5, -2.0, 0.5]).double()
    total = float(curvature.sum()) + ridge
    expected = (slope.square() / (1 - curvature / total)).sum() / total**2
    normal = Normal(curvature[:, None, None], slope[:, None], torch.zeros(3).double())
    scatter, _, shown = scatter_of(normal, torch.tensor([ridge]).double())
    assert float(scatter) == pytest.approx(float(expected))
    share = curvature / total  # of what is known
    assert float(shown) == pytest.approx(float(share.sum()))
