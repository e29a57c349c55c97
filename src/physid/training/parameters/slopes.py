"""Derivatives of trajectories that can be relied on: those that two step sizes agree on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

from torch import Tensor

from physid.physics.layer import PhysicsLayer
from physid.training.parameters.physical_parameters import PhysicalParameters
from physid.training.parameters.sensitivity import DIFFERENCE, sensitivity
from physid.training.parameters.trajectories import Trajectories

BEND = 0.1
"""Largest relative change of a trajectory's derivative between two step sizes; beyond it there is no usable slope."""
FAINT = 1e-5
"""Derivatives below this [m, rad] say nothing, whether they change or not."""


@final
@dataclass(frozen=True)
class Slopes:
    """Derivatives of B trajectories, and whether they can be relied on.

    Attributes:
        sensitivity: J, see `physid.training.parameters.sensitivity`; shape (P, B, T, N, 6).
        usable: Which trajectories can be relied on, shape (B,): after a collision or a bounce a tiny change of a
            parameter may decide what comes next.
    """

    sensitivity: Tensor
    usable: Tensor

    @property
    def bent(self) -> int:
        """How many trajectories cannot be relied on."""
        return int((~self.usable).sum())


def slopes(layer: PhysicsLayer, parameters: PhysicalParameters, trajectories: Trajectories) -> Slopes:
    """Differentiate trajectories with two step sizes, and find those where they disagree.

    A derivative that holds for tiny changes alone promises more than any fit can find.

    Args:
        layer: The physics.
        parameters: The physical parameters; derivatives are taken at their present values.
        trajectories: What was recorded, or what the layer itself predicts; B of T frames.
    """
    coarse, fine = (sensitivity(layer, parameters, trajectories, DIFFERENCE / share) for share in (1, 4))
    real = trajectories.real[:, :, None, None]
    change, size = (norms(value * real).square().sum(0).sqrt() for value in (coarse - fine, fine))
    keep = (change <= BEND * size) | (change <= FAINT)
    return Slopes(fine, keep)


def norms(value: Tensor) -> Tensor:
    """Return the root of the sum of squares (K, B) of values (K, B, ...)."""
    return value.flatten(2).square().sum(2).sqrt()
