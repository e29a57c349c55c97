"""What the engine asks of a shape."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from physid.physics.contact import Patch

DISTINCT = 1e-5
"""How far a contact that takes the place of a repeated one lies from the others, of the half edges of the face [-]."""
FIRST = 1e-8
"""How much further a candidate must lie than one before it to be taken instead [-]: boxes that are placed evenly have
several that lie equally far, and rounding, which differs between the backends, must not decide."""


@dataclass(frozen=True)
class Placed:
    """A body where a step finds it.

    Attributes:
        body: Its index.
        pose: Shape (B, 7).
        size: Extents along its own axes [m], shape (B, 3).
    """

    body: int
    pose: Tensor
    size: Tensor


Finder = Callable[[Placed, Placed], Patch]
"""Finds the contacts of two bodies; the normal of the patch points from the first to the second."""


class Shape(ABC):
    """A shape, up to its extents along its own axes, which are parameters (`Parameters.size`).

    A new shape is one file: it says how far it reaches, how it turns, how it stands on the ground, and of which other
    shapes it knows the contacts. Formulas are of torch, batched, and differentiable in poses and sizes.
    """

    @abstractmethod
    def inertia(self, mass: Tensor, size: Tensor) -> Tensor:
        """Return the principal moments of a uniform body [kg m^2], (..., 3), from mass (...) and size (..., 3)."""

    @abstractmethod
    def reach(self, quaternion: Tensor, size: Tensor, normal: Tensor) -> Tensor:
        """Return how far bodies reach from their centres along a direction [m].

        Args:
            quaternion: Attitudes, shape (..., 4).
            size: Extents, shape (..., 3) [m].
            normal: Unit vector, shape (3,).

        Returns:
            Shape (...).
        """

    @abstractmethod
    def on_plane(self, body: Placed, normal: Tensor, offset: Tensor) -> Patch:
        """Find the contacts with the ground, the points p with normal (3,) . p = offset () [m]."""

    @abstractmethod
    def meets(self, other: Shape) -> Finder | None:
        """Return what finds the contacts of this shape, as the first, with another; None where it knows of none."""


def frame_of(normal: Tensor) -> Tensor:
    """Complete unit normals (..., 3) to right-handed frames with rows (normal, tangent, tangent), shape (..., 3, 3)."""
    axis = torch.zeros_like(normal).scatter(-1, normal.detach().abs().argmin(-1, keepdim=True), 1.0)
    first = axis - (axis * normal).sum(-1, keepdim=True) * normal
    first = first / first.square().sum(-1, keepdim=True).sqrt()
    return torch.stack([normal, first, torch.linalg.cross(normal, first)], -2)
