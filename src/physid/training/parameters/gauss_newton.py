"""Gauss-Newton for the handful of physical parameters, as an optimizer that configurations name."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable
from typing import Any, final

import torch
from torch import Tensor, nn
from torch.optim import Optimizer

from physid.estimation.least_squares.line_search import Limits

LIMITS = Limits(dampings=(1e-3, 10.0, 1e3, 1e5), parts=(0.5, 0.2, 0.05, 0.01, 0.0))
"""Steps that are tried: first guesses may be far off, and a run tries few of them at a time."""


@final
class GaussNewton(Optimizer):
    """Minimise a sum of squares over parameters and unknown initial states (see `gauss_newton`), a step at a time.

    Args:
        params: One tensor of parameters.
        max_step: Largest change of one parameter in a step, in its own unit.

    Raises:
        ValueError: If there is more than one tensor, or a setting is not positive.
    """

    def __init__(self, params: Iterable[nn.Parameter], max_step: float = 1.0) -> None:
        if not max_step > 0:
            raise ValueError(f"max_step must be positive, got {max_step}")
        super().__init__(params, {"max_step": max_step})
        if [len(group["params"]) for group in self.param_groups] != [1]:
            raise ValueError("GaussNewton takes one tensor, the physical parameters; use Adam for networks")

    def step(self, closure: Callable[[], Any] | None = None, advance: Callable[[Limits], Tensor] | None = None) -> Any:
        """Take a step.

        Args:
            closure: Computes the loss.
            advance: Returns better parameters than those at which the loss was computed, of the same shape.

        Returns:
            The loss before the step.

        Raises:
            ValueError: If closure or advance is missing.
        """
        if closure is None or advance is None:
            raise ValueError("GaussNewton needs a closure and what takes a step; SysID gives both")
        with torch.enable_grad():
            loss = closure()
        group = self.param_groups[0]
        with torch.no_grad():
            parameter = group["params"][0]
            parameter.copy_(advance(dataclasses.replace(LIMITS, largest=group["max_step"])))
        return loss
