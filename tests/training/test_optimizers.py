"""Gauss-Newton and the search on a lattice."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch
from tests.training.pushed import SCENE, TRUE_FRICTION, push_batch
from torch import Tensor, nn

from physid.estimation.least_squares.levenberg_marquardt import NONE, gauss_newton
from physid.estimation.prediction.rollout import Predictor
from physid.estimation.prediction.variants import Prediction, Variants
from physid.physics import SolverError
from physid.training.initial_states.explaining import Explaining, started_from
from physid.training.initial_states.fitted import fit_states
from physid.training.learners.sysid import SysID
from physid.training.parameters.gauss_newton import GaussNewton
from physid.training.parameters.pattern_search import PatternSearch

CLOSE = 1e-6
FARTHEST = 0.3  # change of ln(friction) beyond which there shall be no solution


def closure_of(optimizer: torch.optim.Optimizer, loss: Callable[[], Tensor]) -> Callable[[], Tensor]:
    def closure() -> Tensor:
        optimizer.zero_grad()
        value = loss()
        value.backward()
        return value

    return closure


def pushed(friction: float) -> Explaining:
    module = SysID(values={"block.friction": friction}).attach(SCENE)
    return module._explaining(module.trajectories(push_batch(frames=60)), fitted=False)


def test_gauss_newton_solves_a_linear_problem_in_one_step() -> None:
    matrix = torch.tensor([[2.0, 0.5], [0.0, 1.0], [1.0, 1.0]], dtype=torch.float64)
    wanted = torch.tensor([0.3, -0.2], dtype=torch.float64)
    x = nn.Parameter(torch.zeros(2, dtype=torch.float64))
    optimizer = GaussNewton([x], damping=1e-9)
    loss = closure_of(optimizer, lambda: (matrix @ (x - wanted)).square().sum())
    optimizer.step(loss, lambda: (2 * matrix.T @ matrix, 2 * matrix.T @ matrix @ (x.detach() - wanted)))
    assert (x - wanted).abs().max() < CLOSE


def bent(x: nn.Parameter) -> Callable[[], tuple[Tensor, Tensor]]:
    """Return H and slope of the loss arctan(x)^2, whose steps from afar lead far beyond its minimum."""

    def near() -> tuple[Tensor, Tensor]:
        slope = 1 / (1 + x.detach().square())
        return 2 * slope.square()[:, None], 2 * slope * x.detach().atan()

    return near


def test_a_step_that_made_the_loss_worse_is_taken_back_and_at_least_halved() -> None:
    x = nn.Parameter(torch.tensor([3.0], dtype=torch.float64))
    optimizer = GaussNewton([x], max_step=100.0)
    loss = closure_of(optimizer, lambda: x.atan().square().sum())
    ways = []
    for _ in range(40):
        optimizer.step(loss, bent(x))
        ways.append(float(x.detach()) - 3.0)
    assert ways[0] == pytest.approx(-12.5, abs=0.1)
    assert abs(ways[1]) <= 0.501 * abs(ways[0])
    assert abs(float(x.detach())) < CLOSE


@pytest.mark.parametrize(("slope", "end"), [(1.5, 0.25), (300.0, 0.0)])
def test_a_gradient_that_promises_more_than_the_whole_loss_is_replaced_and_no_step_does(
    slope: float, end: float
) -> None:
    x = nn.Parameter(torch.tensor([1.0], dtype=torch.float64))
    optimizer = GaussNewton([x], max_step=100.0, damping=1e-6)
    # A kink: the derivative of this point is minus a hundred times that over any distance.
    loss = closure_of(optimizer, lambda: (x.square() - 200 * (x - x.detach())).sum())
    optimizer.step(loss, lambda: (torch.tensor([[2.0]]).double(), torch.tensor([slope]).double()))
    assert float(x.detach()) == pytest.approx(end, abs=1e-3)


@pytest.mark.parametrize("fitted", [False, True])
def test_the_slope_of_the_curvatures_derivatives_is_the_gradient_where_the_loss_is_smooth(fitted: bool) -> None:
    module = SysID(values={"block.friction": 1.1 * TRUE_FRICTION}).attach(SCENE)
    explaining = module._explaining(module.trajectories(push_batch(frames=60)), fitted=fitted)
    if fitted:
        fit = fit_states(explaining)[1]
    else:
        experiment, point = explaining.begin()
        fit = experiment.linearise(point, NONE)
    curvature, slope = explaining.quadratic(fit)
    cut = started_from(explaining.trajectories, fit) if fitted else explaining.trajectories
    losses = module.loss.between(cut.rolled(module.layer, module.physical()).pose, cut.pose, cut.real)
    (gradient,) = torch.autograd.grad(torch.stack(list(losses.values())).sum(0).mean(), [module.physical.coordinates])
    assert torch.allclose(slope, gradient, rtol=1e-2)
    assert float(curvature) > 0


def test_where_the_loss_changes_it_begins_anew_from_the_best_point() -> None:
    x = nn.Parameter(torch.tensor([3.0], dtype=torch.float64))
    optimizer = GaussNewton([x], max_step=100.0)
    optimizer.step(closure_of(optimizer, lambda: x.atan().square().sum()), bent(x))
    assert float(x.detach()) < -9
    optimizer.take_back()
    assert float(x.detach()) == 3
    assert not optimizer.state


@pytest.mark.parametrize(("begin", "kept"), [(3.0, False), (0.5, True)])
def test_a_last_step_that_makes_the_loss_worse_is_taken_back(begin: float, kept: bool) -> None:
    """The squared arc tangent: from beyond 1.39, a step of Gauss-Newton leads further away than it begins."""
    x = nn.Parameter(torch.tensor([begin], dtype=torch.float64))
    optimizer = GaussNewton([x], max_step=100.0)
    optimizer.step(closure_of(optimizer, lambda: x.atan().square().sum()), bent(x))
    assert (abs(float(x.detach())) < begin) == kept
    optimizer.judge_last(lambda points: points.atan().square().sum(1))
    assert abs(float(x.detach())) < begin if kept else float(x.detach()) == begin


def test_a_last_step_to_where_the_physics_has_no_solution_is_taken_back() -> None:
    x = nn.Parameter(torch.tensor([0.5], dtype=torch.float64))
    optimizer = GaussNewton([x])

    def fails(points: Tensor) -> Tensor:
        raise SolverError("no solution")

    optimizer.step(closure_of(optimizer, lambda: x.atan().square().sum()), bent(x))
    optimizer.judge_last(fails)
    assert float(x.detach()) == 0.5


def test_a_step_to_where_the_physics_has_no_solution_is_shortened() -> None:
    x = nn.Parameter(torch.tensor([3.0], dtype=torch.float64))
    optimizer = GaussNewton([x], max_step=100.0)

    def loss() -> Tensor:
        if float(x.detach()) < -2:
            raise SolverError("no solution")
        return x.atan().square().sum()

    for _ in range(41):
        optimizer.step(closure_of(optimizer, loss), bent(x))
    assert abs(float(x.detach())) < CLOSE


def test_a_first_point_without_a_solution_is_an_error() -> None:
    x = nn.Parameter(torch.tensor([1.0], dtype=torch.float64))

    def nothing() -> Tensor:
        raise SolverError("no solution")

    with pytest.raises(SolverError):
        GaussNewton([x]).step(nothing, lambda: torch.eye(1).double())


FIRST = torch.tensor([1.0, 0.0], dtype=torch.float64)


def test_a_parameter_without_influence_stays_and_hinders_no_other() -> None:
    x = nn.Parameter(torch.tensor([1.0, 1.0], dtype=torch.float64))
    optimizer = GaussNewton([x])
    loss = closure_of(optimizer, lambda: x[0].square() + 1e-13 * x[1])
    for _ in range(5):
        optimizer.step(loss, lambda: (torch.diag(torch.tensor([2.0, 1e-18]).double()), 2 * x.detach() * FIRST))
    assert abs(float(x.detach()[0])) < CLOSE
    assert abs(float(x.detach()[1]) - 1) < 1e-3


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_the_friction_is_found_from_either_side_with_known_initial_states(factor: float) -> None:
    experiment, point = pushed(factor * TRUE_FRICTION).begin()
    found = gauss_newton(experiment, point, NONE, 6).point.nominal
    assert float(found.exp()) == pytest.approx(TRUE_FRICTION, rel=1e-4)


def test_a_step_of_the_shared_loop_to_where_there_is_no_solution_is_shortened(monkeypatch: pytest.MonkeyPatch) -> None:
    experiment, point = pushed(2 * TRUE_FRICTION).begin()
    predict = Predictor.predict

    def picky(self: Predictor, variants: Variants) -> Prediction:
        if float((variants.nominal - point.nominal).abs().max()) > FARTHEST:
            raise SolverError("no solution")
        return predict(self, variants)

    monkeypatch.setattr(Predictor, "predict", picky)
    fit = gauss_newton(experiment, point, NONE, 2)
    assert 0.1 * FARTHEST < float((point.nominal - fit.point.nominal)[0, 0]) <= FARTHEST
    assert float(fit.loss.sum()) < float(experiment.losses(point).sum())


@pytest.mark.parametrize(("between", "found"), [(2e-3, 1.5), (1e-5, 2.0), (-1e-5, 0.0)])
def test_the_difference_between_two_engines_is_no_measure_of_what_a_camera_stands_aside(
    between: float, found: float
) -> None:
    """All heights are 3 mm off: 1.5 times what the engines differ by, or 300 times, which no engine can be."""
    experiment, point = pushed(TRUE_FRICTION).begin()
    pose, engine = experiment.pose.clone(), torch.zeros_like(experiment.engine)
    pose[..., 2] += 3e-3
    engine[..., 5] = between
    fit = gauss_newton(experiment.replace(pose=pose, engine=engine), point, NONE, 6)
    assert float(fit.point.engine) == pytest.approx(found, abs=0.01)


def test_a_search_on_a_lattice_overlooks_ripples() -> None:
    def rippled(point: Tensor) -> Tensor:
        bowl = (point - torch.tensor([0.4, -0.7])).square().sum(-1)
        return bowl + 1e-3 * torch.sin(3e4 * point.sum(-1))

    x = nn.Parameter(torch.zeros(2, dtype=torch.float64))
    optimizer = PatternSearch([x], spacing=0.25)
    for _ in range(25):
        optimizer.step(closure_of(optimizer, lambda: rippled(x)), rippled)
    assert (x.detach() - torch.tensor([0.4, -0.7])).abs().max() < 0.05


def test_networks_are_refused() -> None:
    with pytest.raises(ValueError, match="one tensor"):
        GaussNewton([nn.Parameter(torch.zeros(1)), nn.Parameter(torch.zeros(1))])
