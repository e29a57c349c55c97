"""One hypothesis: the nominal model with some effects added, fitted, and how well it predicts held-out data."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import product

import torch
from torch import Tensor

from physid.diagnosis.reference.discrepancy import working_effects
from physid.diagnosis.settings.settings import Settings
from physid.diagnosis.settings.testing import HypothesisSettings
from physid.estimation.least_squares import (
    Experiment,
    Fit,
    Normal,
    Step,
    best_step,
    carried,
    clamp_effects,
    covariance_of,
    gauss_newton,
    predictive_score,
    prior,
    reach_of,
    search,
    solve_shared,
    try_new_states,
)
from physid.estimation.prediction import Predictor, Variants, has
from physid.physics import Effect, SolverError


@dataclass(frozen=True)
class Hypothesis:
    """The nominal model with effects added.

    Attributes:
        names: Names of the effects; none for the nominal model.
        columns: Indices of their parameters among the predictor's terms, shape (E,).
        experiment: What it was fitted to.
        fit: The fit.
        normal: Normal equations at the fit.
        held_out: How well each trajectory is predicted without it, in squared residuals (`predictive_score`); (R,).
        settings: What decides.
    """

    names: tuple[str, ...]
    columns: Tensor
    experiment: Experiment
    fit: Fit
    normal: Normal
    held_out: Tensor
    settings: Settings

    @property
    def values(self) -> dict[str, float]:
        """Fitted parameters of the effects by "effect.parameter"."""
        terms = self.experiment.predictor.terms
        return {terms[k].label: float(self.fit.point.effects[0, k]) for k in self.columns.tolist()}

    @property
    def working(self) -> tuple[Effect, ...]:
        """The effects at their fitted values."""
        return working_effects(self.experiment.predictor, self.fit.point, self.names)

    def covariance(self) -> Tensor:
        """Estimate the covariance of the shared parameters, shape (P, P).

        By the scatter of trajectories (see `covariance_of`), and by what an error that all of them share changes.
        """
        fitted, own = self.normal.of(self.experiment.fitted), self.experiment.settings.intervals
        covariance = covariance_of(fitted, prior(self.experiment, self.columns), settings=own)
        if self.experiment.common is None:
            return covariance
        moved = self.follow(self.experiment.common)
        return covariance + torch.outer(moved, moved)

    def follow(self, residual: Tensor) -> Tensor:
        """Return where one Gauss-Newton step brings the shared parameters, (P,), if residuals were (R, T, N, 6)."""
        fitted = self.experiment.fitted
        normal = self.fit.linear.respond(residual[None], self.experiment.scale).of(fitted)
        matrix = normal.matrix.sum(0) + torch.diag(prior(self.experiment, self.columns))
        change: Tensor = torch.linalg.solve(matrix, normal.vector.sum(0))[:, 0]
        return change

    def reach(self, covariance: Tensor) -> Tensor:
        """Return how far intervals (of 90 % by default) of the shared parameters reach to either side, shape (P,)."""
        return reach_of(covariance, self.settings.hypothesis.confidence)

    def absent(self, covariance: Tensor) -> list[str]:
        """List the effects all of whose sizes may be those of no effect."""
        predictor = self.experiment.predictor
        reach = self.reach(covariance)[self.fit.point.nominal.shape[1] + 1 :]
        away = (self.fit.point.effects[0] - predictor.null)[self.columns].abs() > reach
        present = {
            predictor.terms[k].effect.name for k, sure in zip(self.columns.tolist(), away.tolist(), strict=True) if sure
        }
        return [name for name in self.names if name not in present]


def columns_of(predictor: Predictor, names: Sequence[str]) -> Tensor:
    """Return the indices of the parameters of some effects among the predictor's terms."""
    return torch.tensor([k for k, term in enumerate(predictor.terms) if term.effect.name in names], dtype=torch.int64)


def begin_hypothesis(experiment: Experiment, start: Fit, names: tuple[str, ...], settings: Settings) -> Hypothesis:
    """Fit the effects together with unknown parameters and initial states, as far as a few steps go.

    Args:
        experiment: What to explain.
        start: A fit without them (or with some), linearised with columns for them.
        names: Names of the effects.
        settings: How far a few steps are.
    """
    columns = columns_of(experiment.predictor, names)
    experiment = experiment.for_effects(columns)
    point = _first_step(experiment, start, columns, settings.hypothesis)
    fit = gauss_newton(experiment, point, columns, settings.hypothesis.first_steps)
    return conclude(experiment, fit, names, settings)


def begin_from_finite_sizes(
    experiment: Experiment, point: Variants, names: tuple[str, ...], change: Tensor, settings: Settings
) -> Hypothesis:
    """Fit effects from finite sizes, with the first guesses of the unknown parameters; the best fit is returned.

    Args:
        experiment: What to explain.
        point: Initial states, without effects.
        names: Names of the effects.
        change: Their parameters as a line at the null suggests: its direction is taken, shape (E,).
        settings: From which sizes.

    Raises:
        SolverError: If a fit cannot be simulated.
    """
    columns = columns_of(experiment.predictor, names)
    experiment = experiment.for_effects(columns)
    predictor = experiment.predictor
    known = [predictor.terms[k].quantity for k in columns.tolist()]
    typical = torch.tensor([one.typical - one.null for one in known], dtype=torch.float64)
    direction = change / typical
    direction = direction / direction.abs().max().clamp_min(1e-9)
    guess = point.replace(nominal=predictor.model.guess[None])
    counts, found = experiment.fitted[predictor.segments.trajectory], []
    for size in settings.hypothesis.finite_sizes:
        effects = point.effects.clone()
        effects[0, columns] = predictor.null[columns] + size * typical * direction
        start = try_new_states(experiment, guess.replace(effects=clamp_effects(predictor, effects)))
        found.append(gauss_newton(experiment, start, columns, settings.hypothesis.first_steps))
    return conclude(experiment, min(found, key=lambda fit: float(fit.loss[counts].sum())), names, settings)


def finish_hypothesis(begun: Hypothesis) -> Hypothesis:
    """Fit a hypothesis to the end, with initial states guessed anew once its effects are known."""
    experiment, columns, own = begun.experiment, begun.columns, begun.settings.hypothesis
    fit = gauss_newton(experiment, begun.fit, columns, own.last_steps)
    again = try_new_states(experiment, fit.point) if own.new_states else fit.point
    if again is not fit.point:
        fit = gauss_newton(experiment, again, columns, own.last_steps)
    return conclude(experiment, fit, begun.names, begun.settings)


def refitted_from_new_states(one: Hypothesis, rival: Hypothesis | None = None) -> Hypothesis:
    """Fit a hypothesis again with new initial states where it fits badly; the better fit is returned.

    Args:
        one: The hypothesis.
        rival: Another one. Segments that it explains better are fitted from the motion that it found as well: rivals
            are to be compared by their laws, and not by who found the better initial states.
    """
    own = one.settings.hypothesis
    point = search(one.experiment, one.fit, None if rival is None else rival.fit) if own.new_states else one.fit.point
    if point is one.fit.point:
        return one
    fit = gauss_newton(one.experiment, point, one.columns, own.new_states_steps)
    counts = one.experiment.fitted[one.experiment.predictor.segments.trajectory]
    better = float((one.fit.loss - fit.loss)[counts].sum()) > 0
    return conclude(one.experiment, fit, one.names, one.settings) if better else one


def conclude(experiment: Experiment, fit: Fit, names: tuple[str, ...], settings: Settings) -> Hypothesis:
    """Cross-validate a fit: every trajectory is predicted with what the fitted ones, itself left out, say."""
    columns = columns_of(experiment.predictor, names)
    normal = fit.normal()
    held_out = predictive_score(normal, experiment.fitted, prior(experiment, columns))
    return Hypothesis(names, columns, experiment, fit, normal, held_out, settings)


def _first_step(experiment: Experiment, start: Fit, columns: Tensor, settings: HypothesisSettings) -> Variants:
    """Take the best part of the linear step from a fit that has columns for the effects."""
    always = start.point.nominal.shape[1] + 1
    among = torch.cat([torch.arange(always), always + _places(start.effects, columns)])
    normal = start.normal().select(among)
    change = solve_shared(normal, experiment.fitted, prior(experiment, columns))
    damping = torch.full_like(start.loss, experiment.settings.line_search.first_damping)
    step = best_step(experiment, start, columns, change, damping, settings.strides)
    counts = experiment.fitted[experiment.predictor.segments.trajectory]
    promised = (normal.square - normal.loss(change))[experiment.fitted].sum()
    kept = float((start.loss - step.loss)[counts].sum()) > settings.kept * float(promised)
    added = columns[start.point.effects[0, columns] == experiment.predictor.null[columns]]
    if kept or not _seen(experiment, added):
        return step.point
    found: list[Step | Fit] = [step, *_carried_along(experiment, start, columns, change[always:], settings)]
    return min(found, key=lambda one: float(one.loss[counts].sum())).point


def _seen(experiment: Experiment, columns: Tensor) -> bool:
    """Return whether some of the effects act on what a camera reports."""
    return any(has(experiment.predictor.terms[k].effect, "observe") for k in columns.tolist())


def _carried_along(
    experiment: Experiment, start: Fit, columns: Tensor, change: Tensor, settings: HypothesisSettings
) -> list[Fit]:
    """Fit unknown parameters to parts of a change of effects, when initial states follow what a camera sees.

    A camera that is turned moves and turns all that it reports: initial states follow along a curve, and a line leaves
    it at once.
    """
    predictor = experiment.predictor
    found: list[Fit] = []
    for share, nominal in product(settings.curved, (start.point.nominal, predictor.model.guess[None])):
        effects = start.point.effects.clone()
        effects[0, columns] += share * change
        there = start.point.replace(nominal=nominal, effects=clamp_effects(predictor, effects))
        with suppress(SolverError):
            point = carried(experiment, start, there)
            found.append(gauss_newton(experiment, point, columns[:0], settings.curved_steps))
    return found


def _places(present: Tensor, wanted: Tensor) -> Tensor:
    """Return where the wanted indices stand among those present."""
    return torch.tensor([present.tolist().index(k) for k in wanted.tolist()], dtype=torch.int64)
