"""The state from which a trajectory is rolled out, from encoded poses: at rest, or with an estimated velocity."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from physid.networks.velocity import velocity_from_poses
from physid.physics import Parameters, PhysicsLayer, State
from physid.physics.rotations import conjugate, rotate

PASSES = 2
"""How often effective wrenches are measured: from mean velocities first, then from the velocities found."""


@dataclass(frozen=True)
class Start:
    """How the initial state follows from encoded poses.

    At rest the initial pose is all that counts, as in the paper without supervision. Otherwise velocities come from the
    poses of frames 0, S and 2 S by the paper's eq. (4), never from the network. Its effective force is the known wrench
    with everything that the ground does: it is measured by rolling out a guess for 2 S frames, f = M (v(t + h) - v(t))
    / h.

    Attributes:
        at_rest: Whether trajectories are known to start at rest.
        spacing: S, frames between the three poses [frames]. An error of 2 mm in a pose is 0.5 m/s from one frame to the
            next, and 0.05 m/s over 10.
    """

    at_rest: bool = True
    spacing: int = 10

    def __post_init__(self) -> None:
        if self.spacing < 1:
            raise ValueError(f"spacing must be at least 1 frame, got {self.spacing}")

    def places(self, shown: Tensor) -> Tensor:
        """Find the frames that are needed, 0 alone or 0, S and 2 S, among those shown (B, f); shape (B, 1 or 3).

        Raises:
            ValueError: If one of them is not shown.
        """
        wanted = [0] if self.at_rest else [0, self.spacing, 2 * self.spacing]
        here = shown[:, None] == shown.new_tensor(wanted)[:, None]
        missing = [frame for frame, there in zip(wanted, here.any(-1).all(0).tolist(), strict=True) if not there]
        if missing:
            raise ValueError(f"initial states need frames {wanted}, not shown are {missing}; name them in data.video")
        return here.int().argmax(-1)

    def __call__(
        self, pose: Tensor, shown: Tensor, wrench: Tensor, layer: PhysicsLayer, parameters: Parameters
    ) -> State:
        """Find the states at frame 0.

        Args:
            pose: Encoded poses, shape (B, f, N, 7).
            shown: Which frames they belong to, shape (B, f).
            wrench: Known wrenches, shape (B, T, N, 6).
            layer: The physics.
            parameters: The physical parameters.

        Raises:
            ValueError: If a frame that is needed is not shown.
        """
        needed = pose[torch.arange(len(pose), device=pose.device)[:, None], self.places(shown)]
        first = needed[:, 0]
        twist = first.new_zeros(*first.shape[:2], 6)
        if self.at_rest:
            return State(first, twist)
        known, world = wrench[:, : 2 * self.spacing], layer.world
        force, substeps = torch.zeros_like(known), None if world.midpoint else world.substeps
        for _ in range(PASSES):
            twist = velocity_from_poses(needed, force, parameters, world.time_step, substeps=substeps).twist
            force = _effective(State(first, twist.detach()), known, layer, parameters)
        twist = velocity_from_poses(needed, force, parameters, world.time_step, substeps=substeps).twist
        return State(first, twist)


@torch.no_grad()
def _effective(state: State, wrench: Tensor, layer: PhysicsLayer, parameters: Parameters) -> Tensor:
    """Measure torques and forces (B, S, N, 6), the ground's included, along a rollout."""
    rollout = layer.rollout(State(state.pose.detach(), state.twist), wrench, parameters)
    acceleration = rollout.twist.diff(dim=1) / layer.world.time_step
    turn = state.pose[:, None, :, 3:].expand(*acceleration.shape[:-1], 4)
    torque = rotate(turn, parameters.inertia[:, None] * rotate(conjugate(turn), acceleration[..., :3]))
    return torch.cat([torque, parameters.mass[:, None, :, None] * acceleration[..., 3:]], -1)
