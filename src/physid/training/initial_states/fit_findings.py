"""What a fit shows of its recordings: trajectories of another body, and noise that is not white."""

from __future__ import annotations

import torch

from physid.estimation.least_squares import Experiment, Fit
from physid.estimation.segmented_fit import OddSettings, UnexplainedSettings, odd_trajectories, unexplained_events
from physid.inspection.finding import Finding
from physid.inspection.rules import fitted
from physid.training.initial_states.tracker_noise import noise_of_tracker
from physid.training.parameters import Pieces, Trajectories


def findings_of_fit(
    cut: Trajectories, experiment: Experiment, fit: Fit, pieces: Pieces | None = None
) -> tuple[Finding, ...]:
    """Return which trajectories have parameters of their own, and whether noise is alike in neighbouring frames.

    Trajectories that are cut into segments say nothing of these: each holds a part of what parameters do. Pieces around
    impacts say whether impacts are explained.

    Args:
        cut: What was fitted.
        experiment: The same.
        fit: The fit.
        pieces: Which pieces around impacts these are; None where they are not.
    """
    if pieces is not None:
        return _of_pieces(cut.to("cpu"), experiment, fit, pieces)
    if len(cut.index.unique()) < len(cut):
        return ()
    noise = noise_of_tracker(fit.jacobian.base.pose[0], cut, experiment.predictor.model.scene)
    spread = cut.noise_beside(fit.residual, experiment.scale).of_tracker(noise).spread()
    experiment = experiment.replace(scale=(experiment.scale > 0) / spread)
    odd = odd_trajectories(experiment, fit, torch.ones(len(cut), dtype=torch.bool), OddSettings())
    found = [fitted.odd_trajectory(int(cut.index[one.row]), one.names, one.own, one.others) for one in odd]
    return (*found, fitted.correlated_noise(noise)) if noise else tuple(found)


def _of_pieces(cut: Trajectories, experiment: Experiment, fit: Fit, pieces: Pieces) -> tuple[Finding, ...]:
    """Return whether most impacts are left unexplained."""
    square = fit.residual.unflatten(-1, (2, 3)).square().sum(-1).mean(2) * cut.real[..., None]
    mean = square.sum(1) / cut.real.sum(1).clamp_min(1)[:, None]
    noise = cut.noise_beside(fit.residual, experiment.scale)
    left = unexplained_events(mean, pieces.struck, noise, UnexplainedSettings())
    return () if left is None else (fitted.unexplained_impacts(left, experiment.predictor.model.scene),)
