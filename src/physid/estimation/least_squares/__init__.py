"""Weighted nonlinear least squares with initial states profiled out (variable projection), by Levenberg-Marquardt."""

from physid.estimation.least_squares.covariance import covariance_of, left_out, predictive_score, reach_of
from physid.estimation.least_squares.discretisation import (
    ChosenSteps,
    StepChoice,
    choose_steps,
    parts_for_late_forces,
)
from physid.estimation.least_squares.experiment import Experiment, Fit, lay_out
from physid.estimation.least_squares.first_guess import FirstGuess
from physid.estimation.least_squares.jacobian import Directions
from physid.estimation.least_squares.levenberg_marquardt import NONE, gauss_newton, solve_shared
from physid.estimation.least_squares.line_search import Step, best_step, try_losses
from physid.estimation.least_squares.multi_start import best_guess, carried, choose, search, try_new_states
from physid.estimation.least_squares.normal_equations import Linearised, Normal, Part
from physid.estimation.least_squares.prior import clamp_effects, prior
from physid.estimation.least_squares.settings import LeastSquaresSettings

__all__ = [
    "NONE",
    "ChosenSteps",
    "Directions",
    "Experiment",
    "FirstGuess",
    "Fit",
    "LeastSquaresSettings",
    "Linearised",
    "Normal",
    "Part",
    "Step",
    "StepChoice",
    "best_guess",
    "best_step",
    "carried",
    "choose",
    "choose_steps",
    "clamp_effects",
    "covariance_of",
    "gauss_newton",
    "lay_out",
    "left_out",
    "parts_for_late_forces",
    "predictive_score",
    "prior",
    "reach_of",
    "search",
    "solve_shared",
    "try_losses",
    "try_new_states",
]
