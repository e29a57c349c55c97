"""The rollout step by step in torch: on any device, of any precision, with all shapes, joints and laws of friction."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import torch
from torch import Tensor
from torch.utils.checkpoint import checkpoint

from physid.physics.case import Case, Outcome
from physid.physics.effect import StepInputs
from physid.physics.state import State
from physid.physics.step import Step, advance

Stepping = Callable[[State, StepInputs, Tensor], Step]
"""Advances states by one step of a given length (B or 1,) [s]."""
Check = Callable[[Tensor, Tensor, int], None]
"""Told which worlds failed (B,), the residuals (B,) and the frame; raises an error if one failed."""


def roll(case: Case, check: Check, every: int | None, stepping: Stepping | None = None) -> Outcome:
    """Roll worlds out.

    Args:
        case: The worlds.
        check: Asked after each step whether to go on.
        every: Frames between stored states, where gradients are wanted; None stores all.
        stepping: What advances a state; None for `advance`.

    Returns:
        The outcome, differentiable.
    """
    stepping = stepping or (lambda state, inputs, step: advance(state, inputs, case.world, case.solver, step))
    frames: list[Step] = []
    state, chunk = case.state, every or case.frames
    for first in range(0, case.frames, chunk):
        arguments = state, case, stepping, check, range(first, min(first + chunk, case.frames))
        if every is not None and torch.is_grad_enabled():
            frames.extend(checkpoint(_frames, *arguments, use_reentrant=False))
        else:
            frames.extend(_frames(*arguments))
        state = frames[-1].state
    return (
        torch.stack([case.state.pose] + [step.state.pose for step in frames], 1),
        torch.stack([case.state.twist] + [step.state.twist for step in frames], 1),
        torch.stack([step.impulse for step in frames], 1),
        torch.stack([step.residual for step in frames], 1),
        torch.stack([step.newton_steps for step in frames], 1),
    )


def finite(pose: Tensor) -> Tensor:
    """Return which worlds have poses (B, N, 7) that are numbers, shape (B,)."""
    return pose.isfinite().flatten(1).all(1)


def _frames(state: State, case: Case, stepping: Stepping, check: Check, frames: range) -> list[Step]:
    """Advance by some frames; impulses are summed over the steps of each."""
    steps, substeps = [], case.world.substeps
    for t in frames:
        done: list[Step] = []
        for n in range(t * substeps, (t + 1) * substeps):
            step = stepping(state, case.inputs_at(n, state), case.grid.step(n))
            check(~(step.converged & finite(step.state.pose)), step.residual, t)
            state = step.state
            done.append(step)
        steps.append(dataclasses.replace(step, impulse=torch.stack([each.impulse for each in done]).sum(0)))
    return steps
