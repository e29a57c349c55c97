"""Initial states as unknowns: fitted for the present parameters, and taken out of what these explain."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import final

import torch
from torch import Tensor

from physid.physics.layer import PhysicsLayer, SolverError
from physid.physics.rotations import exponential, multiply, normalize
from physid.physics.state import State
from physid.scenes.lying import turn_flat
from physid.scenes.scene import Scene
from physid.training.initial_states.guessed import guess
from physid.training.parameters.physical_parameters import PhysicalParameters
from physid.training.parameters.pose_loss import PoseLoss
from physid.training.parameters.sensitivity import residuals
from physid.training.parameters.trajectories import Trajectories

MOVE = 1e-5
"""Step of the differences [m, rad, m/s, rad/s]."""
DAMPINGS = (1e-6, 1e-2, 1.0, 1e2)
"""Dampings that every step tries; each trajectory takes the best, or stays: dry friction bends near rest."""
MOST = 20
"""Most steps of one fit."""
SETTLED = 1e-9
"""A step that gains less than this share of the loss is the last."""
STEEP = 0.9
"""A ground whose normal has more than this along x takes its first tangent from y."""
PLANAR = (1, 1, 0, 0, 0, 1, 0, 0, 1, 1, 1, 0)
"""Shift, turn, spin and speed, along two tangents and the normal, that a body on the ground is free to have."""
POSE_MOVES = 6
"""Shift and turn."""


@final
@dataclass(frozen=True)
class Starts:
    """States of B trajectories at the first frame, and how they may move.

    Attributes:
        pose: Shape (B, N, 7).
        twist: Shape (B, N, 6).
        free: Which of 12 moves of each body are free: shift, turn, spin, speed along the ground's axes, (B, N, 12).
        axes: Two tangents and the normal of the ground as rows, shape (3, 3).
    """

    pose: Tensor
    twist: Tensor
    free: Tensor
    axes: Tensor

    @classmethod
    def guess(cls, trajectories: Trajectories, scene: Scene) -> Starts:
        """Guess from the initial poses; a body that lies on the ground stays on it."""
        pose, twist, lies = guess(trajectories, scene)
        planar = torch.tensor(PLANAR, dtype=torch.bool, device=pose.device)
        free = torch.where(lies[..., None], planar, torch.ones_like(planar))
        return cls(pose, twist, free, _axes(pose.new_tensor(scene.ground.normal)))

    @classmethod
    def near(cls, state: State, normal: Tensor, *, lying: bool, at_rest: bool) -> Starts:
        """Begin with given states, of bodies that lie on a ground with this normal or not, and are known to be at rest.

        A body that lies stays on the ground, and one at rest stays at rest.
        """
        free = torch.tensor(PLANAR, device=normal.device).bool() | (not lying)
        free = free & (torch.arange(len(PLANAR), device=normal.device) < (POSE_MOVES if at_rest else len(PLANAR)))
        return cls(state.pose, state.twist, free.expand(*state.pose.shape[:2], -1), _axes(normal.to(state.pose)))

    @property
    def columns(self) -> list[tuple[int, int]]:
        """Pairs (body, move) that are free in some trajectory."""
        return [(int(body), int(move)) for body, move in self.free.any(0).nonzero()]

    def moved(self, change: Tensor) -> Starts:
        """Return states moved by amounts (B, D) along the columns [m, rad, rad/s, m/s]."""
        full = change.new_zeros(self.free.shape)
        for column, (body, move) in enumerate(self.columns):
            full[:, body, move] = change[:, column]
        shift, turn, spin, speed = ((full * self.free).unflatten(-1, (4, 3)) @ self.axes).unbind(-2)
        attitude = normalize(multiply(exponential(turn), self.pose[..., 3:]))
        pose = torch.cat([self.pose[..., :3] + shift, attitude], -1)
        return dataclasses.replace(self, pose=pose, twist=self.twist + torch.cat([spin, speed], -1))

    def simpler(self) -> tuple[Starts, ...]:
        """Return states that are common and lie at kinks of the loss, where no slope leads.

        Bodies turned until a face is parallel to the ground, not tumbling, as those that land flat; not spinning; and
        at rest.
        """
        normal = self.axes[2]
        attitude, _ = turn_flat(self.pose[..., 3:], normal)
        spin, speed = self.twist.split(3, -1)
        flat = torch.cat([self.pose[..., :3], attitude], -1)
        upright = torch.cat([(spin @ normal)[..., None] * normal, speed], -1)
        still = torch.cat([torch.zeros_like(spin), speed], -1)
        pairs = ((flat, upright), (flat, still), (self.pose, torch.zeros_like(self.twist)))
        return tuple(dataclasses.replace(self, pose=pose, twist=twist) for pose, twist in pairs)

    def chosen(self, better: Tensor, other: Starts) -> Starts:
        """Take the states of `other` where it is better, (B,)."""
        where = better[:, None, None]
        pose, twist = (torch.where(where, getattr(other, name), getattr(self, name)) for name in ("pose", "twist"))
        return dataclasses.replace(self, pose=pose, twist=twist)

    def repeated(self, copies: int) -> Starts:
        """Return the states `copies` times in a row."""
        again = {name: getattr(self, name).repeat(copies, 1, 1) for name in ("pose", "twist", "free")}
        return dataclasses.replace(self, **again)

    def of(self, trajectories: Trajectories) -> Trajectories:
        """Return trajectories that are predicted from these states."""
        return dataclasses.replace(trajectories, origin=torch.cat([self.pose, self.twist], -1))


@final
@dataclass(frozen=True)
class Explaining:
    """What a model makes of some trajectories, and what an error costs.

    Attributes:
        layer: The physics.
        physical: The physical parameters.
        loss: What an error of the poses costs.
        trajectories: What was recorded, B of T frames.
        logarithm: Logarithms of the parameters, (P,) or (B, P); None for the present ones.
        counted: Which frames count, shape (B, T); None for all that are real.
    """

    layer: PhysicsLayer
    physical: PhysicalParameters
    loss: PoseLoss
    trajectories: Trajectories
    logarithm: Tensor | None = None
    counted: Tensor | None = None

    @property
    def real(self) -> Tensor:
        """Which frames count, shape (B, T)."""
        return self.trajectories.real if self.counted is None else self.counted

    def residual(self, starts: Starts) -> Tensor:
        """Return residuals from some initial states, shape (B, T, N, 6)."""
        return residuals(self.layer, self.physical, starts.of(self.trajectories), self.logarithm)

    def cost(self, residual: Tensor) -> Tensor:
        """Return the loss of each trajectory, shape (B,)."""
        return torch.stack(list(self.loss(residual, self.real).values())).sum(0)

    def slopes(self, starts: Starts, residual: Tensor) -> Tensor:
        """Return derivatives by the initial states, one-sided differences, shape (D, B, T, N, 6)."""
        count, batch = len(starts.columns), len(self.trajectories)
        moves = MOVE * torch.eye(count).to(residual).repeat_interleave(batch, 0)
        each = self.logarithm
        if each is not None and each.ndim == 2:
            each = each.repeat(count, 1)
        many = dataclasses.replace(self, trajectories=self.trajectories.repeated(count), logarithm=each)
        after = many.residual(starts.repeated(count).moved(moves)).unflatten(0, (count, batch))
        slope: Tensor = (after - residual) / MOVE
        return slope

    @torch.no_grad()
    def fit(self, starts: Starts, most: int = MOST) -> tuple[Starts, int]:
        """Fit the initial states, parameters as they are: Gauss-Newton with damping (Levenberg 1944, Marquardt 1963).

        Args:
            starts: Where to begin.
            most: Most steps.

        Returns:
            The best states that were found, and how many rollouts of all trajectories that took.
        """
        residual, rollouts = self.residual(starts), 1
        cost = self.cost(residual)
        for _ in range(most):
            slopes = self.slopes(starts, residual)
            rollouts += len(slopes) + len(DAMPINGS) + 3
            weight = self.loss.weights(residual, self.real)
            before = cost.sum()
            trials = [starts.moved(_step(slopes, residual, weight, damping)) for damping in DAMPINGS]
            trials.extend(trials[1].simpler())
            for trial in trials:
                try:
                    after = self.residual(trial)
                except SolverError:
                    continue
                reached = self.cost(after)
                better = reached < cost
                starts, cost = starts.chosen(better, trial), torch.where(better, reached, cost)
                residual = torch.where(better[:, None, None, None], after, residual)
            if before - cost.sum() <= SETTLED * before:
                break
        return starts, rollouts

    @torch.no_grad()
    def better(self, starts: Starts, other: Starts) -> tuple[Starts, int]:
        """Fit initial states from another beginning too; return the better ones of each trajectory, and rollouts."""
        fitted, rollouts = self.fit(other)
        better = self.cost(self.residual(fitted)) < self.cost(self.residual(starts))
        return starts.chosen(better, fitted), rollouts + 2

    @torch.no_grad()
    def follow(self, starts: Starts, answer: Tensor) -> TrackedFit:
        """Find how the initial states follow the parameters, from derivatives J (P, B, T, N, 6) at fixed ones."""
        residual = self.residual(starts)
        slopes = self.slopes(starts, residual)
        weight = self.loss.weights(residual, self.real)
        wanted = torch.einsum("dbtni,pbtni,btni->bdp", slopes, answer, weight)
        response = -torch.linalg.solve(_gram(slopes, weight), wanted)
        followed = answer + torch.einsum("dbtni,bdp->pbtni", slopes, response)
        return TrackedFit(starts, response, followed, len(slopes) + 1)


@final
@dataclass(frozen=True)
class TrackedFit:
    """Initial states that follow the parameters to first order.

    Attributes:
        starts: The states at the present parameters.
        response: Their moves along the columns per unit of ln(parameter), -(A^T W A)^-1 A^T W J with A the derivatives
            of the poses by the initial states; shape (B, D, P).
        slopes: What remains of J for the parameters, J + A response; shape (P, B, T, N, 6).
        rollouts: How many rollouts of all trajectories that took.
    """

    starts: Starts
    response: Tensor
    slopes: Tensor
    rollouts: int

    def at(self, change: Tensor) -> Starts:
        """Return the states after a change (P,) of the logarithms, differentiable by it."""
        return self.starts.moved(self.response @ change)


def _axes(normal: Tensor) -> Tensor:
    """Return two tangents of the ground and its normal as rows, shape (3, 3)."""
    axis = torch.eye(3).to(normal)[int(abs(float(normal[0])) > STEEP)]
    tangent = torch.nn.functional.normalize(axis - (axis @ normal) * normal, dim=0)
    return torch.stack([tangent, torch.linalg.cross(normal, tangent), normal])


def _gram(slopes: Tensor, weight: Tensor) -> Tensor:
    """Return A^T W A, (B, D, D); a column without influence, say one that is not free, gets a one."""
    gram = torch.einsum("dbtni,ebtni,btni->bde", slopes, slopes, weight)
    diagonal = gram.diagonal(dim1=1, dim2=2)
    floor = 1e-10 * diagonal.amax(1, keepdim=True) + torch.finfo(gram.dtype).tiny
    return gram + torch.diag_embed(torch.where(diagonal > floor, floor, torch.ones_like(diagonal)))


def _step(slopes: Tensor, residual: Tensor, weight: Tensor, damping: float) -> Tensor:
    """Return the damped step of each trajectory's initial state, shape (B, D)."""
    gram = _gram(slopes, weight)
    damped = gram + damping * torch.diag_embed(gram.diagonal(dim1=1, dim2=2))
    wanted = torch.einsum("dbtni,btni,btni->bd", slopes, residual, weight)
    step: Tensor = torch.linalg.solve(damped, -wanted)
    return step
