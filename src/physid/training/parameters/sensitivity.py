"""How predicted trajectories answer to the physical parameters."""

from __future__ import annotations

import torch
from torch import Tensor

from physid.estimation.measurement.poses import pose_difference
from physid.physics.layer import PhysicsLayer
from physid.training.parameters.physical_parameters import PhysicalParameters
from physid.training.parameters.trajectories import Trajectories

DIFFERENCE = 1e-3
"""Relative change of a parameter: far above the solver's smoothing, far below the scale on which trajectories bend."""


def residuals(
    layer: PhysicsLayer, parameters: PhysicalParameters, trajectories: Trajectories, logarithm: Tensor | None = None
) -> Tensor:
    """Predict trajectories from their initial states and compare them with what was recorded.

    Args:
        layer: The physics.
        parameters: The physical parameters.
        trajectories: What was recorded, B trajectories of T frames.
        logarithm: Logarithms of the learned parameters, (P,), or (B, P) for each trajectory its own; None for the
            present ones.

    Returns:
        Residuals (see `pose_difference`), shape (B, T, N, 6).
    """
    return pose_difference(trajectories.rolled(layer, parameters(logarithm)).pose, trajectories.pose)


@torch.no_grad()
def sensitivity(
    layer: PhysicsLayer, parameters: PhysicalParameters, trajectories: Trajectories, difference: float = DIFFERENCE
) -> Tensor:
    """Differentiate the residuals by the logarithms of the learned parameters.

    Central differences, all of them as one batch of 2 P B trajectories: J = (r(x + d) - r(x - d)) / 2 d.

    Args:
        layer: The physics.
        parameters: The physical parameters; J is taken at their present values.
        trajectories: What was recorded, B trajectories of T frames.
        difference: d, the relative change of a parameter.

    Returns:
        J, shape (P, B, T, N, 6), in m and rad per unit of ln(parameter).
    """
    here = parameters.logarithm.detach()
    count = len(here)
    moves = difference * torch.eye(count, dtype=here.dtype, device=here.device)
    points = (here + torch.cat([moves, -moves])).repeat_interleave(len(trajectories), 0)
    answer = residuals(layer, parameters, trajectories.repeated(2 * count), points)
    plus, minus = answer.unflatten(0, (2, count, len(trajectories)))
    slope: Tensor = (plus - minus) / (2 * difference)
    return slope
