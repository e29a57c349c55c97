"""Rotations of a block that nobody can see: poses are compared modulo them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import Enum

import torch
from torch import Tensor

from physid.physics.rotations import multiply

LARGEST_ORDER = 4


class Symmetry(Enum):
    """The turns about a body's own z axis that leave its shape *and* its appearance as they were.

    A square block with a distinct pattern has none, a plain square one has four, a plain rectangle two.
    """

    NONE = 1
    RECTANGLE = 2
    SQUARE = 4

    @property
    def order(self) -> int:
        """Number of turns, counting the one by zero."""
        return self.value


def turns(symmetries: Sequence[Symmetry], like: Tensor) -> Tensor:
    """List the turns of each body as quaternions, in its own frame; repeated where a body has fewer than four.

    Returns:
        Unit quaternions, shape (N, 4, 4), with the type and device of `like`.
    """
    half = torch.tensor(
        [[math.pi * (k % s.order) / s.order for k in range(LARGEST_ORDER)] for s in symmetries], dtype=torch.float64
    )
    zero = torch.zeros_like(half)
    return torch.stack([zero, zero, half.sin(), half.cos()], -1).to(like)


def nearest(quaternion: Tensor, reference: Tensor, symmetries: Sequence[Symmetry]) -> Tensor:
    """Pick the turn of each body's rotation that is closest to a reference; its sign, too.

    Args:
        quaternion: Unit quaternions, shape (..., N, 4).
        reference: Unit quaternions, shape (..., N, 4).
        symmetries: One of each body.

    Returns:
        Unit quaternions that look like `quaternion`, shape (..., N, 4).
    """
    candidates = multiply(quaternion[..., None, :], turns(symmetries, quaternion))
    cosine = (candidates * reference[..., None, :]).sum(-1)
    best = cosine.abs().argmax(-1, keepdim=True)
    chosen = candidates.gather(-2, best[..., None].expand(*best.shape, 4)).squeeze(-2)
    return torch.where(cosine.gather(-1, best) < 0, -chosen, chosen)
