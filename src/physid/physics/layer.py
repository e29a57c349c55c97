"""The PhysicsLayer: initial states and wrenches in, trajectories out, gradients to everything."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import final

import torch
from torch import Tensor, nn
from torch.utils.checkpoint import checkpoint

from physid.physics.contact_problem.lcp import SolverSettings
from physid.physics.effect import Effect, StepInputs, with_sizes
from physid.physics.fused.backend import Backend, check_backend, use_fused
from physid.physics.guards.border import admit
from physid.physics.parameters import Parameters
from physid.physics.schemes.grid import TimeGrid
from physid.physics.schemes.motion import acting
from physid.physics.state import State
from physid.physics.step import Step, advance
from physid.physics.world import World


class SolverError(RuntimeError):
    """A step whose contact problem was not solved; the message says where, how badly, and what to change.

    Args:
        message: The same.
        samples: Which worlds of the batch failed.
    """

    def __init__(self, message: str, samples: Sequence[int] = ()) -> None:
        super().__init__(message)
        self.samples = tuple(samples)


@dataclass(frozen=True)
class SolverStatus:
    """How the solver did in every step of a rollout.

    Attributes:
        residual: Largest violated equation in units of the smoothing, shape (B, T).
        newton_steps: Shape (B, T).
    """

    residual: Tensor
    newton_steps: Tensor


@dataclass(frozen=True)
class Rollout:
    """A trajectory of T frames after the initial one.

    Attributes:
        pose: Shape (B, T + 1, N, 7); the first is the initial pose.
        twist: Shape (B, T + 1, N, 6).
        impulse: Contact impulses (normal, tangential) summed over a frame's substeps [N s], shape (B, T, C, 3).
        status: How the solver did.
    """

    pose: Tensor
    twist: Tensor
    impulse: Tensor
    status: SolverStatus


@final
class PhysicsLayer(nn.Module):
    """Rigid bodies in contact, batched and differentiable (eq. (3) of the paper in every step).

    Args:
        world: Time step, gravity, ground, joints, rules of contact.
        effects: What the nominal model lacks; applied in this order.
        solver: Accuracy and effort of the contact solver.
        checkpoint_every: Frames between stored states; None stores all (fast), a number trades time for memory.
        backend: "fused" runs compiled code (CPU, float64, circular cone, boxes, no joints), "reference" the same in
            torch, "auto" the first where it can.
    """

    def __init__(
        self,
        world: World,
        effects: Sequence[Effect] = (),
        solver: SolverSettings | None = None,
        checkpoint_every: int | None = None,
        backend: Backend = "auto",
    ) -> None:
        super().__init__()
        check_backend(backend)
        self.world = world
        self.effects = tuple(effects)
        self.solver = solver or SolverSettings()
        self.checkpoint_every = checkpoint_every
        self.backend = backend

    def forward(self, initial_state: State, wrenches: Tensor, parameters: Parameters) -> Rollout:
        """Do as `rollout` does."""
        return self.rollout(initial_state, wrenches, parameters)

    def rollout(
        self,
        initial_state: State,
        wrenches: Tensor,
        parameters: Parameters,
        lengths: Tensor | None = None,
        steps: Tensor | None = None,
        start: Tensor | None = None,
    ) -> Rollout:
        """Predict the trajectories that follow from initial states under commanded wrenches.

        Args:
            initial_state: The states at the first frame.
            wrenches: Commanded torque [N m] and force [N], row t held from frame t to t + 1; shape (B, T, N, 6). As
                `parameters` of any floating type and device; computed is with those of the poses.
            parameters: Sizes, masses, inertias, friction, restitution.
            lengths: Steps that are needed of each world, shape (B,); what comes later has no meaning, and need not be
                computed. Worlds of similar length beside each other are the fastest. None for all steps.
            steps: Time from each frame to the next [s], shape (B or 1, T); None for `world.time_step`. No gradient.
            start: Time of the first frame on the clock that effects see [s], shape (B or 1,); None for 0.

        Returns:
            Poses, twists, impulses and solver status, with gradients to the first three arguments and to the effects.

        Raises:
            ValueError: If a shape or a type is off, a value is not finite, or a quaternion is not of unit length.
            SolverError: If a step's contact problem cannot be solved.
        """
        initial_state, wrenches, parameters = admit(initial_state, wrenches, parameters, lengths)
        if self.world.shapes and len(self.world.shapes) != initial_state.pose.shape[1]:
            raise ValueError(
                f"world.shapes must hold one shape for each of {initial_state.pose.shape[1]} bodies, or none where all "
                f"are boxes, got {len(self.world.shapes)}"
            )
        grid = TimeGrid.of(self.world, initial_state, wrenches.shape[1], steps, start)
        effects = [effect.to(initial_state.pose) for effect in with_sizes(self.effects, parameters.sizes)]
        for effect in effects:
            wrenches = effect.actuate(wrenches, grid.frames)
        fused = use_fused(self.backend, self.world, initial_state.pose)
        if fused:
            rollout = self._compiled(initial_state, wrenches, parameters, effects, grid, lengths)
            if rollout is not None:
                return rollout
        frames: list[Step] = []
        state, chunk = initial_state, self.checkpoint_every or wrenches.shape[1]
        for first in range(0, wrenches.shape[1], chunk):
            arguments = state, wrenches[:, first : first + chunk], parameters, effects, grid, first
            if self.checkpoint_every is not None and torch.is_grad_enabled():
                frames.extend(checkpoint(self._frames, *arguments, use_reentrant=False))
            else:
                frames.extend(self._frames(*arguments))
            state = frames[-1].state
        return _stack(initial_state, frames)

    @property
    def distorts(self) -> bool:
        """Whether a perception effect is at work: true states are not what the camera reports."""
        return any(type(effect).observe is not Effect.observe for effect in self.effects)

    def observe(self, pose: Tensor, time: Tensor | None = None, parameters: Parameters | None = None) -> Tensor:
        """Return what the camera reports of true poses (B, T, N, 7), by the perception effects of the layer.

        Args:
            pose: Poses of the centres.
            time: Times of the frames [s], shape (1 or B, T); None for frames `world.time_step` apart.
            parameters: Give sizes of effects that replace those of the layer's; None for none.
        """
        if not self.distorts:
            return pose
        if time is None:
            time = self.world.time_step * torch.arange(pose.shape[1]).to(pose)[None]
        for effect in with_sizes(self.effects, parameters.sizes if parameters else {}):
            pose = effect.to(pose).observe(pose, time.to(pose))
        return pose

    def _compiled(
        self,
        state: State,
        wrenches: Tensor,
        parameters: Parameters,
        effects: list[Effect],
        grid: TimeGrid,
        lengths: Tensor | None,
    ) -> Rollout | None:
        """Do the rollout in compiled code; None if an effect asks for the state and gradients are wanted."""
        from physid.physics.fused.rollout import roll_all
        from physid.physics.fused.stepping import roll_in_steps

        inputs = nominal_inputs(state, wrenches, parameters, self.world)
        outcome = roll_all(state, inputs, wrenches, effects, self.world, self.solver, grid, lengths)
        if outcome is None and torch.is_grad_enabled():
            return None
        if outcome is None:
            outcome = roll_in_steps(state, inputs, wrenches, effects, self.world, self.solver, grid, lengths)
        pose, twist, impulse, residual, steps = outcome
        failed = ~(residual <= self.solver.residual(pose.dtype) / self.solver.tau(pose.dtype))
        failed[:, -1] |= ~_finite(pose[:, -1])  # any earlier one would have failed the step after it
        if bool(failed.any()):
            t = int(failed.any(0).nonzero()[0])
            after = State(pose[:, t + 1], twist[:, t + 1])
            require_converged(Step(after, impulse[:, t], residual[:, t], steps[:, t], ~failed[:, t]), t, self.solver)
        return Rollout(pose, twist, impulse, SolverStatus(residual, steps.long()))

    def _stepper(self, state: State) -> Callable[[State, StepInputs, Tensor], Step]:
        """Return what advances a state by one step of a given length."""
        if use_fused(self.backend, self.world, state.pose):
            from physid.physics.fused.stepping import Stepper

            return Stepper(self.world, self.solver)
        return lambda state, inputs, step: advance(state, inputs, self.world, self.solver, step)

    def _frames(
        self,
        state: State,
        wrenches: Tensor,
        parameters: Parameters,
        effects: list[Effect],
        grid: TimeGrid,
        first: int,
    ) -> list[Step]:
        inputs, step_from = nominal_inputs(state, wrenches, parameters, self.world), self._stepper(state)
        steps, time = [], grid.time
        for t in range(wrenches.shape[1]):
            done: list[Step] = []
            for k in range(self.world.substeps):
                n = (first + t) * self.world.substeps + k
                now = inputs.replace(time=inputs.time + time[:, n], wrench=wrenches[:, t])
                here = acting(state, grid.until_forces(n)) if effects else state
                for effect in effects:
                    now = effect.act(here, now)
                step = step_from(state, now, grid.step(n))
                require_converged(step, first + t, self.solver)
                state = step.state
                done.append(step)
            steps.append(dataclasses.replace(step, impulse=torch.stack([each.impulse for each in done]).sum(0)))
        return steps


def nominal_inputs(state: State, wrenches: Tensor, parameters: Parameters, world: World) -> StepInputs:
    """Build the inputs of a step without any effect, at time 0 and with the first of the wrenches (B, T, N, 6)."""
    of_bodies = {name: getattr(parameters, name) for name in ("size", "mass", "inertia", "friction", "restitution")}
    new, bodies = state.pose.new_tensor, state.pose.shape[1]
    surroundings = {
        "wrench": wrenches[:, 0],
        "gravity": new(world.gravity).expand(1, bodies, 3),
        "ground_normal": new(world.ground.normal if world.ground else (0.0, 0.0, 1.0)),
        "ground_offset": new(world.ground.offset if world.ground else -math.inf),
    }
    return StepInputs.nominal(state.pose, of_bodies | surroundings, world.shapes)


def require_converged(step: Step, frame: int, settings: SolverSettings) -> None:
    """Raise a SolverError unless every world of the batch was solved and is finite.

    Raises:
        SolverError: Says how many samples, at which step, with what residual, and what to change.
    """
    failed = ~(step.converged & _finite(step.state.pose))
    if not bool(failed.any()):
        return
    worst = float(step.residual[failed].max())
    raise SolverError(
        f"{int(failed.sum())} of {failed.numel()} contact problems were not solved at step {frame}: worst residual "
        f"{worst:.3g} of the smoothing {settings.smoothing:.1g} after {settings.max_steps} Newton steps (first sample: "
        f"{int(failed.nonzero()[0])}); check the parameters and the initial state, lower the time step (more "
        "substeps), or raise solver.max_steps",
        failed.nonzero()[:, 0].tolist(),
    )


def _finite(pose: Tensor) -> Tensor:
    """Return which worlds have poses (B, N, 7) that are numbers, shape (B,)."""
    return pose.isfinite().flatten(1).all(1)


def _stack(initial: State, frames: list[Step]) -> Rollout:
    return Rollout(
        pose=torch.stack([initial.pose] + [step.state.pose for step in frames], 1),
        twist=torch.stack([initial.twist] + [step.state.twist for step in frames], 1),
        impulse=torch.stack([step.impulse for step in frames], 1),
        status=SolverStatus(
            residual=torch.stack([step.residual for step in frames], 1),
            newton_steps=torch.stack([step.newton_steps for step in frames], 1),
        ),
    )
