"""What is believed of parameters before any data: how far they may be, and where they must be."""

from __future__ import annotations

import torch
from torch import Tensor

from physid.estimation.least_squares.experiment import Experiment
from physid.estimation.prediction.coordinates import is_effect
from physid.estimation.prediction.rollout import Predictor


def prior(experiment: Experiment, effects: Tensor) -> Tensor:
    """Return weak priors of unknown parameters, the engine and some parameters of effects, shape (P + 1 + E,)."""
    predictor, settings = experiment.predictor, experiment.settings.prior
    spread = [settings.effect if is_effect(name) else settings.parameter for name in predictor.model.unknown]
    unknown = 1 / torch.tensor(spread, dtype=torch.float64) ** 2
    sizes = []
    for index in effects.tolist():
        known = predictor.terms[index].quantity
        sizes.append(1 / (settings.effect * (known.typical - known.null)) ** 2)
    engine = torch.full((1,), settings.engine**-2, dtype=torch.float64)
    return torch.cat([unknown, engine, torch.tensor(sizes, dtype=torch.float64)])


def clamp_engine(experiment: Experiment, share: Tensor) -> Tensor:
    """Keep the share of the difference between two engines in its range.

    Where they differ by a hair in all frames, hundreds of such differences would be what a camera stands aside.
    """
    most = experiment.settings.prior.engine
    return share.clamp(1 - most, 1 + most)


def clamp_effects(predictor: Predictor, values: Tensor) -> Tensor:
    """Keep parameters of effects (C, Q) in their ranges."""
    known = [term.quantity for term in predictor.terms]
    low = torch.tensor([one.low for one in known], dtype=torch.float64)
    high = torch.tensor([one.high for one in known], dtype=torch.float64)
    return values.clamp(low, high)
