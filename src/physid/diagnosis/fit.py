"""Fitting parameters and first states to trajectories: Gauss-Newton with damping (Levenberg 1944, Marquardt 1963)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from physid.diagnosis.columns import Directions, Jacobian, differentiate
from physid.diagnosis.linear import Linearised, Normal, linearise
from physid.diagnosis.prediction import Predictor, Variants, difference
from physid.physics.layer import SolverError

FIRST_DAMPING = 1e-3
DAMPINGS = (0.1, 10.0)  # times the damping of a window: its first state tries both
WHOLE, PARTS = (
    (1.0,),
    (0.5, 0.2, 0.0),
)  # parts of the step of the shared parameters: the first, and those tried if it fails
HARDLY = 0.1  # [rad/s], [m/s] first velocity of a body that may as well be at rest
LARGEST = 1.0  # change of an unknown parameter in one step, in the coordinates of the fit
CHORDS = 2  # most steps with a Jacobian of an earlier point
CONVERGED = 1e-2  # a step that gains less than this share of a standard deviation of the loss is the last


@dataclass(frozen=True)
class Experiment:
    """Observed trajectories and the model that shall explain them.

    Attributes:
        predictor: The model under the commanded wrenches.
        pose: Observed poses, shape (R, T, N, 7).
        scale: One over the standard deviation of the noise times the root of the weight, shape (R, T, N, 6).
        fitted: Trajectories that determine shared parameters (the others only have their first states fitted), (R,).
        directions: Free changes of first states.
        engine: How far the other engine leaves this one (a shared column with a prior of 0 +- 1), (R, T, N, 6).
        follow: Windows in which the other engine is followed, shape (K,); where small errors grow fast it cannot be.
    """

    predictor: Predictor
    pose: Tensor
    scale: Tensor
    fitted: Tensor
    directions: Directions
    engine: Tensor
    follow: Tensor

    def residual(self, predicted: Tensor, point: Variants) -> Tensor:
        """Return observed minus predicted poses, as rotation vectors and positions; (C, R, T, N, 6)."""
        return difference(self.pose, predicted) - point.engine[:, :, None, None, None] * self.engine

    def losses(self, point: Variants) -> Tensor:
        """Return the squared residual of each variant and window, in units of the noise; (C, K)."""
        predicted = self.predictor.predict(point).pose
        square = (self.residual(predicted, point) * self.scale).square().sum((3, 4))
        return self.predictor.windows.sum_frames(square)

    def counted(self) -> Tensor:
        """Return how many values of each window count, at least 1, shape (K,)."""
        return self.predictor.windows.sum_frames((self.scale > 0).sum((2, 3))[None].double())[0].clamp_min(1)

    def misfit(self, point: Variants) -> Tensor:
        """Return the mean squared residual of each window, in units of the noise, shape (K,)."""
        return self.losses(point)[0] / self.counted()

    def linearise(self, point: Variants, effects: Tensor, forces: Tensor | None = None) -> Fit:
        """Linearise at a point; see `differentiate` for the columns."""
        jacobian = differentiate(self.predictor, point, self.directions, effects, forces)
        unknown = point.nominal.shape[1]
        columns = [jacobian.shared[:unknown], self.engine[None], jacobian.shared[unknown:]]
        return self._fit(point, effects, replace(jacobian, shared=torch.cat(columns)))

    def at(self, point: Variants, near: Fit) -> Fit:
        """Return the residuals at a point with the Jacobian of a fit nearby, which costs one prediction."""
        jacobian, unknown = near.jacobian, point.nominal.shape[1]
        columns = [jacobian.shared[:unknown], self.engine[None], jacobian.shared[unknown + 1 :]]
        base = self.predictor.predict(point)
        return self._fit(point, near.effects, replace(jacobian, base=base, shared=torch.cat(columns)))

    def _fit(self, point: Variants, effects: Tensor, jacobian: Jacobian) -> Fit:
        residual = self.residual(jacobian.base.pose, point)[0]
        linear = linearise(residual, self.scale, jacobian, self.directions, self.predictor.windows)
        loss = linear.gather(lambda part: part.residual.square().sum(1))
        return Fit(point, effects, jacobian, residual, linear, loss)

    def only(self, chosen: Tensor, elsewhere: Tensor) -> Experiment:
        """Return the experiment with some of the windows (indices, in order); states elsewhere are (R, T, N, 7)."""
        directions = replace(self.directions, free=self.directions.free[chosen])
        predictor = self.predictor.over(self.predictor.windows.only(chosen), elsewhere)
        return replace(self, predictor=predictor, directions=directions, follow=self.follow[chosen])

    def replace(self, **changes: object) -> Experiment:
        """Return a copy with some fields changed."""
        return replace(self, **changes)  # type: ignore[arg-type]


@dataclass(frozen=True)
class Fit:
    """A point and the experiment linearised there.

    Attributes:
        point: First states, unknown parameters, effects.
        effects: Indices of the effects' parameters that are columns.
        jacobian: Prediction and its changes.
        residual: Observed minus predicted, shape (R, T, N, 6).
        linear: The same in units of the noise, by window.
        loss: Squared residual of each window, shape (K,).
    """

    point: Variants
    effects: Tensor
    jacobian: Jacobian
    residual: Tensor
    linear: Linearised
    loss: Tensor

    def normal(self) -> Normal:
        """Return the normal equations of the shared columns."""
        return self.linear.normal()


def solve_shared(normal: Normal, fitted: Tensor, ridge: Tensor) -> Tensor:
    """Return the change of the shared parameters that the fitted trajectories want, with a ridge (P,) on it."""
    matrix = normal.matrix[fitted].sum(0) + torch.diag(ridge)
    change: Tensor = torch.linalg.solve(matrix, normal.vector[fitted].sum(0))
    return change


def gauss_newton(experiment: Experiment, start: Variants | Fit, effects: Tensor, steps: int = 10) -> Fit:
    """Minimise the squared residuals over first states, unknown parameters and some parameters of effects.

    Every window has a damping of its own, for its first state; the shared parameters take the whole step or, if that
    does not help, a part of it or none. All dampings are tried in one batch, and each window keeps the best state.
    A Jacobian costs several times a step: it serves for some steps (the chord method), but it is a new one that says
    that nothing is left to gain.

    Args:
        experiment: What to explain.
        start: First point; or a fit nearby, whose Jacobian serves for the first steps.
        effects: Indices of the free parameters of effects, shape (E,).
        steps: Most Jacobians before the last one; 0 for that of `start` alone.

    Returns:
        The best point found, linearised there, or so near that nothing was left to gain.
    """
    if isinstance(start, Fit):
        fit, age, made = experiment.at(at_rest(experiment, start.point), start), 1, 0
    else:
        fit, age, made = experiment.linearise(at_rest(experiment, start), effects), 0, 1
    damping = torch.full_like(fit.loss, FIRST_DAMPING)
    ridge = prior(experiment, effects)
    counts = experiment.fitted[experiment.predictor.windows.trajectory]
    while True:
        change = solve_shared(fit.normal(), experiment.fitted, ridge)
        for shares in (WHOLE, PARTS) if age == 0 else (WHOLE,):
            better, loss, tried = best_step(experiment, fit, effects, change, damping, shares)
            gain = float((fit.loss - loss)[counts].sum())
            if float((fit.loss - loss).sum()) > 0:
                break
        helps = gain > 0 or bool((loss < fit.loss).any())
        followed = float((fit.loss - loss)[~counts].sum())
        little = max(gain, followed) < CONVERGED * (1 + float(loss.sum())) ** 0.5
        if helps and (age == 0 or gain + followed > 0):
            damping, age = tried, age + 1
            fit = experiment.at(better, fit)
            if age == 1 and little:
                return fit
        elif age == 0:
            return fit
        else:
            little = True
        if little or age > CHORDS:
            if made == steps:
                return experiment.linearise(fit.point, effects) if steps else fit
            fit, age, made = experiment.linearise(fit.point, effects), 0, made + 1


def at_rest(experiment: Experiment, point: Variants) -> Variants:
    """Let bodies that lie there and hardly move be at rest, in the windows that this explains better.

    A first velocity that friction stops at once leaves no slope, so that no step leads back from a wrong one.
    """
    lying = ~experiment.directions.free[..., 0].any(1)
    slow = lying & (point.twist[0].abs().amax((1, 2)) < HARDLY)
    if not bool(slow.any()):
        return point
    still = point.replace(twist=torch.where(slow[:, None, None], torch.zeros_like(point.twist), point.twist))
    losses = experiment.losses(Variants.join((point, still)))
    better = losses[1] < losses[0]
    return point.replace(twist=torch.where(better[:, None, None], still.twist, point.twist))


def best_step(
    experiment: Experiment, fit: Fit, effects: Tensor, change: Tensor, damping: Tensor, shares: Sequence[float]
) -> tuple[Variants, Tensor, Tensor]:
    """Try parts of a step, each with all dampings of the first states and with states left alone.

    The part with the smallest loss of the fitted trajectories is taken, and for each window its best first state.

    Args:
        experiment: What to explain.
        fit: Where the step starts.
        effects: Which parameters of effects move, shape (E,); all of them are columns of the fit.
        change: Step of unknown parameters, engine and these effects, shape (P + 1 + E,).
        damping: Of each window, shape (K,).
        shares: Parts of the step that are tried; 0 last.

    Returns:
        The new point, the loss of each window, and the new dampings.
    """
    shared, moves = [], []
    for share in shares:
        part = share * change
        shared += [part] * (1 + len(DAMPINGS))
        full = _among_columns(fit, effects, part)
        moves += [fit.linear.state_change(full, factor * damping) for factor in DAMPINGS]
        moves.append(torch.zeros_like(moves[-1]))
    trials = _moved(experiment, fit, effects, torch.stack(shared), torch.stack(moves))
    each = 1 + len(DAMPINGS)
    losses = try_losses(experiment, trials).unflatten(0, (len(shares), each))
    least, which = losses.min(1)
    counts = experiment.fitted[experiment.predictor.windows.trajectory]
    share = int(least[:, counts].sum(1).argmin())
    chosen = which[share]
    rows, pick = share * each + chosen, torch.arange(len(chosen))
    first = slice(share * each, share * each + 1)
    better = trials[first].replace(pose=trials.pose[rows, pick][None], twist=trials.twist[rows, pick][None])
    factor = torch.tensor([*DAMPINGS, DAMPINGS[-1]], dtype=damping.dtype)[chosen]
    return better, least[share], (damping * factor).clamp(1e-9, 1e3)


def _among_columns(fit: Fit, effects: Tensor, change: Tensor) -> Tensor:
    """Put a step of unknown parameters, engine and some effects in its places among all shared columns of a fit."""
    always = fit.point.nominal.shape[1] + 1
    present = fit.effects.tolist()
    full = torch.zeros(fit.linear.parts[0].shared.shape[-1], dtype=change.dtype)
    full[:always] = change[:always]
    full[[always + present.index(k) for k in effects.tolist()]] = change[always:]
    return full


def _moved(experiment: Experiment, fit: Fit, effects: Tensor, shared: Tensor, moves: Tensor) -> Variants:
    """Return the points that steps of shared parameters (C, P + 1 + E) and of first states (C, K, D) lead to."""
    unknown = fit.point.nominal.shape[1]
    many = fit.point.repeat(len(shared))
    pose, twist = experiment.directions.move(many.pose, many.twist, moves)
    values = many.effects.clone()
    values[:, effects] += shared[:, unknown + 1 :]
    return Variants(
        pose,
        twist,
        many.nominal + shared[:, :unknown].clamp(-LARGEST, LARGEST),
        clamp_effects(experiment.predictor, values),
        many.engine + shared[:, unknown : unknown + 1],
    )


def try_losses(experiment: Experiment, trials: Variants) -> Tensor:
    """Return the losses of all trials; one that cannot be simulated loses everything."""
    try:
        return experiment.losses(trials).nan_to_num(nan=torch.inf)
    except SolverError:
        pass
    losses = []
    for k in range(len(trials)):
        try:
            losses.append(experiment.losses(trials[k : k + 1])[0])
        except SolverError:
            losses.append(torch.full(trials.pose.shape[1:2], torch.inf, dtype=torch.float64))
    return torch.stack(losses)


def prior(experiment: Experiment, effects: Tensor) -> Tensor:
    """Return weak priors of unknown parameters (a factor of 20 either way) and effects (ten typical sizes)."""
    predictor = experiment.predictor
    unknown = torch.full((len(predictor.model.unknown),), 1 / 9.0, dtype=torch.float64)
    sizes = []
    for index in effects.tolist():
        known = predictor.terms[index].quantity
        sizes.append(1 / (10 * (known.typical - known.null)) ** 2)
    return torch.cat([unknown, torch.ones(1, dtype=torch.float64), torch.tensor(sizes, dtype=torch.float64)])


def clamp_effects(predictor: Predictor, values: Tensor) -> Tensor:
    """Keep parameters of effects (C, Q) in their ranges."""
    known = [term.quantity for term in predictor.terms]
    low = torch.tensor([one.low for one in known], dtype=torch.float64)
    high = torch.tensor([one.high for one in known], dtype=torch.float64)
    return values.clamp(low, high)
