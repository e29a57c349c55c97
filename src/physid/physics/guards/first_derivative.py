"""Derivatives that may not be differentiated again."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor


def only_first(gradients: Sequence[Tensor | None], sources: Sequence[Tensor | None]) -> tuple[Tensor | None, ...]:
    """Return gradients that refuse to be differentiated, where torch would otherwise take parts of them as constant.

    The solution of a contact problem enters its own derivative. A second derivative would need the derivative of that,
    which nobody has written; without it, torch would return a wrong number.

    Args:
        gradients: What a backward function returns.
        sources: What they depend on: all that entered the forward function, and the gradients that it was given.
    """
    known = [source for source in sources if source is not None and source.requires_grad]
    if not torch.is_grad_enabled() or not known:
        return tuple(gradients)
    return tuple(None if each is None else _First.apply(each.detach(), *known) for each in gradients)  # type: ignore[no-untyped-call]


class _First(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, gradient: Tensor, *sources: Tensor) -> Tensor:
        return gradient.clone()

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        raise RuntimeError(
            "the physics has first derivatives only: a second derivative was asked for (a Hessian, or a gradient of a "
            "gradient); use differences of first derivatives, or Gauss-Newton, which needs no second one"
        )
