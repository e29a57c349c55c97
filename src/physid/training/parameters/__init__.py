"""Physical parameters that are learned, the errors of poses and their loss, and the steps and intervals of a fit."""

from physid.training.parameters.gauss_newton import GaussNewton
from physid.training.parameters.identifiability import ACCEPT, Identifiability, SensorNoise, percent
from physid.training.parameters.intervals import RIDGE, ROUNDING, Response, known, normal_of, ridge_of
from physid.training.parameters.metrics import PoseErrors
from physid.training.parameters.physical_parameters import PhysicalParameters
from physid.training.parameters.pieces import Pieces
from physid.training.parameters.pose_loss import PoseLoss, mean_over_time
from physid.training.parameters.posterior import Posterior, holds_samples, read_posterior
from physid.training.parameters.taking_steps import judge_last, take_back, take_step, uses_slopes
from physid.training.parameters.trajectories import Trajectories

__all__ = [
    "ACCEPT",
    "RIDGE",
    "ROUNDING",
    "GaussNewton",
    "Identifiability",
    "PhysicalParameters",
    "Pieces",
    "PoseErrors",
    "PoseLoss",
    "Posterior",
    "Response",
    "SensorNoise",
    "Trajectories",
    "holds_samples",
    "judge_last",
    "known",
    "mean_over_time",
    "normal_of",
    "percent",
    "read_posterior",
    "ridge_of",
    "take_back",
    "take_step",
    "uses_slopes",
]
