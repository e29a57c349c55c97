"""A step of whatever optimizer a fit of physical parameters has."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from torch import Tensor

from physid.training.parameters.gauss_newton import GaussNewton, Quadratic
from physid.training.parameters.pattern_search import PatternSearch


def take_step(
    optimizer: Any,
    closure: Callable[[], Any],
    quadratic: Quadratic,
    values: Callable[[Tensor], Tensor],
    ends: tuple[Tensor, Tensor],
) -> None:
    """Take a step.

    Args:
        optimizer: GaussNewton is given the loss near by and the ends, PatternSearch the losses; others step as ever.
        closure: Computes the loss and its gradient.
        quadratic: Computes an approximate second derivative of the loss (P, P), and its slope (P,).
        values: Computes the losses (K,) at points (K, P).
        ends: Least and largest values, shape (P,) each.
    """
    kind = getattr(optimizer, "optimizer", optimizer)
    if isinstance(kind, GaussNewton):
        optimizer.step(closure=closure, quadratic=quadratic, ends=ends)
    elif isinstance(kind, PatternSearch):
        optimizer.step(closure=closure, values=values)
    else:
        optimizer.step(closure=closure)


def judge_last(optimizer: Any, values: Callable[[Tensor], Tensor]) -> None:
    """Judge a step that no other follows, where an optimizer leaves that to its next one (see `GaussNewton`)."""
    kind = getattr(optimizer, "optimizer", optimizer)
    if isinstance(kind, GaussNewton):
        kind.judge_last(values)


def take_back(optimizer: Any) -> bool:
    """Return to the best point that was judged so far, where an optimizer remembers one; whether it does."""
    if not isinstance(optimizer, GaussNewton):
        return False
    optimizer.take_back()
    return True


def uses_slopes(optimizer: Any) -> bool:
    """Return whether an optimizer trusts the slopes of a loss, as all but PatternSearch do."""
    return not isinstance(optimizer, PatternSearch)
