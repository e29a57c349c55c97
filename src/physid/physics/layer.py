"""The PhysicsLayer: initial states and wrenches in, trajectories out, gradients to everything."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import torch
from torch import Tensor, nn

from physid.physics.contact_problem.lcp import SolverSettings
from physid.physics.effect import Effect, with_sizes
from physid.physics.fused.backend import Backend, check_backend, roll
from physid.physics.guards.border import admit
from physid.physics.parameters import Parameters
from physid.physics.state import State
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
        case = admit(initial_state, wrenches, parameters, lengths, steps, start, self.effects, self.world, self.solver)
        pose, twist, impulse, residual, taken = roll(case, self.backend, self._check, self.checkpoint_every)
        return Rollout(pose, twist, impulse, SolverStatus(residual, taken.long()))

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

    def _check(self, failed: Tensor, residual: Tensor, frame: int) -> None:
        """Raise a SolverError if a world (B,) failed: it says how many, at which step, how badly, what to change."""
        if not bool(failed.any()):
            return
        worst, settings = float(residual[failed].max()), self.solver
        raise SolverError(
            f"{int(failed.sum())} of {failed.numel()} contact problems were not solved at step {frame}: worst residual "
            f"{worst:.3g} of the smoothing {settings.smoothing:.1g} after {settings.max_steps} Newton steps (first "
            f"sample: {int(failed.nonzero()[0])}); check the parameters and the initial state, lower the time step "
            "(more substeps), or raise solver.max_steps",
            failed.nonzero()[:, 0].tolist(),
        )
