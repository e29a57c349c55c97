"""What a fit shows of its recordings: trajectories of another body, and noise that is not white."""

from __future__ import annotations

import copy

import torch

from physid.estimation.segmented_fit import (
    OddSettings,
    UnexplainedSettings,
    odd_trajectories,
    squares_of_segments,
    unexplained_events,
)
from physid.inspection.finding import Finding
from physid.inspection.rules import fitted
from physid.training.initial_states.explaining import Explaining
from physid.training.initial_states.tracked import TrackedFit
from physid.training.initial_states.tracker_noise import noise_of_tracker
from physid.training.parameters import Pieces


@torch.no_grad()
def findings_of_fit(
    explaining: Explaining, tracked: TrackedFit, pieces: Pieces | None, settings: UnexplainedSettings
) -> tuple[Finding, ...]:
    """Return which trajectories have parameters of their own, and whether noise is alike in neighbouring frames.

    Trajectories that are cut into segments say nothing of these: each holds a part of what parameters do. Pieces around
    impacts say whether impacts are explained.

    Args:
        explaining: What was fitted.
        tracked: The fit of its initial states.
        pieces: Which pieces around impacts these are; None where they are not.
        settings: When impacts are not explained.
    """
    cut = explaining.trajectories
    fit, experiment = copy.copy(tracked).linearised(explaining)
    noise = noise_of_tracker(fit.jacobian.base.pose[0], cut, experiment.predictor.model.scene)
    known = cut.noise_beside(fit.residual, experiment.scale).of_tracker(noise)
    if pieces is not None:
        seen = cut.real.cpu()[..., None].expand(fit.residual.shape[:3])
        square = squares_of_segments(experiment.predictor.segments, fit.residual, seen)
        left = unexplained_events(square, pieces.struck, known, settings)
        return () if left is None else (fitted.unexplained_impacts(left, experiment.predictor.model.scene),)
    if len(cut.index.unique()) < len(cut):
        return ()
    spread = known.spread()
    experiment = experiment.replace(scale=(experiment.scale > 0) / spread)
    odd = odd_trajectories(experiment, fit, torch.ones(len(cut), dtype=torch.bool), OddSettings())
    found = [fitted.odd_trajectory(int(cut.index[one.row]), one.names, one.own, one.others) for one in odd]
    return (*found, fitted.correlated_noise(noise)) if noise else tuple(found)
