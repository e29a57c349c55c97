"""How trajectories answer to the states that they start from: what is lost where these must be estimated as well."""

from __future__ import annotations

import dataclasses

import torch
from torch import Tensor

from physid.estimation.measurement.poses import pose_difference
from physid.physics.layer import PhysicsLayer
from physid.physics.rotations import exponential, multiply
from physid.training.parameters.physical_parameters import PhysicalParameters
from physid.training.parameters.slopes import BEND, FAINT, norms
from physid.training.parameters.trajectories import Trajectories

MOVE = 1e-4
"""Step of the differences [m, rad, m/s, rad/s]: a tenth of what a good sensor resolves."""


@torch.no_grad()
def project_out_initial_states(
    layer: PhysicsLayer, parameters: PhysicalParameters, trajectories: Trajectories, answer: Tensor, scale: Tensor
) -> Tensor:
    """Take out of derivatives what another initial state would do as well.

    Place, attitude and velocity of every body in the first frame are unknowns of each trajectory; what remains
    is J - A (A^T A)^+ A^T J, with A the derivatives by them, both in units of the noise. A move without a usable slope,
    say that of a standing block into the ground, counts as impossible.

    Args:
        layer: The physics.
        parameters: The physical parameters.
        trajectories: What was predicted, B of T frames.
        answer: J, shape (P, B, T, N, 6).
        scale: One over the noise of each coordinate, shape (6,).

    Returns:
        What remains of J, of the same shape.
    """
    coarse, fine = (_moved(layer, parameters, trajectories, MOVE / share) for share in (1, 4))
    real = trajectories.real[:, :, None, None]
    keep = norms(coarse - fine) <= torch.maximum(BEND * norms(fine), torch.full_like(norms(fine), FAINT))
    seen = (fine * scale * real * keep[..., None, None, None]).flatten(2).permute(1, 2, 0)
    wanted = (answer * scale * real).flatten(2).permute(1, 2, 0)
    basis, strength, _ = torch.linalg.svd(seen, full_matrices=False)
    basis = basis * (strength > 1e-9 * strength[:, :1])[:, None]
    rest = wanted - basis @ (basis.mT @ wanted)
    remaining: Tensor = rest.permute(2, 0, 1).reshape(answer.shape) / scale
    return remaining


def _moved(
    layer: PhysicsLayer, parameters: PhysicalParameters, trajectories: Trajectories, difference: float
) -> Tensor:
    """Return central differences by the 12 N coordinates of the initial state, shape (12 N, B, T, N, 6)."""
    count, (batch, _, bodies, _) = 12 * trajectories.pose.shape[2], trajectories.pose.shape
    moves = difference * torch.eye(count, dtype=trajectories.pose.dtype).reshape(count, bodies, 12)
    moves = torch.cat([moves, -moves]).repeat_interleave(batch, 0)
    many = trajectories.repeated(2 * count)
    pose, twist = many.start.pose, many.start.twist + moves[..., 6:]
    attitude = multiply(exponential(moves[..., 3:6]), pose[..., 3:])
    first = torch.cat([pose[..., :3] + moves[..., :3], attitude], -1)
    rollout = dataclasses.replace(many, origin=torch.cat([first, twist], -1)).rolled(layer, parameters())
    plus, minus = pose_difference(rollout.pose, many.pose).unflatten(0, (2, count, batch))
    slope: Tensor = (plus - minus) / (2 * difference)
    return slope
