"""Initial states that are fitted for given parameters, and first values of the parameters."""

from __future__ import annotations

import contextlib
import dataclasses

import torch
from torch import Tensor

from physid.estimation.least_squares import Directions, Experiment, FirstGuess, Fit, LeastSquaresSettings, gauss_newton
from physid.estimation.least_squares.levenberg_marquardt import NONE
from physid.estimation.least_squares.settings import LineSearchSettings
from physid.estimation.measurement import frame_weights
from physid.physics import SolverError
from physid.training.initial_states.explaining import Explaining, States
from physid.training.parameters import Trajectories

MOST = 10
"""Jacobians of one fit."""
COMPARE = 3
"""Jacobians of the fits by which first values are compared."""
FITTING = LeastSquaresSettings(line_search=LineSearchSettings(dampings=(1e-3, 10.0, 1e3, 1e5), worth=6.0))
"""Steps that initial states try, as a run takes few of them at a time; and two noise variances for each of the three
velocities of a body that friction holds (Akaike 1974). A diagnosis, which compares effects by losses, asks for none."""


@torch.no_grad()
def fit_states(
    explaining: Explaining,
    steps: int = MOST,
    coordinates: Tensor | None = None,
    states: States | None = None,
    directions: Directions | None = None,
) -> tuple[Experiment, Fit]:
    """Fit the initial states of trajectories, parameters as they are.

    Args:
        explaining: Trajectories, model and loss.
        steps: Most Jacobians.
        coordinates: Of the parameters, (P,); None for the present ones.
        states: Poses (B, N, 7) and twists (B, N, 6) to begin with; None for the best guess.
        directions: Free changes of the states; None for those that follow from which bodies lie on the ground.
    """
    experiment, point = explaining.begin(coordinates, states)
    if directions is not None:
        experiment = experiment.replace(directions=directions)
    return experiment, gauss_newton(experiment.with_known_parameters().replace(settings=FITTING), point, NONE, steps)


@torch.no_grad()
def fit_beginnings(explaining: Explaining) -> Fit:
    """Fit the initial states of trajectories, parameters as they are, to frames that do not stand alone.

    Args:
        explaining: The beginnings of trajectories, model and loss.
    """
    _, fit = fit_states(explaining)
    cut = explaining.trajectories.stepped(explaining.layer.world.time_step).to("cpu")
    assert cut.time is not None
    real = cut.real[..., None].expand(cut.pose.shape[:3]).to(cut.pose)
    counted = (frame_weights(fit.residual, real, cut.time, cut.noise) > 0).all(-1)
    if torch.equal(counted, cut.real):
        return fit
    states = fit.point.pose[0], fit.point.twist[0]
    return fit_states(dataclasses.replace(explaining, counted=counted), states=states)[1]


@torch.no_grad()
def guess_parameters(explaining: Explaining, short: Trajectories, guess: FirstGuess) -> tuple[States | None, int]:
    """Replace the user's first guess by the fit to short segments where that explains the trajectories better.

    Args:
        explaining: Trajectories, model and loss; its parameters are moved.
        short: The same trajectories, cut into short segments.
        guess: How values are found.

    Returns:
        Initial states that were fitted for the better one, None where the physics has no solution for either; and how
        many rollouts of all trajectories that took.
    """
    experiment, point = dataclasses.replace(explaining, trajectories=short).begin()
    physical, tried = explaining.physical, []
    values = [physical.coordinates.detach().clone()]
    with contextlib.suppress(SolverError):
        values.append(guess.fit(experiment, point).point.nominal[0].to(physical.coordinates))
    rollouts = experiment.predictor.simulated[0]
    for coordinates in values:
        with contextlib.suppress(SolverError):
            other, fit = fit_states(explaining, COMPARE, coordinates)
            rollouts += other.predictor.simulated[0]
            tried.append((float(fit.loss.sum()), coordinates, fit))
    if not tried:
        return None, rollouts
    _, coordinates, fit = min(tried, key=lambda one: one[0])
    physical.coordinates.copy_(coordinates)
    physical.confine()
    return (fit.point.pose[0], fit.point.twist[0]), rollouts
