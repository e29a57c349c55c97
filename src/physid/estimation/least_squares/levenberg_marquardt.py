"""Fitting parameters and initial states to trajectories: Gauss-Newton with damping (Levenberg 1944, Marquardt 1963)."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from physid.estimation.least_squares.experiment import Experiment, Fit
from physid.estimation.least_squares.jacobian import stands_after
from physid.estimation.least_squares.line_search import best_step
from physid.estimation.least_squares.normal_equations import Normal
from physid.estimation.least_squares.prior import prior
from physid.estimation.prediction.variants import Variants

NONE = torch.zeros(0, dtype=torch.int64)  # no effect is fitted
WHOLE = (1.0,)  # part of the step of the shared parameters that is tried first


def solve_shared(normal: Normal, fitted: Tensor, ridge: Tensor) -> Tensor:
    """Return the change of the shared parameters that the fitted trajectories want, with a ridge (P,) on it."""
    matrix = normal.matrix[fitted].sum(0) + torch.diag(ridge)
    change: Tensor = torch.linalg.solve(matrix, normal.vector[fitted].sum(0))
    return change


def gauss_newton(
    experiment: Experiment,
    start: Variants | Fit,
    effects: Tensor,
    steps: int | None = None,
) -> Fit:
    """Minimise the squared residuals over initial states, unknown parameters and some parameters of effects.

    Every segment has a damping of its own, for its initial state; the shared parameters take the whole step or, if that
    does not help, a part of it or none. All dampings are tried in one batch, and each segment keeps the best state.
    A Jacobian costs several times a step: it serves for some steps (the chord method), but it is a new one that says
    that nothing is left to gain.

    Args:
        experiment: What to explain.
        start: First point; or a fit nearby, whose Jacobian serves for the first steps.
        effects: Indices of the free parameters of effects, shape (E,).
        steps: Most Jacobians before the last one; 0 for that of `start` alone; None for what the settings say.

    Returns:
        The best point found, linearised there, or so near that nothing was left to gain.
    """
    limits = experiment.settings.line_search
    steps = limits.steps if steps is None else steps
    if isinstance(start, Fit):
        fit, age, made = experiment.at(at_rest(experiment, start.point), start), 1, 0
    else:
        fit, age, made = experiment.linearise(at_rest(experiment, start), effects), 0, 1
    damping = torch.full_like(fit.loss, limits.first_damping)
    ridge = prior(experiment, effects)
    counts = experiment.fitted[experiment.predictor.segments.trajectory]
    while True:
        change = solve_shared(fit.normal(), experiment.fitted, ridge)
        for shares in (WHOLE, limits.parts) if age == 0 else (WHOLE,):
            step = best_step(experiment, fit, effects, change, damping, shares)
            gain = float((fit.loss - step.loss)[counts].sum())
            if float((fit.loss - step.loss).sum()) > 0:
                break
        helps = bool((step.loss < fit.loss).any())
        followed = float((fit.loss - step.loss)[~counts].sum())
        little = hardly_gains(max(gain, followed), float(step.loss.sum()), limits.converged)
        if helps and (age == 0 or gain + followed > 0):
            damping, age = step.damping, age + 1
            fit = experiment.moved(step.point, fit, step.predicted)
            if age == 1 and little:
                return fit
        elif age == 0:
            return fit
        else:
            little = True
        if little or age > limits.chords:
            if made == steps:
                return experiment.linearise(fit.point, effects) if steps else fit
            fit, age, made = experiment.linearise(fit.point, effects), 0, made + 1


def hardly_gains(gain: float, loss: float, share: float) -> bool:
    """Return whether a gain of squared residual is less than a share of a standard deviation of the loss.

    The sum of n squared residuals in units of the noise has a deviation of sqrt(2 n), about the root of the loss.
    """
    return gain < share * math.sqrt(1 + loss)


def at_rest(experiment: Experiment, point: Variants) -> Variants:
    """Let bodies that lie there and hardly move be at rest, in the segments that this explains as well.

    An initial velocity that friction stops at once leaves no slope, so that no step leads back from a wrong one. All
    that hardly move are at rest, where they start; or, if velocities must be worth it, see `bodies_at_rest`.
    """
    settings = experiment.settings
    many, still = bodies_at_rest(experiment, point, each=settings.line_search.worth > 0)
    if len(many) == 1:
        return point
    predicted = experiment.predictor.predict(many)
    held = still & stands_after(experiment.predictor.segments, predicted.twist, settings.differences.still)
    losses = experiment.losses_of(predicted, many)
    best = (losses - settings.line_search.worth * experiment.explained(losses[0]) * held.sum(2)).argmin(0)
    pick = torch.arange(len(best))
    return point.replace(pose=many.pose[best, pick][None], twist=many.twist[best, pick][None])


def bodies_at_rest(experiment: Experiment, point: Variants, *, each: bool) -> tuple[Variants, Tensor]:
    """Return the point itself, and with bodies at rest that lie there and hardly move.

    Args:
        experiment: What to explain.
        point: Where; a single variant.
        each: Whether to try each body alone as well, and where the model lets bodies stop as well as where they start.

    Returns:
        C variants, and which bodies are brought to rest in each, shape (C, K, N).
    """
    speed = point.twist[0].abs().amax(-1)
    slow = experiment.directions.planar & (speed > 0) & (speed < experiment.settings.line_search.at_rest)
    if not bool(slow.any()):
        return point, torch.zeros_like(slow[None])
    still, poses = slow[None], point.pose
    if each:
        bodies = torch.eye(slow.shape[1], dtype=torch.bool)[:, None]
        still = torch.cat([still, slow & bodies]) if len(bodies) > 1 else still
        poses = torch.cat([poses, _where_they_stop(experiment, point)[None]])
    many = point.repeat(1 + len(poses) * len(still))
    many.pose[1:] = torch.where(still[None, ..., None], poses[:, None], point.pose[0]).flatten(0, 1)
    still = still.repeat(len(poses), 1, 1)
    many.twist[1:] *= ~still[..., None]
    return many, torch.cat([torch.zeros_like(slow[None]), still])


def _where_they_stop(experiment: Experiment, point: Variants) -> Tensor:
    """Return poses (K, N, 7) where the model lets bodies be no slower in the next frame for the first time.

    Those of bodies that lie on the ground are at the heights at which they start.
    """
    predicted, found = experiment.predictor.predict(point), point.pose[0].clone()
    for batch in experiment.predictor.segments.batches:
        pose, speed = batch.cut(predicted.state)[0], batch.cut(predicted.twist)[0].norm(dim=-1)
        last = ~batch.inside.roll(-1, 1)
        last[:, -1] = True
        frame = ((speed.roll(-1, 1) >= speed) | last[..., None]).int().argmax(1)
        found[batch.segments] = pose.gather(1, frame[:, None, :, None].expand(-1, 1, -1, 7))[:, 0]
    return experiment.directions.with_heights_of(point.pose[0], found)
