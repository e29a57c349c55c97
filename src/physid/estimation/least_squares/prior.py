"""What is believed of parameters before any data: how far they may be, and where they must be."""

from __future__ import annotations

import torch
from torch import Tensor

from physid.estimation.prediction.rollout import Predictor


def prior(predictor: Predictor, effects: Tensor) -> Tensor:
    """Return weak priors of unknown parameters (a factor of 20 either way) and effects (ten typical sizes)."""
    unknown = torch.full((len(predictor.model.unknown),), 1 / 9.0, dtype=torch.float64)
    sizes = []
    for index in effects.tolist():
        known = predictor.terms[index].quantity
        sizes.append(1 / (10 * (known.typical - known.null)) ** 2)
    return torch.cat([unknown, torch.ones(1, dtype=torch.float64), torch.tensor(sizes, dtype=torch.float64)])


def clamp_effects(predictor: Predictor, values: Tensor) -> Tensor:
    """Keep parameters of effects (C, Q) in their ranges."""
    known = [term.quantity for term in predictor.terms]
    low = torch.tensor([one.low for one in known], dtype=torch.float64)
    high = torch.tensor([one.high for one in known], dtype=torch.float64)
    return values.clamp(low, high)
