"""The compiled rollout behind torch tensors."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import torch
from torch import Tensor

from physid.compiler.emit import LANES
from physid.physics.contact import Speculative, Split
from physid.physics.contact_problem.lcp import SolverSettings
from physid.physics.effect import Effect, StepInputs, widths_of
from physid.physics.fused.ahead import inputs_ahead
from physid.physics.fused.formulas.layouts import CONSTANTS, OF_BODY, OF_WORLD
from physid.physics.fused.records import Shape
from physid.physics.fused.run import run
from physid.physics.fused.writer import SHARED_INPUTS
from physid.physics.guards.first_derivative import only_first
from physid.physics.schemes.grid import TimeGrid
from physid.physics.schemes.impact import velocity_unit
from physid.physics.state import State
from physid.physics.world import World

Outcome = tuple[Tensor, Tensor, Tensor, Tensor, Tensor]


@dataclass(frozen=True)
class Inputs:
    """What enters the steps of a rollout beside states and wrenches; axes of length 1 stand for all of their kind.

    Attributes:
        bodies: The fields of `StepInputs` of each body, shape (B or 1, T or 1, N, 18).
        shared: Ground normal and offset, friction and restitution between bodies, shape (B or 1, T or 1, 6).
    """

    bodies: Tensor
    shared: Tensor

    @classmethod
    def of(cls, inputs: StepInputs, frames: int = 1) -> Inputs:
        """Pack inputs whose batch axis holds the frames of each world, one world after the other."""
        worlds, count = inputs.mass.shape
        bodies = torch.cat([getattr(inputs, name).reshape(worlds, count, -1) for name in OF_BODY], -1)
        ground = {name: getattr(inputs, name).expand(worlds, width) for name, width in widths_of("ground").items()}
        world = {name: getattr(inputs, name).reshape(worlds, -1) for name in widths_of("world")}
        shared = torch.cat([(ground | world)[name] for name in OF_WORLD], 1)
        return cls(bodies.unflatten(0, (-1, frames)), shared.unflatten(0, (-1, frames)))


def roll_all(
    state: State,
    inputs: StepInputs,
    wrenches: Tensor,
    effects: Sequence[Effect],
    world: World,
    settings: SolverSettings,
    grid: TimeGrid,
    lengths: Tensor | None = None,
) -> Outcome | None:
    """Predict trajectories under effects.

    Args:
        state: The states at the first frame.
        inputs: Nominal inputs of the first step.
        wrenches: Torque [N m] and force [N] that act, held over a frame; shape (B, T, N, 6).
        effects: Those of the layer.
        world: Ground and rules.
        settings: Accuracy of the solver.
        grid: When the steps begin, and how long they last.
        lengths: See `roll`.

    Returns:
        As `roll`; None if an effect asks for the state.
    """
    if all(type(effect).act is Effect.act for effect in effects):
        return roll(state, Inputs.of(inputs), wrenches, world, settings, lengths=lengths, steps=grid.uneven)
    now = inputs_ahead(inputs, wrenches, effects, world, grid)
    if now is None:
        return None
    steps = wrenches.shape[1] * world.substeps
    wanted = None if lengths is None else lengths * world.substeps
    wrenches, single = now.wrench.unflatten(0, (-1, steps)), stepwise(world)
    outcome = roll(state, Inputs.of(now, steps), wrenches, single, settings, lengths=wanted, steps=grid.uneven)
    return by_frame(outcome, world.substeps)


def stepwise(world: World) -> World:
    """Return a world with a frame after each step."""
    return dataclasses.replace(world, time_step=world.step, substeps=1)


def by_frame(outcome: Outcome, substeps: int) -> Outcome:
    """Turn the outcome of single steps into that of frames of so many steps each."""
    pose, twist, impulse, residual, newton_steps = outcome
    impulse, residual = impulse.unflatten(1, (-1, substeps)).sum(2), residual.unflatten(1, (-1, substeps)).amax(2)
    return pose[:, ::substeps], twist[:, ::substeps], impulse, residual, newton_steps[:, substeps - 1 :: substeps]


def roll(
    state: State,
    inputs: Inputs,
    wrenches: Tensor,
    world: World,
    settings: SolverSettings,
    memory: Tensor | None = None,
    lengths: Tensor | None = None,
    steps: Tensor | None = None,
) -> Outcome:
    """Predict trajectories.

    Args:
        state: The states at the first frame.
        inputs: What acts beside the wrenches.
        wrenches: Torque [N m] and force [N], held over a frame; shape (B, T, N, 6).
        world: Ground and rules.
        settings: Accuracy of the solver.
        memory: What a former call left for the start of this one; changed in place.
        lengths: Frames that each world needs, shape (B,); where no gradient is wanted, what comes later may be zeros.
        steps: Length of each step of the engine [s], shape (B or 1, T substeps); None for `world.step`.

    Returns:
        Poses (B, T + 1, N, 7), twists (B, T + 1, N, 6), impulses (B, T, C, 3) [N s], the largest residual in each frame
        in units of the smoothing and the Newton steps of its last step, both (B, T). Gradients flow to all arguments.
    """
    shape = shape_of(world, state.pose.shape[1])
    tensors = [value.contiguous() for value in (state.pose, state.twist, wrenches, inputs.bodies, inputs.shared)]
    keep = torch.is_grad_enabled() and any(value.requires_grad for value in tensors)
    steps = None if steps is None else steps.contiguous()
    arguments = (*tensors, shape, world, settings, keep, memory, None if keep else lengths, steps)
    pose, twist, impulse, residual, taken = _Rollout.apply(*arguments)  # type: ignore[no-untyped-call]
    return pose, twist, impulse, residual / settings.tau(torch.float64), taken


def shape_of(world: World, bodies: int) -> Shape:
    """Return what kernels are compiled for."""
    return Shape(bodies, world.ground is not None, isinstance(world.contact, Split), world.midpoint)


@lru_cache
def constants_of(world: World, settings: SolverSettings, shape: Shape) -> Tensor:
    """Return the numbers that every step of a world takes, one column for each lane."""
    rule, ladder = world.contact, list(settings.compliance)
    if len(ladder) > CONSTANTS.widths["ladder"]:
        raise ValueError(f"solver.compliance must have at most {CONSTANTS.widths['ladder']} values, got {len(ladder)}")
    values = {
        "step": [world.step],
        "unit": [velocity_unit(world.step, midpoint=world.midpoint)],
        "gyroscopic": [float(world.gyroscopic)],
        "speculative": [float(isinstance(rule, Speculative))],
        "split": [float(isinstance(rule, Split))],
        "correction": [1.0 if world.midpoint else rule.correction],
        "speed_limit": [getattr(rule, "speed_limit", 0.0)],
        "slop": [getattr(rule, "slop", 0.0)],
        "tau": [settings.tau(torch.float64)],
        "accepted": [settings.residual(torch.float64)],
        "max_steps": [float(settings.max_steps)],
        "rungs": [float(len(ladder))],
        "pairs": [12.0 * shape.patches],
        "ladder": ladder + ladder[-1:] * (CONSTANTS.widths["ladder"] - len(ladder)),
    }
    row = [number for name in CONSTANTS.widths for number in values[name]]
    return torch.tensor(row, dtype=torch.float64)[:, None].repeat(1, LANES)


def by_group(lengths: Tensor | None, worlds: int, frames: int) -> Tensor:
    """Return how many frames the worlds that are computed together need, shape (B / LANES,), from those of each."""
    if lengths is None:
        return torch.full((-(-worlds // LANES),), frames)
    padded = torch.cat([lengths.to(torch.int64), torch.zeros(-worlds % LANES, dtype=torch.int64)])
    longest: Tensor = padded.unflatten(0, (-1, LANES)).amax(1)
    return longest


def _distances(name: str, value: Tensor) -> dict[str, int]:
    """Return how far apart worlds and frames lie in an array (B or 1, T or 1, ...)."""
    worlds, frames = value.shape[:2]
    row = value[0, 0].numel()
    return {f"{name}_by_world": frames * row * (worlds > 1), f"{name}_by_frame": row * (frames > 1)}


class _Rollout(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, *arguments: Any) -> tuple[Tensor, ...]:
        pose, twist, wrench, inputs, shared, shape, world, settings, keep, memory, lengths, uneven = arguments
        (worlds, frames), bodies = wrench.shape[:2], pose.shape[1]
        new = pose.new_empty if lengths is None else pose.new_zeros
        poses, twists = new(worlds, frames + 1, bodies, 7), new(worlds, frames + 1, bodies, 6)
        poses[:, 0], twists[:, 0] = pose, twist
        impulse = new(worlds, frames, 4 * shape.patches, 3)
        residual, steps = new(worlds, frames), new(worlds, frames)
        groups = (worlds + LANES - 1) // LANES
        tape = pose.new_empty(groups * frames * world.substeps * shape.tape * LANES if keep else 0)
        numbers = {"worlds": worlds, "frames": frames, "substeps": world.substeps}
        numbers |= _distances("inputs", inputs) | _distances("shared", shared)
        read = {"inputs": inputs, "shared": shared, "wrench": wrench, "constants": constants_of(world, settings, shape)}
        read |= {"lengths": by_group(lengths, worlds, frames)}
        written = {"pose": poses, "twist": twists, "impulse": impulse, "residual": residual, "newton_steps": steps}
        read |= {"tape": tape} if keep else {}
        read |= {"memory": memory} if memory is not None else {}
        read |= {"steps": uneven} if uneven is not None else {}
        numbers |= {"steps_by_world": uneven.shape[1] * (uneven.shape[0] > 1)} if uneven is not None else {}
        run("forward", shape, worlds, numbers, read | written)
        ctx.save_for_backward(tape, inputs, shared, wrench, read["constants"], uneven, pose, twist)
        ctx.shape, ctx.numbers = shape, numbers
        ctx.mark_non_differentiable(residual, steps)
        ctx.set_materialize_grads(False)
        return poses, twists, impulse, residual, steps

    @staticmethod
    def backward(ctx: Any, *bars: Tensor | None) -> tuple[Tensor | None, ...]:
        tape, inputs, shared, wrench, constants, uneven, *states = ctx.saved_tensors
        worlds, _, bodies = wrench.shape[:3]
        varying = max(inputs.shape[1], shared.shape[1])
        read = {"tape": tape, "inputs": inputs, "shared": shared, "wrench": wrench, "constants": constants}
        read |= {"steps": uneven} if uneven is not None else {}
        given = zip(("pose", "twist", "impulse"), bars, strict=False)
        read |= {f"{name}_bar": bar.contiguous() for name, bar in given if bar is not None}
        written = {
            "first_pose_bar": wrench.new_empty(worlds, bodies, 7),
            "first_twist_bar": wrench.new_empty(worlds, bodies, 6),
            "wrench_bar": torch.empty_like(wrench),
            "inputs_bar": wrench.new_empty(worlds, varying, *inputs.shape[2:]),
            "shared_bar": wrench.new_empty(worlds, varying, SHARED_INPUTS),
        }
        run("backward", ctx.shape, worlds, ctx.numbers, read | written)
        *by_states, by_inputs, by_shared = written.values()
        slopes = (*by_states, by_inputs.sum_to_size(inputs.shape), by_shared.sum_to_size(shared.shape))
        return (*only_first(slopes, (*states, wrench, inputs, shared, *bars)), *[None] * 7)
