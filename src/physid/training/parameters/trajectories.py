"""A batch of recorded trajectories, whole or cut into segments."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from physid.physics.layer import PhysicsLayer, Rollout, SolverError
from physid.physics.parameters import Parameters
from physid.physics.state import State, check_shape
from physid.training.initial_states.twist import twist_from_poses


@dataclass(frozen=True)
class Trajectories:
    """Recorded trajectories of N bodies; shorter ones are padded at the end.

    Attributes:
        pose: Position [m] and unit quaternion x y z w, world frame; shape (B, T, N, 7).
        twist: Angular [rad/s] and linear [m/s] velocity, recorded or estimated from the poses; shape (B, T, N, 6).
        wrench: Torque [N m] and force [N], held from frame t to t + 1; shape (B, T, N, 6).
        length: Frames that are real, shape (B,).
        index: Which trajectory of the recording set it is, shape (B,).
        origin: State that it is predicted from, pose and twist, shape (B, N, 13); None for that of the first frame.

    Raises:
        ValueError: If a shape is off.
    """

    pose: Tensor
    twist: Tensor
    wrench: Tensor
    length: Tensor
    index: Tensor
    origin: Tensor | None = None

    def __post_init__(self) -> None:
        check_shape("pose", self.pose, (None, None, None, 7))
        batch, frames, bodies, _ = self.pose.shape
        check_shape("twist", self.twist, (batch, frames, bodies, 6))
        check_shape("wrench", self.wrench, (batch, frames, bodies, 6))
        check_shape("length", self.length, (batch,))
        check_shape("index", self.index, (batch,))

    @classmethod
    def of(cls, batch: Mapping[str, Any], time_step: float) -> Trajectories:
        """Build trajectories from a batch of the data module; twists may be estimated.

        Args:
            batch: What `physid.data.dataset.Segments` serves; without `twist` it is estimated.
            time_step: Time between frames [s].
        """
        pose, length = batch["pose"].double(), batch["length"]
        twist = batch["twist"].double() if "twist" in batch else twist_from_poses(pose, length, time_step)
        return cls(pose, twist, batch["wrench"].double(), length, batch["index"])

    def __len__(self) -> int:
        return len(self.pose)

    @property
    def start(self) -> State:
        """States to predict from."""
        if self.origin is not None:
            return State(self.origin[..., :7], self.origin[..., 7:])
        return State(self.pose[:, 0], self.twist[:, 0])

    @property
    def real(self) -> Tensor:
        """Which frames are real, shape (B, T)."""
        return torch.arange(self.pose.shape[1], device=self.pose.device) < self.length[:, None]

    def rolled(self, layer: PhysicsLayer, parameters: Parameters, wrench: Tensor | None = None) -> Rollout:
        """Predict them from their initial states.

        Args:
            layer: The physics.
            parameters: Of all, or of each trajectory.
            wrench: Other wrenches than those recorded, shape (B, T', N, 6).

        Returns:
            Poses as the camera reports them (see `PhysicsLayer.observe`); all else as it is.

        Raises:
            SolverError: If a contact problem cannot be solved; the message begins with the trajectories.
            ValueError: If the initial states are those that a camera reports, and it does not report true ones.
        """
        if layer.distorts and self.origin is None:
            raise ValueError(
                "expected initial states that are fitted where a perception effect is at work, got recorded ones; "
                "leave model.start out, or set it to fitted"
            )
        wrench = self.wrench if wrench is None else wrench
        try:
            rollout = layer.rollout(self.start, wrench[:, :-1], parameters)
            return dataclasses.replace(rollout, pose=layer.observe(rollout.pose))
        except SolverError as error:
            which = sorted({int(self.index[sample]) for sample in error.samples})
            shown = ", ".join(map(str, which[:5])) + (", ..." if len(which) > 5 else "")
            raise SolverError(f"trajectory {shown}: {error}", error.samples) from None

    def predicted(self, layer: PhysicsLayer, parameters: Parameters, wrench: Tensor | None = None) -> Trajectories:
        """Return what is predicted from their initial states, under their own or other wrenches (see `rolled`)."""
        rollout = self.rolled(layer, parameters, wrench)
        if wrench is None:
            return Trajectories(rollout.pose, rollout.twist, self.wrench, self.length, self.index)
        length = torch.full_like(self.length, wrench.shape[1])
        return Trajectories(rollout.pose, rollout.twist, wrench, length, self.index)

    def repeated(self, copies: int) -> Trajectories:
        """Return the batch `copies` times in a row, (copies * B, ...): one for each candidate of the parameters."""
        return self._map(lambda value: value.repeat(copies, *[1] * (value.ndim - 1)))

    def chosen(self, which: Tensor) -> Trajectories:
        """Return some of the trajectories, by a mask (B,)."""
        return self._map(lambda value: value[which])

    def segments(self, steps: int | None) -> Trajectories:
        """Cut every trajectory into segments of `steps` steps; each ends in the frame in which the next begins.

        A segment starts from the recorded state, so that an error cannot grow over more than `steps` steps (multiple
        shooting with the recorded states as nodes).

        Args:
            steps: Steps of a segment, or None for whole trajectories.

        Returns:
            The segments of all trajectories, of steps + 1 frames; a last one that is too short is padded.

        Raises:
            ValueError: If `steps` is not positive.
        """
        if steps is None or steps >= self.pose.shape[1] - 1:
            return self
        if steps < 1:
            raise ValueError(f"a segment must have at least 1 step, got {steps}")
        frames = self.pose.shape[1]
        starts = torch.arange(0, frames - 1, steps, device=self.pose.device)
        at = (starts[:, None] + torch.arange(steps + 1, device=self.pose.device)).clamp_max(frames - 1)
        length = (self.length[:, None] - starts).clamp(max=steps + 1).flatten()
        keep = length > 1
        return Trajectories(
            **{name: getattr(self, name)[:, at].flatten(0, 1)[keep] for name in ("pose", "twist", "wrench")},
            length=length[keep],
            index=self.index.repeat_interleave(len(starts))[keep],
        )

    def beginnings(self, frames: int) -> Trajectories:
        """Return the first frames of every trajectory, at most half of the longest."""
        frames = max(2, min(frames, self.pose.shape[1] // 2))
        cut = {name: getattr(self, name)[:, :frames] for name in ("pose", "twist", "wrench")}
        return dataclasses.replace(self, **cut, length=self.length.clamp_max(frames))

    def _map(self, change: Any) -> Trajectories:
        values = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        return Trajectories(**{name: change(value) for name, value in values.items() if value is not None})
