"""What the rigid bodies of a batch are doing: poses and twists."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import torch
from torch import Tensor

QUATERNION_TOLERANCE = 1e-3


def check_shape(name: str, value: Tensor, shape: tuple[int | None, ...]) -> None:
    """Raise a ValueError that names the field unless `value` has `shape` (None: any length) and is finite.

    Raises:
        ValueError: If the number of axes, a length, or the finiteness of a value is off.
    """
    fits = value.ndim == len(shape) and all(
        want is None or want == have for want, have in zip(shape, value.shape, strict=True)
    )
    if not fits:
        wanted = ", ".join("any" if want is None else str(want) for want in shape)
        raise ValueError(f"{name} must have shape ({wanted}), got {tuple(value.shape)}")
    if not torch.isfinite(value).all():
        bad = int((~torch.isfinite(value)).sum())
        raise ValueError(f"{name} must be finite, got {bad} of {value.numel()} values that are not")


@dataclass(frozen=True)
class State:
    """Poses and twists of N bodies in a batch of B worlds, world frame, z up.

    Attributes:
        pose: Position of the centre [m], then unit quaternion x y z w; shape (B, N, 7).
        twist: Angular [rad/s], then linear velocity [m/s] of the centre; shape (B, N, 6).

    Shapes and device are checked here, values by `checked` and at the border of a rollout.

    Raises:
        ValueError: If a shape is off, or poses and twists are not on one device.
    """

    pose: Tensor
    twist: Tensor

    def __post_init__(self) -> None:
        bodies = self.pose.shape[:-1]
        for name, value, width in (("pose", self.pose, 7), ("twist", self.twist, 6)):
            if value.shape != (*bodies, width):
                raise ValueError(f"{name} must have shape {(*bodies, width)}, got {tuple(value.shape)}")
        if self.pose.device != self.twist.device:
            raise ValueError(f"twist must be on {self.pose.device} as the poses are, got {self.twist.device}")

    @classmethod
    def checked(cls, pose: Tensor, twist: Tensor) -> State:
        """Build a state from values that come from outside, after checking them.

        Raises:
            ValueError: If a shape is off, a value is not finite, or a quaternion is not of unit length.
        """
        check_shape("pose", pose, (None, None, 7))
        check_shape("twist", twist, (*pose.shape[:2], 6))
        norm = pose[..., 3:].norm(dim=-1)
        if (norm - 1).abs().max() > QUATERNION_TOLERANCE:
            worst = float(norm.flatten()[(norm - 1).abs().argmax()])
            raise ValueError(
                f"pose must hold unit quaternions (x, y, z, w) in its last 4 columns, got one of length "
                f"{worst:.6g}; normalise it, and check that its order is not w, x, y, z"
            )
        return cls(pose, twist)

    @classmethod
    def at_rest(cls, pose: Tensor) -> State:
        """Build a state of bodies that do not move; pose of shape (B, N, 7)."""
        return cls.checked(pose, torch.zeros_like(pose[..., :6]))

    @property
    def position(self) -> Tensor:
        """Positions of the centres [m]; shape (B, N, 3)."""
        return self.pose[..., :3]

    @property
    def quaternion(self) -> Tensor:
        """Unit quaternions x y z w; shape (B, N, 4)."""
        return self.pose[..., 3:]

    @property
    def angular_velocity(self) -> Tensor:
        """Angular velocities, world frame [rad/s]; shape (B, N, 3)."""
        return self.twist[..., :3]

    @property
    def velocity(self) -> Tensor:
        """Linear velocities of the centres [m/s]; shape (B, N, 3)."""
        return self.twist[..., 3:]

    def replace(self, **changes: Tensor) -> State:
        """Return a copy with some fields changed."""
        return dataclasses.replace(self, **changes)
