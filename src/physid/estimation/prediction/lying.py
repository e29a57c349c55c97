"""Bodies that lie on the ground lie there with the sizes that effects give them."""

from __future__ import annotations

from collections.abc import Sequence

from torch import Tensor

from physid.physics import Effect, Parameters, State, World
from physid.physics.case import nominal_inputs
from physid.physics.shapes.table import reach


def raise_lying(
    state: State, lying: Tensor | None, parameters: Parameters, effects: Sequence[Effect], world: World
) -> Tensor:
    """Raise bodies that lie on the ground by as much as effects make them higher than they were measured.

    Initial states are laid on the ground with the sizes that were measured (`lay_down`), from where only moves along
    the ground are free. A body that is larger lies higher: if its initial state did not follow its size, it would start
    in the ground and be pushed out of it.

    Args:
        state: B states, as the measured sizes lay them.
        lying: Which bodies lie on the ground, shape (B, N); None for none.
        parameters: Theirs; the sizes are the measured ones.
        effects: What acts at the step, with parameters (1,) or (B,).
        world: The ground.

    Returns:
        Poses (B, N, 7); the very same where no effect changes a size.
    """
    if lying is None or world.ground is None or not effects:
        return state.pose
    measured = nominal_inputs(state, state.twist[:, None], parameters, world)
    now = measured
    for effect in effects:
        now = effect.act(state, now)
    if now.size is measured.size:
        return state.pose
    normal, attitude = measured.ground_normal, state.pose[..., 3:]
    before, after = (reach(world.shapes, attitude, inputs.size, normal) for inputs in (measured, now))
    pose = state.pose.clone()
    pose[..., :3] += ((after - before) * lying)[..., None] * normal
    return pose
