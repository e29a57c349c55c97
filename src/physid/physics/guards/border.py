"""What comes into a rollout from outside, checked and converted once, before any engine sees it."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from physid.physics.case import Case, nominal_inputs
from physid.physics.contact_problem.lcp import SolverSettings
from physid.physics.effect import Effect, with_sizes
from physid.physics.parameters import Parameters
from physid.physics.schemes.grid import TimeGrid
from physid.physics.state import State, check_shape
from physid.physics.world import World

PRECISIONS = (torch.float32, torch.float64)


def admit(
    state: State,
    wrenches: Tensor,
    parameters: Parameters,
    lengths: Tensor | None,
    steps: Tensor | None,
    start: Tensor | None,
    effects: Sequence[Effect],
    world: World,
    solver: SolverSettings,
) -> Case:
    """Return what is to be rolled out, of one type and on one device, that of the poses; gradients flow on.

    Args:
        state: The states at the first frame.
        wrenches: Shape (B, T, N, 6), of any floating type and device.
        parameters: The same.
        lengths: Steps that are needed of each world, shape (B,), or None.
        steps: Time from each frame to the next [s], shape (B or 1, T), or None.
        start: Time of the first frame on the clock that effects see [s], shape (B or 1,), or None.
        effects: Those of the layer; their actuation is done here.
        world: Ground, joints and rules.
        solver: Accuracy of the contact solver.

    Raises:
        ValueError: If a shape, a type or a device is off, a value is not finite, or a quaternion is not of unit length.
    """
    pose = state.pose
    if pose.dtype not in PRECISIONS:
        raise ValueError(f"pose must be of torch.float32 or torch.float64, got {pose.dtype}")
    state = State.checked(pose, _like("twist", state.twist, pose))
    batch, bodies = pose.shape[:2]
    wrenches = _like("wrenches", wrenches, pose)
    check_shape("wrenches", wrenches, (batch, None, bodies, 6))
    if wrenches.shape[1] == 0:
        raise ValueError("wrenches must have at least one step, got 0")

    def admitted(name: str, value: Tensor) -> Tensor:
        wanted = (batch,) if name in parameters.sizes else (batch, bodies)
        have = tuple(value.shape[: len(wanted)])
        if have[0] not in (1, batch) or have[1:] != wanted[1:]:
            shape = ", ".join(map(str, (f"1 or {batch}", *wanted[1:])))
            raise ValueError(f"parameters.{name} must have shape ({shape}, ...), got {have}")
        return _like(f"parameters.{name}", value, pose)

    known = parameters.map(admitted)
    if lengths is not None and lengths.shape != (batch,):
        raise ValueError(f"lengths must have shape ({batch},), got {tuple(lengths.shape)}")
    if world.shapes and len(world.shapes) != bodies:
        raise ValueError(
            f"world.shapes must hold one shape for each of {bodies} bodies, or none where all are boxes, got "
            f"{len(world.shapes)}"
        )
    grid = TimeGrid.of(world, state, wrenches.shape[1], steps, start)
    at_work = [effect.to(pose) for effect in with_sizes(effects, known.sizes)]
    for effect in at_work:
        wrenches = effect.actuate(wrenches, grid.frames)
    return Case(state, nominal_inputs(state, wrenches, known, world), wrenches, at_work, world, solver, grid, lengths)


def _like(name: str, value: Tensor, pose: Tensor) -> Tensor:
    if not value.is_floating_point():
        raise ValueError(f"{name} must be of a floating type, got {value.dtype}; convert it with .to({pose.dtype})")
    return value.to(pose)
