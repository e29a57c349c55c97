"""Initial states that no step by a slope leads to: guessed anew once an effect is known, and varied."""

from __future__ import annotations

import torch
from torch import Tensor

from physid.estimation.least_squares.experiment import Experiment, Fit, seen_frames
from physid.estimation.least_squares.initial_states import InitialStates, guess_initial_states
from physid.estimation.least_squares.levenberg_marquardt import bodies_at_rest, gauss_newton
from physid.estimation.least_squares.line_search import try_losses
from physid.estimation.measurement.poses import moved, pose_difference
from physid.estimation.prediction.variants import Prediction, Variants


def best_guess(
    experiment: Experiment, initial: InitialStates, nominal: Tensor | None = None, before: Prediction | None = None
) -> Variants:
    """Return a first point, with the guess of each segment's initial state that explains it best.

    Where a prediction `before` is known, say of shorter segments, its states are guesses as well: the speed that some
    noisy frames suggest may let bodies hit each other that have passed, and no step leads back from there.

    Args:
        experiment: What to explain.
        initial: Guesses.
        nominal: Unknown parameters in the coordinates of the fit, (1, P); None for the model's guess.
        before: What was predicted before.
    """
    predictor, segments = experiment.predictor, experiment.predictor.segments
    pose, twist = initial.pose, initial.twist
    if before is not None:
        more = (value[:, segments.trajectory, segments.start] for value in (before.state, before.twist))
        pose, twist = (torch.cat(pair) for pair in zip((pose, twist), more, strict=True))
    pose, twist = experiment.directions.level(pose, twist)
    nominal = predictor.model.guess[None] if nominal is None else nominal
    one = Variants.of_states(pose[:1], twist[:1], nominal, predictor.null[None])
    many = one.repeat(len(pose)).replace(pose=pose, twist=twist)
    return choose(experiment, many)


def guesses(experiment: Experiment, point: Variants) -> Variants:
    """Return the point itself, and with new guesses of all initial states.

    Before a strong effect was known, a body hit the ground too early or too late, or friction stopped it at once, and
    no small step leads from there to the right state. What the effects change of observed poses is taken off before
    they are looked at.
    """
    predicted = experiment.predictor.predict(point)
    pose = moved(experiment.pose, pose_difference(predicted.state, predicted.pose)[0])
    return _guessed(experiment, point, pose, seen_frames(experiment.scale))


def carried(experiment: Experiment, fit: Fit, point: Variants) -> Variants:
    """Return a point with initial states from which the camera sees what a fit predicts, where that explains more.

    The point's effects act on what is seen: s is found from p = observe(s) by s <- s + p - observe(s), as long as that
    comes nearer. A lens that folds the picture has no such s beyond the fold.

    Args:
        experiment: What to explain.
        fit: A fit, with other effects.
        point: Its initial states, and the effects and unknown parameters that are tried.
    """
    state = _from_seen(experiment, fit.jacobian.base.pose, point)
    return choose(experiment, _guessed(experiment, point, state[0], torch.ones_like(state[0, ..., 0])))


def _from_seen(experiment: Experiment, seen: Tensor, point: Variants) -> Tensor:
    """Return the poses of which a camera with the effects of a point sees these, (1, R, T, N, 7), as near as it can."""
    state, off = seen, pose_difference(seen, experiment.predictor.observe(seen, point))
    for _ in range(experiment.settings.multi_start.undo):
        nearby = moved(state, off)
        left = pose_difference(seen, experiment.predictor.observe(nearby, point))
        nearer = left.norm(dim=-1, keepdim=True) < off.norm(dim=-1, keepdim=True)
        state, off = torch.where(nearer, nearby, state), torch.where(nearer, left, off)
    return state


def _guessed(experiment: Experiment, point: Variants, pose: Tensor, weight: Tensor) -> Variants:
    """Return the point itself, and with initial states guessed from poses (R, T, N, 7)."""
    predictor, settings = experiment.predictor, experiment.settings.guess
    time, scene = predictor.timeline.time, predictor.model.scene
    initial = guess_initial_states(pose, weight, time, predictor.segments, scene, settings=settings)
    guessed = experiment.directions.level(initial.pose, initial.twist)
    return point.repeat(1 + len(initial.pose)).replace(
        pose=torch.cat([point.pose, guessed[0]]), twist=torch.cat([point.twist, guessed[1]])
    )


def choose(experiment: Experiment, many: Variants, present: Variants | None = None) -> Variants:
    """Keep for each segment the initial state, of several, that explains it best.

    Args:
        experiment: What to explain.
        many: The states.
        present: The first of them, which is returned itself where no other explains any segment better.
    """
    best = try_losses(experiment, many).argmin(0)
    return _picked(many, best) if present is None or bool(best.any()) else present


def try_new_states(experiment: Experiment, point: Variants) -> Variants:
    """Guess initial states anew, and keep what explains a segment better; the point itself if nothing does."""
    return choose(experiment, guesses(experiment, point), point)


def search(experiment: Experiment, fit: Fit, rival: Fit | None = None) -> Variants:
    """Look for initial states that no step by a slope leads to, and keep what explains a segment better.

    Those of badly fitted segments are fitted from new guesses, those of bodies that hardly move from rest (if their
    velocities must be worth it), those that a rival explains better from the motion that it found, and those of all
    segments are varied (`varied`). Where most segments fit badly it is the model that is wrong, and nothing is tried.

    Args:
        experiment: What to explain.
        fit: Where.
        rival: Another fit of the same segments, with other effects.
    """
    segments, settings = experiment.predictor.segments, experiment.settings.multi_start
    count = segments.sum_frames((experiment.scale > 0).sum((2, 3))[None].double())[0]
    doubtful = fit.loss > settings.doubtful * count
    if float(doubtful.double().mean()) > settings.most:
        return fit.point
    point = _refitted(experiment, fit, doubtful, guesses(experiment, fit.point)) if bool(doubtful.any()) else fit.point
    if experiment.settings.line_search.worth > 0:
        resting, still = bodies_at_rest(experiment, point, each=True)
        point = _refitted(experiment, experiment.at(point, fit), still.any(2).any(0), resting)
    if rival is not None and bool((rival.loss < fit.loss).any()):
        there = experiment.at(point, fit)
        point = _refitted(experiment, there, rival.loss < there.loss, _in_motion_of(rival, experiment, point))
    return varied(experiment, fit, point)


def _in_motion_of(rival: Fit, experiment: Experiment, point: Variants) -> Variants:
    """Return the point itself, and with the initial states of another fit, as a camera with the point's effects saw."""
    segments = experiment.predictor.segments
    begun = _from_seen(experiment, rival.jacobian.base.pose, point)[:, segments.trajectory, segments.start]
    pose, twist = experiment.directions.level(begun, rival.point.twist)
    pose = experiment.directions.with_heights_of(point.pose, pose)
    return point.repeat(2).replace(pose=torch.cat([point.pose, pose]), twist=torch.cat([point.twist, twist]))


def varied(experiment: Experiment, fit: Fit, point: Variants) -> Variants:
    """Draw initial states about those of a point, and keep what explains a segment better.

    Where dry friction stops or turns a body the loss has a kink. On its edge it may still fall along the edge, while
    a step by the slope of either side leads up the other side, so that a fit ends there. Draws are normal, with
    several multiples of the deviations that the linearised fit leaves of each segment's state.

    Args:
        experiment: What to explain.
        fit: A fit near the point, linearised.
        point: Where; a single variant.
    """
    settings = experiment.settings.multi_start
    if not settings.draws or not experiment.directions.used:
        return point
    factor = fit.linear.gather(lambda part: part.factor.mT)
    generator = torch.Generator().manual_seed(0)  # a run that is resumed must draw what it would have drawn
    scales = torch.tensor(settings.scales, dtype=factor.dtype).repeat_interleave(settings.draws)
    normal = torch.randn(len(scales), *factor.shape[:2], generator=generator, dtype=factor.dtype)
    change = torch.linalg.solve_triangular(factor, normal[..., None] * scales[:, None, None, None], upper=True)
    many = point.repeat(1 + len(scales))
    pose, twist = experiment.directions.move(many.pose[1:], many.twist[1:], change[..., 0])
    many = many.replace(pose=torch.cat([point.pose, pose]), twist=torch.cat([point.twist, twist]))
    return choose(experiment, many, point)


def _refitted(experiment: Experiment, fit: Fit, chosen: Tensor, many: Variants) -> Variants:
    """Fit the initial states of some segments, a mask (K,), from all but the first of several.

    A wrong initial state and wrong parameters may hold each other, so that neither moves alone: the guess has to be
    fitted before it is compared.
    """
    settings, chosen = experiment.settings.multi_start, chosen.nonzero()[:, 0]
    if not len(chosen):
        return fit.point
    alone = experiment.with_known_parameters().only(chosen, fit.jacobian.base.state[0])
    found, losses = [fit.point], [fit.loss]
    for k in range(1, len(many)):
        tried = gauss_newton(alone, _of(many[k : k + 1], chosen), fit.effects[:0], settings.rounds)
        pose, twist = fit.point.pose.clone(), fit.point.twist.clone()
        pose[:, chosen], twist[:, chosen] = tried.point.pose, tried.point.twist
        found.append(fit.point.replace(pose=pose, twist=twist))
        losses.append(torch.full_like(fit.loss, torch.inf).index_copy(0, chosen, tried.loss))
    return _picked(Variants.join(found), torch.stack(losses).argmin(0))


def _of(point: Variants, chosen: Tensor) -> Variants:
    """Return the initial states of some segments only."""
    return point.replace(pose=point.pose[:, chosen], twist=point.twist[:, chosen])


def _picked(many: Variants, best: Tensor) -> Variants:
    """Return for each segment the initial state of one variant, best (K,)."""
    pick = torch.arange(len(best))
    return many[:1].replace(pose=many.pose[best, pick][None], twist=many.twist[best, pick][None])
