"""How predictions answer to the parameters, from given initial states or from any."""

from __future__ import annotations

import torch
from torch import Tensor

from physid.estimation.least_squares.jacobian import usable_slopes
from physid.estimation.least_squares.levenberg_marquardt import NONE
from physid.physics import PhysicsLayer
from physid.training.initial_states.explaining import Explaining
from physid.training.parameters import PhysicalParameters, PoseLoss, Trajectories


@torch.no_grad()
def slopes(layer: PhysicsLayer, physical: PhysicalParameters, cut: Trajectories) -> tuple[Tensor, Tensor]:
    """Differentiate predictions from given initial states (see `usable_slopes`).

    Returns:
        Derivatives by ln(parameter) (P, B, T, N, 6), and which trajectories they can be relied on for, (B,).
    """
    experiment, point = Explaining(layer, physical, PoseLoss(), cut, fitted=False).begin()
    return usable_slopes(experiment.predictor, point, experiment.directions, cut.real.cpu())


@torch.no_grad()
def without_initial_states(
    layer: PhysicsLayer, physical: PhysicalParameters, cut: Trajectories, answer: Tensor, spread: Tensor
) -> Tensor:
    """Take out of derivatives (P, B, T, N, 6) what other initial states would do as well, by the noise (6,)."""
    experiment, point = Explaining(layer, physical, PoseLoss(), cut).begin(states=(cut.start.pose, cut.start.twist))
    scale = (cut.real.cpu()[..., None, None] / spread).expand_as(experiment.scale)
    return experiment.replace(scale=scale).linearise(point, NONE).linear.profile(answer * scale) * spread
