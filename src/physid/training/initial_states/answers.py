"""What training segments say of the parameters, their initial states fitted where they are unknown."""

from __future__ import annotations

import copy
from collections.abc import Callable

import torch
from torch import Tensor

from physid.estimation.least_squares import FirstGuess
from physid.training.initial_states.elimination import slopes, without_initial_states
from physid.training.initial_states.explaining import Explaining, started, started_from
from physid.training.initial_states.fit_findings import findings_of_fit as findings_of_fit
from physid.training.initial_states.fitted import fit_states, guess_parameters
from physid.training.initial_states.tracked import TrackedFit
from physid.training.parameters import Identifiability, Response, SensorNoise, Trajectories

JUDGED = 8  # trajectories that suffice to judge what is identifiable


def improve(explaining: Explaining, tracked: TrackedFit, *, afresh: bool) -> tuple[Trajectories, int]:
    """Improve initial states, and return segments from them, and how many rollouts that took.

    The states are constants: at the best ones the gradient of the loss with the states held is that of the loss of
    which they are fitted anew (envelope theorem). How they follow the parameters is any number where friction stops a
    start at once, and times what is left of their own slope it would be no small part of the gradient.

    Args:
        explaining: The segments.
        tracked: The fit of their initial states.
        afresh: See `TrackedFit.improve`.
    """
    fit, rollouts = tracked.improve(explaining, afresh=afresh)
    return started_from(explaining.trajectories, fit), rollouts


def guess(explaining: Explaining, tracked: TrackedFit, short: Trajectories, how: FirstGuess) -> int:
    """Find first values of the parameters and initial states that go with them; return how many rollouts it took."""
    states, rollouts = guess_parameters(explaining, short, how)
    tracked.begin(explaining, states)
    return rollouts


@torch.no_grad()
def losses_at(explaining: Explaining, tracked: TrackedFit, points: Tensor) -> tuple[Tensor, int]:
    """Compute the loss of each segment at K points (K, P), shape (K, B), and count the rollouts."""
    cut, physical = explaining.trajectories, explaining.physical
    points = physical.space.within(points)
    many, every, rollouts = cut.repeated(len(points)), points.repeat_interleave(len(cut), 0), len(points)
    if explaining.fitted:
        states = tracked.states(explaining)
        fits = [fit_states(explaining, coordinates=point, states=states) for point in points]
        rollouts += sum(experiment.predictor.simulated[0] for experiment, _ in fits)
        pose = torch.cat([fit.jacobian.base.state[0, :, 0] for _, fit in fits])
        many = started(many, pose, torch.cat([fit.point.twist[0] for _, fit in fits]))
    losses = explaining.loss(many.residual(explaining.layer, physical(every)), many.real)
    return torch.stack(list(losses.values())).sum(0).unflatten(0, (len(points), -1)) * cut.share, rollouts


@torch.no_grad()
def respond(explaining: Explaining, tracked: TrackedFit) -> tuple[Trajectories, Response]:
    """Return segments from states fitted for the present parameters, and how estimates respond there."""
    cut = explaining.trajectories
    # Not the fit that is tracked: a run that goes on must not depend on where it was looked at.
    fit, experiment = copy.copy(tracked).linearised(explaining)
    if explaining.fitted:
        cut = started_from(cut, fit)
    return cut, Response.of(experiment, fit, cut.index, cut.noise_beside(fit.residual, experiment.scale))


def respond_coarsely(losses: Callable[[Tensor], Tensor], explaining: Explaining, index: Tensor) -> Response:
    """Return how estimates respond where slopes mean nothing, from the losses (K, B) at points (K, P)."""
    return Response.coarse(losses, explaining.physical.coordinates.detach(), index)


def judge(explaining: Explaining, tracked: TrackedFit, noise: SensorNoise | None) -> Identifiability:
    """Judge what some trajectories tell, under their own noise if none is given."""
    layer, physical, spread = explaining.layer, explaining.physical, (noise or explaining.trajectories.noise).spread()
    cut = tracked.started(explaining).to("cpu")
    cut = cut.chosen((cut.index[:, None] == cut.index.unique()[:JUDGED]).any(1))
    answer, usable = slopes(layer, physical, cut)
    usable = usable | ~usable.any()  # better all than none
    cut, answer = cut.chosen(usable), answer[:, usable]
    if explaining.fitted:
        answer = without_initial_states(layer, physical, cut, answer, spread)
    return Identifiability.of(physical.names, answer, cut.real, spread)
