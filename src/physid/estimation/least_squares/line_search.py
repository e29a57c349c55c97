"""Steps that are tried: several at once, of which each segment keeps what explains it best."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from physid.estimation.least_squares.experiment import Experiment, Fit
from physid.estimation.least_squares.prior import clamp_effects, clamp_engine
from physid.estimation.prediction.rollout import Predictor
from physid.estimation.prediction.variants import Prediction, Variants
from physid.physics import SolverError


@dataclass(frozen=True)
class Step:
    """The best of some steps.

    Attributes:
        point: Where it leads.
        loss: Of each segment, shape (K,).
        damping: With which it was found, shape (K,).
        predicted: What the model says there; None if some of the steps could not be simulated.
    """

    point: Variants
    loss: Tensor
    damping: Tensor
    predicted: Prediction | None


def best_step(
    experiment: Experiment,
    fit: Fit,
    effects: Tensor,
    change: Tensor,
    damping: Tensor,
    shares: Sequence[float],
) -> Step:
    """Try parts of a step, each with all dampings of the initial states and with states left alone.

    The part with the smallest loss of the fitted trajectories is taken, and for each segment its best initial state.

    Args:
        experiment: What to explain.
        fit: Where the step starts.
        effects: Which parameters of effects move, shape (E,); all of them are columns of the fit.
        change: Step of unknown parameters, engine and these effects, shape (P + 1 + E,).
        damping: Of each segment, shape (K,).
        shares: Parts of the step that are tried; 0 last.

    Returns:
        What is best.
    """
    limits = experiment.settings.line_search
    shared, moves = [], []
    dampings = limits.dampings if experiment.directions.used else ()
    for share in shares:
        part = share * change
        shared += [part] * (1 + len(dampings))
        full = _among_columns(fit, effects, part)
        moves += [fit.linear.state_change(full, factor * damping) for factor in dampings]
        moves.append(full.new_zeros(len(damping), len(experiment.directions.used)))
    trials = _moved(experiment, fit, effects, torch.stack(shared), torch.stack(moves), limits.largest)
    each = 1 + len(dampings)
    found, predicted = attempt(experiment, trials)
    losses = found.unflatten(0, (len(shares), each))
    least, which = losses.min(1)
    counts = experiment.fitted[experiment.predictor.segments.trajectory]
    share = int(least[:, counts].sum(1).argmin())
    chosen = which[share]
    rows, pick = share * each + chosen, torch.arange(len(chosen))
    first = slice(share * each, share * each + 1)
    better = trials[first].replace(pose=trials.pose[rows, pick][None], twist=trials.twist[rows, pick][None])
    factor = torch.tensor([*dampings, limits.dampings[-1]], dtype=damping.dtype)[chosen]
    known = predicted and _picked(experiment.predictor, predicted, rows, better)
    return Step(better, least[share], (damping * factor).clamp(1e-9, 1e3), known)


def _picked(predictor: Predictor, predicted: Prediction, rows: Tensor, point: Variants) -> Prediction:
    """Put a prediction of one point together from variants (C, ...): of each segment the row (K,)."""
    segments = predictor.segments
    where = segments.spread(rows)
    trajectory, frame = torch.arange(segments.trajectories)[:, None], torch.arange(segments.frames)
    state, twist, impulse = (
        value[where, trajectory, frame][None] for value in (predicted.state, predicted.twist, predicted.impulse)
    )
    return Prediction(predictor.observe(state, point), state, twist, impulse)


def _among_columns(fit: Fit, effects: Tensor, change: Tensor) -> Tensor:
    """Put a step of unknown parameters, engine and some effects in its places among all shared columns of a fit."""
    always = fit.point.nominal.shape[1] + 1
    present = fit.effects.tolist()
    full = torch.zeros(fit.linear.parts[0].shared.shape[-1], dtype=change.dtype)
    full[:always] = change[:always]
    full[[always + present.index(k) for k in effects.tolist()]] = change[always:]
    return full


def _moved(
    experiment: Experiment, fit: Fit, effects: Tensor, shared: Tensor, moves: Tensor, largest: float
) -> Variants:
    """Return the points that steps of shared parameters (C, P + 1 + E) and of initial states (C, K, D) lead to."""
    unknown, coordinates = fit.point.nominal.shape[1], experiment.predictor.model.coordinates
    many = fit.point.repeat(len(shared))
    pose, twist = experiment.directions.move(many.pose, many.twist, moves)
    values = many.effects.clone()
    values[:, effects] += shared[:, unknown + 1 :]
    return Variants(
        pose,
        twist,
        coordinates.within(many.nominal + shared[:, :unknown].clamp(-largest, largest)),
        clamp_effects(experiment.predictor, values),
        clamp_engine(experiment, many.engine + shared[:, unknown : unknown + 1]),
    )


def try_losses(experiment: Experiment, trials: Variants) -> Tensor:
    """Return the losses of all trials; one that cannot be simulated loses everything."""
    return attempt(experiment, trials)[0]


def attempt(experiment: Experiment, trials: Variants) -> tuple[Tensor, Prediction | None]:
    """Return the losses of all trials, and their predictions; one that cannot be simulated loses everything."""
    try:
        predicted = experiment.predictor.predict(trials)
        return experiment.losses_of(predicted, trials).nan_to_num(nan=torch.inf), predicted
    except SolverError:
        pass
    losses = []
    for k in range(len(trials)):
        try:
            losses.append(experiment.losses(trials[k : k + 1])[0])
        except SolverError:
            losses.append(torch.full(trials.pose.shape[1:2], torch.inf, dtype=torch.float64))
    return torch.stack(losses), None
