"""Initial states that are fitted for given parameters, and first values of the parameters."""

from __future__ import annotations

import torch
from torch import Tensor

from physid.estimation.least_squares.experiment import Experiment, Fit
from physid.estimation.least_squares.first_guess import FirstGuess
from physid.estimation.least_squares.jacobian import Directions
from physid.estimation.least_squares.levenberg_marquardt import NONE, gauss_newton
from physid.physics.layer import PhysicsLayer, SolverError
from physid.training.initial_states.explaining import Explaining, States
from physid.training.parameters.gauss_newton import LIMITS
from physid.training.parameters.physical_parameters import PhysicalParameters
from physid.training.parameters.pose_loss import PoseLoss
from physid.training.parameters.trajectories import Trajectories

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


@torch.no_grad()
def guess_parameters(layer: PhysicsLayer, physical: PhysicalParameters, cut: Trajectories, guess: FirstGuess) -> int:
    """Replace the user's first guess by the fit to short segments; leave it where that has no solution.

    Args:
        layer: The physics.
        physical: The physical parameters, which are moved.
        cut: Short segments of the trajectories.
        guess: How values are found.

    Returns:
        How many rollouts of all trajectories that took.
    """
    explaining = Explaining(layer, physical, PoseLoss.weighed_by(cut.noise), cut)
    experiment, point = explaining.begin()
    try:
        fit = guess.fit(experiment, point)
    except SolverError:
        return experiment.predictor.simulated[0]
    physical.logarithm.copy_(fit.point.nominal[0].to(physical.logarithm))
    physical.confine()
    return experiment.predictor.simulated[0]
