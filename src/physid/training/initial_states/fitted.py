"""Initial states that are fitted for given parameters."""

from __future__ import annotations

import torch
from torch import Tensor

from physid.estimation.least_squares.experiment import Experiment, Fit
from physid.estimation.least_squares.jacobian import Directions
from physid.estimation.least_squares.levenberg_marquardt import NONE, gauss_newton
from physid.training.initial_states.explaining import Explaining, States
from physid.training.parameters.gauss_newton import LIMITS

MOST = 10
"""Jacobians of one fit."""


@torch.no_grad()
def fit_states(
    explaining: Explaining,
    steps: int = MOST,
    logarithm: Tensor | None = None,
    states: States | None = None,
    directions: Directions | None = None,
) -> tuple[Experiment, Fit]:
    """Fit the initial states of trajectories, parameters as they are.

    Args:
        explaining: Trajectories, model and loss.
        steps: Most Jacobians.
        logarithm: Logarithms of the parameters, (P,); None for the present ones.
        states: Poses (B, N, 7) and twists (B, N, 6) to begin with; None for the best guess.
        directions: Free changes of the states; None for those that follow from which bodies lie on the ground.
    """
    experiment, point = explaining.begin(logarithm, states)
    if directions is not None:
        experiment = experiment.replace(directions=directions)
    return experiment, gauss_newton(experiment.with_known_parameters(), point, NONE, steps, LIMITS)
