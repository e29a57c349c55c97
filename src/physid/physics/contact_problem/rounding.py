"""How far rounding lets the equations of a contact problem be solved.

Where a contact slides with the speed s, in units of g h, the product z o w = tau = 1e-8 is a difference of numbers of
the size s^2, and slacks are as large as the distance of a contact per step: at s = 1e4 none is solved to 1e-11.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor
from torch.nn.functional import pad

ROUNDING = 16.0
"""How many times the rounding of what is at hand a solution may be off, beside the tolerance [-]."""


def allowance(jacobian: Tensor, offset: Tensor, free: Tensor, accepted: float) -> tuple[Tensor, Tensor]:
    """Return by how much errors of sums and of products may be larger than what is accepted elsewhere.

    Args:
        jacobian: J, shape (B, C, 3, n).
        offset: c, shape (B, C).
        free: Velocity without contacts, shape (B, n).
        accepted: Largest residual where nothing is large.

    Returns:
        Factors of at least 1, shapes (B,) and (B, 1, 1).
    """
    points = torch.einsum("bckn,bn->bck", jacobian.abs(), free.abs()).flatten(1)
    speed, distance = (pad(values.abs(), (0, 1)).amax(1) for values in (points, offset))
    share = ROUNDING * torch.finfo(offset.dtype).eps / accepted
    sums = 1 + share * (speed + distance)
    return sums, torch.maximum(1 + share * speed**2, sums)[:, None, None]


def largest_error(sums: Sequence[Tensor], product: Tensor, allowed: tuple[Tensor, Tensor]) -> Tensor:
    """Return the largest error of each world, of sums and of products, as if nothing large were at hand; shape (B,)."""
    of_sums, of_products = allowed
    parts = [part.flatten(1) / of_sums[:, None] for part in sums]
    return torch.cat([(product / of_products).flatten(1), *parts], 1).abs().amax(1)
