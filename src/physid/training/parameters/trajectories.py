"""A batch of recorded trajectories, whole or cut into segments."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from physid.data.observations.step_grid import StepGrid
from physid.estimation.measurement import Noise, estimate_noise, noise_of_poses, pose_difference
from physid.estimation.prediction import Timeline
from physid.physics import Parameters, PhysicsLayer, Rollout, SolverError, State, check_shape
from physid.training.parameters.twist import twist_from_poses

OVER_TIME = ("pose", "twist", "wrench", "time", "seen", "again", "stretch")


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
        time: Time of each frame since the first of the recording [s], shape (B, T); None for one step per frame.
        seen: Frames in which all bodies were seen, shape (B, T); None for all that are real.
        grid: Steps of the engine, and the forces that act in them, instead of `wrench`, which is then their mean from
            frame to frame; None for one step per frame.
        again: Poses that were read from films, drawn and read a second time, shape (B, T, N, 7); None for a sensor of
            poses.
        stretch: What a standard deviation of the scale of such poses changes of them, shape (B, T, N, 6).
        weight: How much each frame of a trajectory counts beside those of others, shape (B,); None where each
            trajectory counts as much as any other, however long it is.

    Raises:
        ValueError: If a shape is off, or there are steps without times.
    """

    pose: Tensor
    twist: Tensor
    wrench: Tensor
    length: Tensor
    index: Tensor
    origin: Tensor | None = None
    time: Tensor | None = None
    seen: Tensor | None = None
    grid: StepGrid | None = None
    again: Tensor | None = None
    stretch: Tensor | None = None
    weight: Tensor | None = None

    def __post_init__(self) -> None:
        check_shape("pose", self.pose, (None, None, None, 7))
        batch, frames, bodies, _ = self.pose.shape
        check_shape("twist", self.twist, (batch, frames, bodies, 6))
        check_shape("wrench", self.wrench, (batch, frames, bodies, 6))
        check_shape("length", self.length, (batch,))
        check_shape("index", self.index, (batch,))
        for name, value in (("time", self.time), ("seen", self.seen)):
            if value is not None:
                check_shape(name, value, (batch, frames))
        if self.grid is not None:
            check_shape("grid.wrench", self.grid.wrench, (batch, None, bodies, 6))
            check_shape("grid.frame_step", self.grid.frame_step, (batch, frames))
            if self.time is None:
                raise ValueError("time: expected the times of the frames beside the steps between them, got none")

    @classmethod
    def of(cls, batch: Mapping[str, Any], time_step: float, arrival: float | None = None) -> Trajectories:
        """Build trajectories from a batch of the data module; twists may be estimated.

        Args:
            batch: What `physid.data.batches.dataset.Segments` serves; without `twist` it is estimated.
            time_step: Time between frames [s].
            arrival: Step over which a velocity is the mean one [s] (see `twist_from_poses`); None for `time_step`.
        """
        pose, length = batch["pose"].double(), batch["length"]
        time, seen, grid = None, None, None
        if "time" in batch:
            time, seen = batch["time"].double(), batch["seen"].all(-1)
            grid = StepGrid(batch["steps"], batch["step_wrench"], batch["frame_step"], batch["count"])
        if "twist" in batch:
            twist = batch["twist"].double()
        else:
            twist = twist_from_poses(pose, length, time_step, time=time, seen=seen, arrival=arrival)
        films = [batch[name].double() if name in batch else None for name in ("again", "stretch")]
        return cls(pose, twist, batch["wrench"].double(), length, batch["index"], None, time, seen, grid, *films)

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
        """Which frames count: real ones in which all bodies were seen, shape (B, T)."""
        real = torch.arange(self.pose.shape[1], device=self.pose.device) < self.length[:, None]
        return real if self.seen is None else real & self.seen

    @property
    def share(self) -> Tensor:
        """How much each trajectory counts beside the others, 1 in the mean, shape (B,)."""
        if self.weight is None:
            return torch.ones_like(self.pose[:, 0, 0, 0])
        counts = self.weight * self.real.sum(1)
        return counts / counts.mean()

    @property
    def noise(self) -> Noise:
        """The sensor's noise, as the poses alone show it."""
        return noise_of_poses(self.pose, self.real, self.time)

    def noise_beside(self, residual: Tensor, scale: Tensor) -> Noise:
        """Return the sensor's noise as poses or residuals show it, whichever is less.

        Poses at a slow rate bend beside impacts and reversals, which is no noise; residuals do where a model is wrong.

        Args:
            residual: Observed minus predicted, shape (B, T, N, 6).
            scale: Zero where there is nothing to see, same shape.
        """
        return self.noise.or_less(estimate_noise(residual, (scale > 0).any(-1).to(residual.dtype)))

    def stepped(self, time_step: float) -> Trajectories:
        """Return the same with steps of their own: where there are none, one from frame to frame."""
        if self.grid is not None:
            return self
        line = Timeline.regular(self.wrench, time_step)
        count = (self.length - 1).clamp_min(1).to(line.grid.count)
        frame_step = torch.minimum(line.grid.frame_step.to(count), (self.length - 1)[:, None])
        steps = line.grid.steps.to(self.pose)
        grid = StepGrid(steps, line.grid.wrench, frame_step, count)
        return dataclasses.replace(self, time=line.time.to(self.pose).expand(len(self), -1), grid=grid)

    def to(self, device: torch.device | str) -> Trajectories:
        """Return the same on another device."""
        return self._map(lambda value: value.to(device))

    def residual(self, layer: PhysicsLayer, parameters: Parameters) -> Tensor:
        """Predict from the initial states and compare with what was recorded, (B, T, N, 6); see `pose_difference`."""
        return pose_difference(self.rolled(layer, parameters).pose, self.pose)

    def refined(self, factors: int | Tensor) -> Trajectories:
        """Return the same with steps cut into equal parts (see `StepGrid.refine`); nothing where there are none."""
        return self if self.grid is None else dataclasses.replace(self, grid=self.grid.refine(factors))

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
        try:
            if self.grid is not None and wrench is None:
                return self._stepped_through(layer, parameters, self.grid)
            wrench = self.wrench if wrench is None else wrench
            rollout = layer.rollout(self.start, wrench[:, :-1], parameters)
            return dataclasses.replace(rollout, pose=layer.observe(rollout.pose, parameters=parameters))
        except SolverError as error:
            which = sorted({int(self.index[sample]) for sample in error.samples})
            shown = ", ".join(map(str, which[:5])) + (", ..." if len(which) > 5 else "")
            raise SolverError(f"trajectory {shown}: {error}", error.samples) from None

    def _stepped_through(self, layer: PhysicsLayer, parameters: Parameters, grid: StepGrid) -> Rollout:
        """Predict over the steps of the grid, and pick what the frames show."""
        assert self.time is not None
        rollout = layer.rollout(
            self.start, grid.wrench, parameters, lengths=grid.count, steps=grid.steps, start=self.time[:, 0]
        )

        def at_frames(states: Tensor) -> Tensor:
            index = grid.frame_step.reshape(*grid.frame_step.shape, *[1] * (states.ndim - 2))
            return states.gather(1, index.expand(-1, -1, *states.shape[2:]))

        impulse = torch.nn.functional.pad(rollout.impulse.cumsum(1), (0, 0, 0, 0, 1, 0))
        return dataclasses.replace(
            rollout,
            pose=layer.observe(at_frames(rollout.pose), self.time, parameters),
            twist=at_frames(rollout.twist),
            impulse=at_frames(impulse).diff(dim=1),
        )

    def planned(self, wrench: Tensor, time_step: float) -> Trajectories:
        """Return what is to come of other forces: frames one time step apart, from the same initial states.

        Args:
            wrench: Held from each frame to the next, shape (B, T', N, 6).
            time_step: Time between frames [s].

        Returns:
            Trajectories of T' frames, whose poses and twists are those of the initial states.
        """
        frames, start = wrench.shape[1], self.start
        pose, twist = (value[:, None].expand(-1, frames, -1, -1) for value in (start.pose, start.twist))
        whole = torch.full_like(self.length, frames)
        return Trajectories(pose, twist, wrench, whole, self.index, self.origin).stepped(time_step)

    def predicted(self, layer: PhysicsLayer, parameters: Parameters, wrench: Tensor | None = None) -> Trajectories:
        """Return what is predicted from their initial states, under their own or other wrenches (see `rolled`)."""
        rollout = self.rolled(layer, parameters, wrench)
        if wrench is None:
            return dataclasses.replace(self, pose=rollout.pose, twist=rollout.twist, origin=None)
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
        cut = {name: getattr(self, name)[:, at].flatten(0, 1) for name in OVER_TIME if getattr(self, name) is not None}
        if self.seen is not None:
            # Nothing is known of a segment whose poses are those of one frame.
            keep = keep & (cut["seen"].sum(1) > 1)
        cut = {name: value[keep] for name, value in cut.items()}
        index = self.index.repeat_interleave(len(starts))[keep]
        grid = self.grid
        if grid is not None:
            row = torch.arange(len(self), device=at.device).repeat_interleave(len(starts))[keep]
            grid = grid.between(row, at.repeat(len(self), 1)[keep])
        return Trajectories(**cut, length=length[keep], index=index, grid=grid)

    def beginnings(self, frames: int) -> Trajectories:
        """Return the first frames of every trajectory, at most half of the longest."""
        frames = max(2, min(frames, self.pose.shape[1] // 2))
        cut = {name: getattr(self, name)[:, :frames] for name in OVER_TIME if getattr(self, name) is not None}
        grid = self.grid
        if grid is not None:
            every = torch.arange(len(self), device=grid.count.device)
            grid = grid.between(every, torch.arange(frames, device=grid.count.device).expand(len(self), -1))
        return dataclasses.replace(self, **cut, length=self.length.clamp_max(frames), grid=grid)

    def _map(self, change: Any) -> Trajectories:
        values = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        if self.grid is not None:
            values["grid"] = StepGrid(**{name: change(value) for name, value in vars(self.grid).items()})
        return Trajectories(
            **{name: change(value) if isinstance(value, Tensor) else value for name, value in values.items()}
        )
