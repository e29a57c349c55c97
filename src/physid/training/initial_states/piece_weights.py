"""How much pieces of trajectories count where a fit over them stands."""

from __future__ import annotations

import copy
from dataclasses import replace

import torch

from physid.estimation.least_squares import Normal
from physid.estimation.segmented_fit import SegmentedFitSettings, agreed_weights, own_weights
from physid.training.initial_states.explaining import Explaining
from physid.training.initial_states.tracked import TrackedFit
from physid.training.parameters import Pieces


@torch.no_grad()
def weighed_anew(pieces: Pieces, explaining: Explaining, tracked: TrackedFit, settings: SegmentedFitSettings) -> Pieces:
    """Let pieces count as little as their misfit says where a fit stands, and none more than pieces agree on.

    The steps of the engine, the parameters, and the initial states with them, have changed since they were weighed.

    Args:
        pieces: The pieces.
        explaining: The pieces with their steps, model and loss.
        tracked: The fit of their initial states.
        settings: What decides.
    """
    alike = replace(explaining, trajectories=replace(explaining.trajectories, weight=None))
    fit, experiment = copy.copy(tracked).linearised(alike)
    cut = alike.trajectories.to("cpu")
    noise = cut.noise_beside(fit.residual, experiment.scale)
    square = (fit.residual / noise.spread()).square().mean((2, 3))
    misfit = (square * cut.real).sum(1) / cut.real.sum(1).clamp_min(1)
    doubtful = torch.full_like(misfit, settings.rounds.own_weights, dtype=torch.bool)
    own = own_weights(misfit, misfit.median().clamp_min(1), doubtful)
    known, unit = fit.normal(), own * (cut.noise.position / noise.position) ** 2
    known = Normal(unit[:, None, None] * known.matrix, unit[:, None] * known.vector, unit * known.square)
    return replace(pieces, weight=own * agreed_weights(known, settings.agreement))
