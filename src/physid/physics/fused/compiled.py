"""A case in compiled code: all steps at once where effects can be worked out beforehand, else one after the other."""

from __future__ import annotations

import torch

from physid.physics.case import Case, Outcome
from physid.physics.effect import Effect
from physid.physics.fused.ahead import inputs_ahead
from physid.physics.fused.growing import roll_in_steps
from physid.physics.fused.packing import Inputs, stepwise
from physid.physics.fused.rollout import by_frame, roll


def roll_compiled(case: Case) -> Outcome | None:
    """Predict trajectories in compiled code; None if an effect asks for the state and gradients are wanted."""
    outcome = _roll_all(case)
    return roll_in_steps(case) if outcome is None and not torch.is_grad_enabled() else outcome


def _roll_all(case: Case) -> Outcome | None:
    """Predict trajectories under effects, all steps at once; None if an effect asks for the state."""
    uneven, world = case.grid.uneven, case.world
    if all(type(effect).act is Effect.act for effect in case.effects):
        packed = Inputs.of(case.inputs)
        return roll(case.state, packed, case.wrenches, world, case.solver, lengths=case.lengths, steps=uneven)
    now = inputs_ahead(case)
    if now is None:
        return None
    steps = case.frames * world.substeps
    wanted = None if case.lengths is None else case.lengths * world.substeps
    wrenches, single = now.wrench.unflatten(0, (-1, steps)), stepwise(world)
    outcome = roll(case.state, Inputs.of(now, steps), wrenches, single, case.solver, lengths=wanted, steps=uneven)
    return by_frame(outcome, world.substeps)
