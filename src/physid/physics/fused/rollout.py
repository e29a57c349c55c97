"""The compiled rollout behind torch tensors."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from physid.physics.case import Outcome
from physid.physics.contact_problem.lcp import SolverSettings
from physid.physics.fused.effects import Acting
from physid.physics.fused.packing import Inputs, by_group, constants_of, lanes_of, shape_of
from physid.physics.fused.run import run
from physid.physics.guards.first_derivative import only_first
from physid.physics.state import State
from physid.physics.world import World


def roll(
    state: State,
    inputs: Inputs,
    wrenches: Tensor,
    world: World,
    settings: SolverSettings,
    memory: Tensor | None = None,
    lengths: Tensor | None = None,
    steps: Tensor | None = None,
    effects: Acting | None = None,
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
        effects: What acts on every step; None for nothing.

    Returns:
        Poses (B, T + 1, N, 7), twists (B, T + 1, N, 6), impulses (B, T, C, 3) [N s], the largest residual in each frame
        in units of the smoothing and the Newton steps of its last step, both (B, T). Gradients flow to all arguments.
    """
    shape = shape_of(world, state.pose.shape[1])
    tensors = [value.contiguous() for value in (state.pose, state.twist, wrenches, inputs.bodies, inputs.shared)]
    keep = torch.is_grad_enabled() and any(value.requires_grad for value in tensors)
    steps = None if steps is None else steps.contiguous()
    code, clock, sizes = (None, None, None) if effects is None else (effects.code, effects.clock, effects.sizes)
    keep = keep or (torch.is_grad_enabled() and sizes is not None and sizes.requires_grad)
    arguments = (*tensors, sizes, shape, world, settings, keep, memory, None if keep else lengths, steps, code, clock)
    pose, twist, impulse, residual, taken = _Rollout.apply(*arguments)  # type: ignore[no-untyped-call]
    return pose, twist, impulse, residual / settings.tau(torch.float64), taken


class _Rollout(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, *arguments: Any) -> tuple[Tensor, ...]:
        (
            pose,
            twist,
            wrench,
            inputs,
            shared,
            sizes,
            shape,
            world,
            settings,
            keep,
            memory,
            lengths,
            uneven,
            code,
            clock,
        ) = arguments
        (worlds, frames), bodies = wrench.shape[:2], pose.shape[1]
        new = pose.new_empty if lengths is None else pose.new_zeros
        poses, twists = new(worlds, frames + 1, bodies, 7), new(worlds, frames + 1, bodies, 6)
        poses[:, 0], twists[:, 0] = pose, twist
        impulse = new(worlds, frames, 4 * shape.patches, 3)
        residual, steps = new(worlds, frames), new(worlds, frames)
        tape = pose.new_empty(lanes_of(worlds) * frames * world.substeps * shape.tape if keep else 0)
        numbers = {"worlds": worlds, "frames": frames, "substeps": world.substeps}
        apart = {"inputs": inputs, "shared": shared}
        read = {"inputs": inputs, "shared": shared, "wrench": wrench, "constants": constants_of(world, settings, shape)}
        read |= {"lengths": by_group(lengths, worlds, frames)}
        written = {"pose": poses, "twist": twists, "impulse": impulse, "residual": residual, "newton_steps": steps}
        read |= {"tape": tape} if keep else {}
        read |= {"memory": memory} if memory is not None else {}
        read |= {"steps": uneven} if uneven is not None else {}
        apart |= {"steps": uneven} if uneven is not None else {}
        if code is not None:
            read |= {"clock": clock, "sizes": sizes}
            numbers |= {"effects": code.forward, "effects_adjoint": code.adjoint if keep else 0}
            apart |= {"clock": clock, "sizes": sizes}
        numbers |= {f"{name}_by_world": one[0].numel() * (len(one) > 1) for name, one in apart.items()}
        run("forward", shape, worlds, numbers, read | written)
        ctx.save_for_backward(tape, inputs, shared, wrench, read["constants"], uneven, clock, sizes, pose, twist)
        ctx.shape, ctx.numbers = shape, numbers
        ctx.mark_non_differentiable(residual, steps)
        ctx.set_materialize_grads(False)
        return poses, twists, impulse, residual, steps

    @staticmethod
    def backward(ctx: Any, *bars: Tensor | None) -> tuple[Tensor | None, ...]:
        tape, inputs, shared, wrench, constants, uneven, clock, sizes, *states = ctx.saved_tensors
        worlds, _, bodies = wrench.shape[:3]
        read = {"tape": tape, "inputs": inputs, "shared": shared, "wrench": wrench, "constants": constants}
        read |= {"steps": uneven} if uneven is not None else {}
        read |= {"clock": clock, "sizes": sizes} if sizes is not None else {}
        given = zip(("pose", "twist", "impulse"), bars, strict=False)
        read |= {f"{name}_bar": bar.contiguous() for name, bar in given if bar is not None}
        written = {
            "first_pose_bar": wrench.new_empty(worlds, bodies, 7),
            "first_twist_bar": wrench.new_empty(worlds, bodies, 6),
            "wrench_bar": torch.empty_like(wrench),
            "inputs_bar": wrench.new_empty(worlds, *inputs.shape[1:]),
            "shared_bar": wrench.new_empty(worlds, *shared.shape[1:]),
        }
        written |= {"sizes_bar": wrench.new_empty(worlds, sizes.shape[1])} if sizes is not None else {}
        run("backward", ctx.shape, worlds, ctx.numbers, read | written)
        *by_states, by_inputs, by_shared = list(written.values())[:5]
        slopes = [*by_states, by_inputs.sum_to_size(inputs.shape), by_shared.sum_to_size(shared.shape)]
        slopes += [written["sizes_bar"].sum_to_size(sizes.shape)] if sizes is not None else []
        known = [sizes] if sizes is not None else []
        slopes = list(only_first(tuple(slopes), (*states, wrench, inputs, shared, *known, *bars)))
        return (*slopes, *[None] * (15 - len(slopes)))
