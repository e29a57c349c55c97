"""Arithmetic in a product of half lines and second-order cones of size 3, the cones of `friction`."""

from __future__ import annotations

import torch
from torch import Tensor


def jordan(first: Tensor, second: Tensor, linear: int) -> Tensor:
    """Multiply in the product cone: numbers one by one, (x0, x) o (y0, y) = (x0 y0 + x.y, x0 y + y0 x)."""
    if first.shape[-1] == linear:
        return first * second
    x, y = first[..., linear:], second[..., linear:]
    head = (x * y).sum(-1, keepdim=True)
    tail = x[..., :1] * y[..., 1:] + y[..., :1] * x[..., 1:]
    return torch.cat([first[..., :linear] * second[..., :linear], head, tail], -1)


def arrow(value: Tensor, linear: int) -> Tensor:
    """Return the matrix of y -> value o y, shape (..., m, m)."""
    matrix = torch.diag_embed(value)
    if value.shape[-1] > linear:
        cone = value[..., linear:]
        matrix[..., linear, linear:] = cone
        matrix[..., linear:, linear] = cone
        matrix[..., linear + 1, linear + 1] = cone[..., 0]
        matrix[..., linear + 2, linear + 2] = cone[..., 0]
    return matrix


def cone_length(x: Tensor, dx: Tensor) -> Tensor:
    """Return the largest a with x + a dx in the second-order cone: the first root of a quadratic, shape (...)."""
    a = dx[..., 0] ** 2 - dx[..., 1:].square().sum(-1)
    b = x[..., 0] * dx[..., 0] - (x[..., 1:] * dx[..., 1:]).sum(-1)
    c = (x[..., 0] ** 2 - x[..., 1:].square().sum(-1)).clamp_min(0)
    divisor = -b + (b**2 - a * c).clamp_min(0).sqrt()
    return torch.where((divisor > 0) & ~((a >= 0) & (b >= 0)), c / divisor, torch.inf)


def longest_step(value: Tensor, change: Tensor, linear: int) -> Tensor:
    """Return the largest a with value + a change in the cones, for C vectors (B, C, m) each; shape (B,)."""
    limits = [value.new_full((len(value), 1), torch.inf)]
    limits.append(torch.where(change < 0, -value / change, torch.inf)[..., :linear].flatten(1))
    if value.shape[-1] > linear:
        limits.append(cone_length(value[..., linear:], change[..., linear:]))
    return torch.cat(limits, 1).amin(1)
