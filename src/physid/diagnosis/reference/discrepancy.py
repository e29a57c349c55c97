"""Fitting with the numerics of the reference simulator: what PyBullet makes of the same states and parameters."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from physid.diagnosis.progress import Progress, Stage, silent
from physid.diagnosis.reference.replay import replay
from physid.diagnosis.settings.settings import Settings
from physid.estimation.least_squares import Experiment, Fit, gauss_newton
from physid.estimation.measurement import pose_difference
from physid.estimation.prediction import Predictor, Segmentation, Variants
from physid.physics import Effect


def fit_with_reference(
    experiment: Experiment,
    fit: Fit,
    effects: Tensor,
    names: Sequence[str],
    settings: Settings,
    say: Progress = silent,
) -> tuple[Experiment, Fit]:
    """Fit and replay in turn until both agree on how far the reference simulator leaves the prediction.

    A segment takes a new initial state only if it then explains the segment better with the replay of that very state;
    where it does not, the next round tries a shorter step.

    An impact may go another way for a hair. That is no evidence against an effect: the gap between the engines that is
    known of the model without it stands in each segment that the replays explain worse.

    Args:
        experiment: What to explain.
        fit: Where to start.
        effects: Indices of the free parameters of effects.
        names: Their effects, which the reference simulator has too, at the values of the fit.
        settings: How often, how far, and with which reference simulators.
        say: Called with what is being done.

    Returns:
        The experiment with the gap between the engines at the best point, and the fit there.
    """
    if not bool(experiment.follow.any()):
        return experiment, gauss_newton(experiment, fit, effects)
    say(Stage.REPLAYING_NOMINAL)
    limits, best, segments = settings.discrepancy, fit.point, experiment.predictor.segments
    engine = _renewed(experiment, fit, names, settings).engine
    stride = torch.ones(len(segments), dtype=torch.float64)
    loss = torch.full_like(stride, torch.inf)
    if names:
        both = [one.losses(best)[0] for one in (experiment, experiment.replace(engine=engine))]
        engine, loss = _by_segment(segments, both[1] < both[0], engine, experiment.engine), torch.minimum(*both)
    for turn in range(limits.rounds):
        before = float(loss.clamp_max(1e12).sum())
        known = experiment.replace(engine=engine)
        fit = gauss_newton(known, known.at(best, fit), effects, steps=0 if turn else limits.first_steps)
        trial = between(best, fit.point, stride)
        fit = experiment.at(trial, fit)
        say(Stage.REPLAYING_NOMINAL)
        fresh = _renewed(experiment, fit, names, settings).engine
        now = experiment.replace(engine=fresh).losses(trial)[0]
        better = now < loss
        stride = torch.where(better, torch.ones_like(stride), stride * limits.shorter)
        best = between(best, trial, better.to(torch.float64))
        engine = _by_segment(segments, better, fresh, engine)
        loss = torch.minimum(now, loss)
        if before - float(loss.sum()) < limits.settled * (2 * float(loss.sum())) ** 0.5:
            break
    experiment = experiment.replace(engine=engine)
    return experiment, gauss_newton(experiment, experiment.at(best, fit), effects, steps=limits.last_steps)


def simulator_discrepancy(
    predictor: Predictor, fit: Fit, follow: Tensor, working: Sequence[Effect], settings: Settings
) -> Tensor:
    """Compute how far PyBullet leaves the prediction of a fit, from the same states; zero where it is not followed.

    Args:
        predictor: The experiment.
        fit: Initial states and parameters.
        follow: Which segments, shape (K,).
        working: Effects at work.
        settings: Those of the replay count.

    Returns:
        Shape (R, T, N, 6).
    """
    other = replay(predictor.model, predictor.timeline, predictor.segments, fit.point, settings.replay, working, follow)
    seen = fit.jacobian.base.pose[0]
    inside = predictor.segments.spread(follow)[..., None, None]
    return pose_difference(torch.where(inside, other, seen), seen)


def working_effects(predictor: Predictor, point: Variants, names: Sequence[str]) -> tuple[Effect, ...]:
    """Return some effects with the values that they have at a point."""
    values = {term.label: point.effects[0, k : k + 1] for k, term in enumerate(predictor.terms)}
    return tuple(
        kind(**{name: values[f"{kind.name}.{name}"] for name in kind.quantities()})
        for kind in predictor.candidates
        if kind.name in names
    )


def between(one: Variants, other: Variants, share: Tensor) -> Variants:
    """Return states between two points, by a share for each segment (K,); everything else is the other's."""
    part = share[:, None, None]
    turned = torch.where((one.pose[..., 3:] * other.pose[..., 3:]).sum(-1, keepdim=True) < 0, -1.0, 1.0)
    quaternion = one.pose[..., 3:] + part * (turned * other.pose[..., 3:] - one.pose[..., 3:])
    quaternion = quaternion / quaternion.norm(dim=-1, keepdim=True)
    position = one.pose[..., :3] + part * (other.pose[..., :3] - one.pose[..., :3])
    twist = one.twist + part * (other.twist - one.twist)
    return other.replace(pose=torch.cat([position, quaternion], -1), twist=twist)


def _renewed(experiment: Experiment, fit: Fit, names: Sequence[str], settings: Settings) -> Experiment:
    working = working_effects(experiment.predictor, fit.point, names)
    engine = simulator_discrepancy(experiment.predictor, fit, experiment.follow, working, settings)
    return experiment.replace(engine=engine)


def _by_segment(segments: Segmentation, mask: Tensor, first: Tensor, second: Tensor) -> Tensor:
    """Take the segments (K,) where `mask` holds from the first of two tables (R, T, N, 6), others from the second."""
    chosen = second.clone()
    for batch in segments.batches:
        rows = batch.inside & mask[batch.segments, None]
        row = batch.trajectory[:, None].expand_as(batch.frame)[rows]
        chosen[row, batch.frame[rows]] = first[row, batch.frame[rows]]
    return chosen
