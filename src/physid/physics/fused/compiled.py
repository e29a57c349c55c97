"""A case in compiled code, with all its effects."""

from __future__ import annotations

import dataclasses

from physid.physics.case import Case, Outcome
from physid.physics.effect import Effect
from physid.physics.fused.effects import Acting, compile_effects, sizes_of
from physid.physics.fused.packing import Inputs, shape_of
from physid.physics.fused.rollout import roll


def roll_compiled(case: Case) -> Outcome | None:
    """Predict trajectories in compiled code; None if an effect cannot be compiled."""
    effects = [effect for effect in case.effects if type(effect).act is not Effect.act]
    acting = None
    if effects:
        code = compile_effects(
            dataclasses.replace(case, effects=effects), shape_of(case.world, case.state.pose.shape[1])
        )
        if code is None:
            return None
        acting = Acting(code, case.grid.time.contiguous(), sizes_of(effects))
    inputs, lengths, steps = Inputs.of(case.inputs), case.lengths, case.grid.uneven
    return roll(
        case.state, inputs, case.wrenches, case.world, case.solver, lengths=lengths, steps=steps, effects=acting
    )
