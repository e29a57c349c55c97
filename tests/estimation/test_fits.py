"""Fits of what is linear end where least squares end, whatever is fitted and whichever steps are tried on the way."""

from __future__ import annotations

import math
from typing import Any

import pytest
import torch
from torch import Tensor

from estimation.flights import FORCE, MASS, NOISE, Flights, flights
from physid.estimation.least_squares.experiment import Experiment
from physid.estimation.least_squares.levenberg_marquardt import NONE, gauss_newton, hardly_gains, solve_shared
from physid.estimation.least_squares.line_search import attempt, best_step
from physid.estimation.least_squares.normal_equations import Normal
from physid.estimation.least_squares.prior import clamp_effects, clamp_engine, prior
from physid.estimation.least_squares.settings import LeastSquaresSettings, LineSearchSettings, PriorSettings
from physid.estimation.prediction import Prediction, Predictor, Variants
from physid.physics import SolverError

BOTH = torch.arange(2)


def least_squares(made: Flights, rows: Tensor, axis: int) -> float:
    """Return the force along an axis by plain least squares: places are x0 + v t + F t^2 / (2 m) in each segment."""
    experiment = made.experiment
    segments, time = experiment.predictor.segments, experiment.predictor.timeline.time
    chosen = [k for k in range(len(segments)) if bool(rows[segments.trajectory[k]])]
    blocks, seen = [], []
    for place, k in enumerate(chosen):
        row, first, size = (int(each[k]) for each in (segments.trajectory, segments.start, segments.size))
        since = time[row, first : first + size] - time[row, first]
        block = torch.zeros(size, 1 + 2 * len(chosen), dtype=torch.float64)
        block[:, 0], block[:, 1 + 2 * place], block[:, 2 + 2 * place] = since**2 / (2 * MASS), 1.0, since
        blocks.append(block)
        seen.append(experiment.pose[row, first : first + size, 0, axis])
    return float(torch.linalg.lstsq(torch.cat(blocks), torch.cat(seen)[:, None]).solution[0])


@pytest.mark.parametrize("fitted", [[True, True, True, True], [True, False, True, False]])
def test_a_fit_finds_the_force_of_plain_least_squares_over_the_trajectories_that_count(fitted: list[bool]) -> None:
    made = flights(fitted=torch.tensor(fitted))
    experiment = made.experiment
    fit = gauss_newton(experiment, made.start, BOTH)
    expected = [least_squares(made, experiment.fitted, axis) for axis in (0, 1)]
    assert fit.point.effects[0].tolist() == pytest.approx(expected, rel=1e-3)
    assert torch.allclose(experiment.losses(fit.point)[0], fit.loss)
    again = gauss_newton(experiment, fit, BOTH)
    assert torch.allclose(again.point.effects, fit.point.effects, rtol=1e-3)
    for part in fit.linear.parts:  # no initial state explains more, in held-out trajectories either
        slope = (part.state.mT @ part.residual[..., None])[..., 0] / part.state.norm(dim=1)
        assert float(slope.abs().max()) < 1e-2


def test_only_what_is_asked_for_moves_and_not_beyond_its_range() -> None:
    made = flights()
    start = made.start.replace(effects=torch.tensor([[0.4, 0.0]], dtype=torch.float64))
    fit = gauss_newton(made.experiment, start, BOTH[1:])
    assert float(fit.point.effects[0, 0]) == 0.4
    assert float(fit.point.effects[0, 1]) == pytest.approx(least_squares(made, made.experiment.fitted, 1), rel=1e-3)
    strong = flights(sizes=(9.0, -7.0), noise=(0.0, 0.0))
    assert gauss_newton(strong.experiment, strong.start, BOTH).point.effects.tolist() == [[5.0, -5.0]]


def test_a_fit_nearby_leads_to_the_end_without_another_jacobian() -> None:
    """With no further Jacobian the steps of the one that is there are taken: of a linear experiment these are all."""
    made = flights()
    near = made.experiment.linearise(made.start, BOTH)
    fit = gauss_newton(made.experiment, near, BOTH, steps=0)
    assert torch.equal(fit.jacobian.shared, near.jacobian.shared)
    assert fit.point.effects[0].tolist() == pytest.approx(
        [least_squares(made, made.experiment.fitted, axis) for axis in (0, 1)], rel=2e-3
    )


@pytest.mark.parametrize("loss", [0.0, 99.0])
def test_a_gain_hardly_counts_below_a_share_of_the_deviation_of_the_loss(loss: float) -> None:
    least = 0.05 * math.sqrt(1 + loss)
    assert hardly_gains(0.99 * least, loss, 0.05)
    assert not hardly_gains(least, loss, 0.05)
    assert hardly_gains(-1.0, loss, 0.05)


def test_shared_parameters_change_as_the_fitted_trajectories_and_the_ridge_want() -> None:
    matrix = torch.tensor([[[2.0, 0.5], [0.5, 1.0]], [[1.0, 0.0], [0.0, 3.0]], [[9.0, 1.0], [1.0, 9.0]]]).double()
    vector = torch.tensor([[1.0, 2.0], [3.0, -1.0], [50.0, 50.0]]).double()
    normal, ridge = Normal(matrix, vector, torch.zeros(3).double()), torch.tensor([1.0, 4.0]).double()
    change = solve_shared(normal, torch.tensor([True, True, False]), ridge)
    assert (torch.tensor([[4.0, 0.5], [0.5, 8.0]]).double() @ change).tolist() == pytest.approx([4.0, 1.0])


def stepped(made: Flights, factor: float, shares: tuple[float, ...], damping: float = 1e-3) -> tuple[Any, Tensor]:
    """Take the best of some parts of a multiple of the right step; returns it and the right forces."""
    experiment = made.experiment
    fit = experiment.linearise(made.start, BOTH)
    right = solve_shared(fit.normal(), experiment.fitted, prior(experiment, BOTH))
    each = torch.full_like(fit.loss, damping)
    return best_step(experiment, fit, BOTH, factor * right, each, shares), right[-2:]


@pytest.mark.parametrize(("factor", "chosen"), [(1.0, 1.0), (2.0, 0.5), (5.0, 0.2), (-1.0, 0.0)])
def test_of_the_parts_of_a_step_the_one_that_leaves_least_is_taken(factor: float, chosen: float) -> None:
    made = flights()
    step, right = stepped(made, factor, (1.0, 0.5, 0.2, 0.0))
    assert torch.allclose(step.point.effects[0], factor * chosen * right, atol=1e-9)
    assert torch.allclose(made.experiment.losses(step.point)[0], step.loss)
    assert step.predicted is not None
    assert torch.allclose(step.predicted.pose, made.experiment.predictor.predict(step.point).pose, atol=1e-12)
    # Nothing bends: the least damping is the best for each segment, and the next one is smaller by as much.
    assert torch.allclose(step.damping, torch.full_like(step.damping, 1e-4))


@pytest.mark.parametrize(("damping", "following"), [(1e-9, 1e-9), (1e5, 1e3)])
def test_the_damping_of_a_segment_has_its_limits(damping: float, following: float) -> None:
    step, _ = stepped(flights(), 1.0, (1.0,), damping)
    assert torch.allclose(step.damping, torch.full_like(step.damping, following))


@pytest.mark.parametrize("dampings", [(0.1, 10.0), (0.1, 1.0, 10.0)])
def test_where_no_state_moves_the_next_step_of_theirs_is_damped_more(dampings: tuple[float, ...]) -> None:
    made = flights(settings=LeastSquaresSettings(line_search=LineSearchSettings(dampings=dampings)))
    known = Flights(made.experiment.with_known_states(), made.true, made.start)
    step, right = stepped(known, 1.0, (1.0, 0.0))
    assert torch.allclose(step.point.pose, made.start.pose, atol=1e-12)
    assert torch.allclose(step.point.effects[0], right)
    assert torch.allclose(step.damping, torch.full_like(step.damping, 1e-2))


def test_only_fitted_trajectories_decide_which_part_of_a_step_is_taken() -> None:
    made = flights(fitted=torch.tensor([True, False, False, False]))
    experiment, axis = made.experiment, 0
    wrong = experiment.replace(fitted=~experiment.fitted)
    alone = [least_squares(made, one.fitted, axis) for one in (experiment, wrong)]
    assert abs(alone[0] - alone[1]) > 0.02, "they want different forces"
    fit = experiment.linearise(made.start, BOTH)
    change = torch.zeros(3, dtype=torch.float64)
    change[1] = alone[1]
    for one, want in ((experiment, alone[0]), (wrong, alone[1])):
        step = best_step(one, fit, BOTH, change, torch.full_like(fit.loss, 1e-9), (alone[0] / alone[1], 1.0))
        assert float(step.point.effects[0, 0]) == pytest.approx(want)


@pytest.mark.parametrize(("asked", "taken"), [(0.5, 0.5), (5.0, 1.0), (-3.0, -1.0)])
def test_an_unknown_parameter_moves_by_a_factor_of_e_at_most_in_one_step(asked: float, taken: float) -> None:
    made = flights(unknown=("block.mass",), noise=(0.0, 0.0), sizes=(0.0, 0.0))
    fit = made.experiment.linearise(made.start, NONE)
    change = torch.tensor([asked, 0.0], dtype=torch.float64)
    step = best_step(made.experiment, fit, NONE, change, torch.full_like(fit.loss, 1e-3), (1.0,))
    assert float((step.point.nominal - made.start.nominal)[0, 0]) == pytest.approx(taken)


class Fragile(Predictor):
    """Cannot simulate forces above 1 N along x, and returns what is no number above 1 N along y."""

    def predict(self, variants: Variants) -> Prediction:
        if bool((variants.effects[:, 0] > 1).any()):
            raise SolverError("no solution")
        found = super().predict(variants)
        found.pose[variants.effects[:, 1] > 1] = torch.nan
        return found


@pytest.mark.parametrize("fails", [True, False])
def test_what_cannot_be_simulated_explains_nothing_and_leaves_the_others_as_they_are(fails: bool) -> None:
    made = flights()
    old = made.experiment.predictor
    experiment = made.experiment.replace(predictor=Fragile(old.model, old.timeline, old.segments, old.candidates))
    trials = made.start.repeat(3)
    trials.effects[:] = torch.tensor([[0.5, 0.0], [2.0 if fails else 0.0, 0.0], [0.0, 2.0]], dtype=torch.float64)
    losses, predicted = attempt(experiment, trials)
    assert (predicted is None) is fails
    assert torch.allclose(losses[0], made.experiment.losses(trials[:1])[0])
    assert bool(losses[1].isinf().all()) is fails
    assert not bool(losses[2].isfinite().any()) if not fails else True


def test_priors_are_one_over_the_squares_of_their_deviations_in_the_order_of_the_columns() -> None:
    settings = LeastSquaresSettings(prior=PriorSettings(parameter=2.0, effect=4.0, engine=0.5))
    made = flights(
        unknown=("block.mass",), settings=settings, kinds=("constant_force", "gravity_error"), sizes=(0, 0, 0)
    )
    found = prior(made.experiment, torch.tensor([2, 0]))
    typical = [made.experiment.predictor.terms[k].quantity.typical for k in (2, 0)]
    assert found.tolist() == pytest.approx([1 / 4, 4.0, *((4.0 * size) ** -2 for size in typical)])
    share = torch.tensor([-1.0, 0.4, 0.6, 1.2, 1.6], dtype=torch.float64)
    assert clamp_engine(made.experiment, share).tolist() == pytest.approx([0.5, 0.5, 0.6, 1.2, 1.5])
    wild = torch.tensor([[-9.0, 9.0, -1.0], [0.1, 0.2, 0.3]], dtype=torch.float64)
    assert clamp_effects(made.experiment.predictor, wild).tolist() == [[-5.0, 5.0, -0.5], [0.1, 0.2, 0.3]]


def test_a_loss_is_the_sum_of_squared_residuals_in_units_of_the_noise_and_none_where_nothing_is_seen() -> None:
    made = flights(trajectories=2)
    scale = made.experiment.scale.clone()
    scale[0, 3:9] = 0.0
    experiment: Experiment = made.experiment.replace(scale=scale)
    assert experiment.counted().tolist() == [36.0, 72.0, 72.0, 72.0]
    fit = experiment.linearise(made.true, NONE)
    square = (fit.residual * scale).square().sum((2, 3))
    assert torch.allclose(fit.loss, torch.stack([square[:, :12].sum(1), square[:, 12:].sum(1)], 1).flatten())
    assert torch.allclose(experiment.misfit(made.true), fit.loss / experiment.counted())
    blind = made.experiment.replace(scale=0 * scale)
    assert blind.counted().tolist() == [1.0] * 4
    assert not blind.losses(made.true).any()


def test_a_camera_sees_what_noise_hides_by_its_deviation() -> None:
    """Of a right model the loss is chi-square of as many values as are seen."""
    made = flights(trajectories=40, seed=3)
    loss, count = float(made.experiment.losses(made.true).sum()), float(made.experiment.counted().sum())
    assert abs(loss - count) < 4 * math.sqrt(2 * count)
    assert made.experiment.scale[0, 0, 0].tolist() == pytest.approx([1 / NOISE[0]] * 3 + [1 / NOISE[1]] * 3)
    assert made.true.effects[0].tolist() == pytest.approx(FORCE)


def test_no_more_is_tried_once_steps_are_used_up() -> None:
    """A lone chord: of a bent experiment one Jacobian ends elsewhere than many do, and never worse than it began."""
    made = flights(unknown=("block.mass",), sizes=(2.0, 0.0), noise=(0.0, 0.0))
    begun = made.true.replace(nominal=made.true.nominal + 0.8)
    limits = LeastSquaresSettings(line_search=LineSearchSettings(chords=0))
    experiment = made.experiment.replace(settings=limits)
    before = experiment.losses(begun).sum()
    one, many = (gauss_newton(experiment, begun, NONE, steps=count) for count in (1, 10))
    assert many.loss.sum() < one.loss.sum() < before
    assert float(many.point.nominal[0, 0]) == pytest.approx(float(made.true.nominal[0, 0]), abs=1e-4)


@pytest.mark.parametrize("loss", [0.3, 3e3])
def test_of_what_is_linear_and_exact_nothing_is_left_however_little_there_was(loss: float) -> None:
    made = flights(noise=(0.0, 0.0))
    away = torch.tensor([[0.1, 0.05]], dtype=torch.float64)
    found = float(made.experiment.losses(made.true.replace(effects=made.true.effects + away)).sum())
    begun = made.true.replace(effects=made.true.effects + (loss / found) ** 0.5 * away)
    assert float(made.experiment.losses(begun).sum()) == pytest.approx(loss, rel=1e-3)
    assert float(gauss_newton(made.experiment, begun, BOTH).loss.sum()) < 1e-3 * loss
