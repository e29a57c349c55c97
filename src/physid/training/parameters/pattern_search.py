"""Search on a lattice, for losses whose slope says nothing: tumbling and bouncing amplify every difference."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import product
from typing import Any, final

import torch
from torch import Tensor, nn
from torch.optim import Optimizer


@final
class PatternSearch(Optimizer):
    """Move to the best of the 3^P - 1 neighbours on a lattice, or halve its spacing where none is better.

    Only values of the loss count, and they are compared over the distance of the spacing: ripples that are finer have
    no say (Hooke & Jeeves 1961).

    Args:
        params: One tensor of parameters.
        spacing: First distance of neighbours, in the unit of the parameters.

    Raises:
        ValueError: If there is more than one tensor, or the spacing is not positive.
    """

    def __init__(self, params: Iterable[nn.Parameter], spacing: float = 0.3) -> None:
        if spacing <= 0:
            raise ValueError(f"spacing must be positive, got {spacing}")
        super().__init__(params, {"spacing": spacing})
        if [len(group["params"]) for group in self.param_groups] != [1]:
            raise ValueError("PatternSearch takes one tensor, the physical parameters; use Adam for networks")

    def step(self, closure: Callable[[], Any] | None = None, values: Callable[[Tensor], Tensor] | None = None) -> Any:
        """Compare the neighbours, and move.

        Args:
            closure: Computes the loss.
            values: Computes the losses of K points (K, P), shape (K,).

        Returns:
            The loss before the step.

        Raises:
            ValueError: If closure or values is missing.
        """
        if closure is None or values is None:
            raise ValueError("PatternSearch needs a closure and the losses of other points; SysID gives both")
        with torch.enable_grad():
            loss = closure()
        group = self.param_groups[0]
        parameter = group["params"][0]
        lattice = torch.tensor([each for each in product((-1, 0, 1), repeat=parameter.numel()) if any(each)])
        with torch.no_grad():
            points = parameter + group["spacing"] * lattice.to(parameter)
            found = values(points)
            best = int(found.nan_to_num(torch.inf).argmin())
            if found[best] < torch.as_tensor(loss):
                parameter.copy_(points[best])
            else:
                group["spacing"] /= 2
        return loss
