"""Charts: what the raw numbers of a network mean as poses, and back."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import final

import torch
from torch import Tensor, nn

from physid.networks.camera import PinholeCamera
from physid.networks.symmetry import Symmetry
from physid.physics.rotations import conjugate, exponential, from_matrix, multiply, normalize, to_matrix


class PoseChart(nn.Module, ABC):
    """Maps K numbers per body, of the order of 1 over the field of view, to its pose and back.

    Attributes:
        numbers: K.
        turning: Which of them stand for the rotation.
        heights: Which of them are heights above the ground, below which no body is; an empty slice if none are.
        symmetries: What is invisible about each body's rotation; N = len(symmetries).
    """

    numbers: int
    turning: slice
    heights: slice
    symmetries: tuple[Symmetry, ...]

    @property
    def bodies(self) -> int:
        """Number of bodies N."""
        return len(self.symmetries)

    @abstractmethod
    def to_pose(self, numbers: Tensor) -> Tensor:
        """Turn raw numbers (..., N, K) into poses: position [m] and unit quaternion, shape (..., N, 7)."""

    @abstractmethod
    def to_numbers(self, pose: Tensor) -> Tensor:
        """Turn poses (..., N, 7) into the raw numbers (..., N, K) that stand for them."""

    @abstractmethod
    def neutral(self) -> Tensor:
        """Give the raw numbers of an unturned body in the middle of the view, where learning starts; shape (K,)."""

    def forward(self, numbers: Tensor) -> Tensor:
        """Turn raw numbers (..., N, K) into poses (..., N, 7)."""
        return self.to_pose(numbers)


def _upright(normal: Tensor) -> Tensor:
    """Find the shortest rotation that takes z to the unit vector `normal`; shape (4,)."""
    x, y, z = normal.unbind()
    return normalize(torch.stack([-y, x, torch.zeros_like(z), 1 + z]))


@final
class PlanarChart(PoseChart):
    """Bodies that lie flat on a plane: numbers (a, b, cos k yaw, sin k yaw), and, if they may hover, the height.

    The centre is m + a right + b down (+ height normal): m is where the optical axis meets the plane through a body
    at rest, the in-plane vectors span half the view there. Yaw turns the body about the plane's normal; k is the
    order of its symmetry, so that poses that look alike have the same numbers and no angle has a seam.

    Args:
        camera: The camera; it must look down on the plane.
        normal: Unit normal of the plane, on the side of the bodies.
        offset: The plane holds the points p with normal . p = offset [m].
        thickness: Full extent of each body along the normal [m].
        symmetries: One of each body; none by default.
        hovering: Whether bodies may leave the plane (a fifth number).

    Raises:
        ValueError: If the camera does not see the plane from above.
    """

    right: Tensor
    down: Tensor
    middle: Tensor
    normal: Tensor
    upright: Tensor
    order: Tensor

    def __init__(
        self,
        camera: PinholeCamera,
        normal: Sequence[float],
        offset: float,
        thickness: Sequence[float],
        symmetries: Sequence[Symmetry] | None = None,
        *,
        hovering: bool = False,
    ) -> None:
        super().__init__()
        self.symmetries = tuple(symmetries or [Symmetry.NONE] * len(thickness))
        if len(self.symmetries) != len(thickness):
            raise ValueError(f"chart needs one symmetry of each of {len(thickness)} bodies, got {len(self.symmetries)}")
        self.hovering = hovering
        self.turning = slice(2, 4)
        self.numbers = 5 if hovering else 4
        self.heights = slice(4, self.numbers)
        up = torch.tensor(normal, dtype=torch.float64)
        right, down, forward = camera.rotation
        eye = torch.tensor(camera.position, dtype=torch.float64)
        rest = offset + torch.tensor(thickness, dtype=torch.float64) / 2
        depth = (rest - eye @ up) / (forward @ up)
        if forward @ up >= 0 or (depth <= 0).any():
            raise ValueError(
                f"camera at {camera.position} looking at {camera.target} must look down on the plane "
                f"{tuple(normal)} . p = {offset:.6g} from above its bodies; are size and "
                "camera in metres, and does z point up? Else move it, or use SpatialChart"
            )
        across = right - (right @ up) * up
        across = across / across.norm()
        along = torch.linalg.cross(up, across)
        along = along * torch.sign(along @ down)
        half_view = depth[:, None] * camera.height / 2 / camera.focal_length
        buffers = {
            "right": half_view * camera.width / camera.height * across,
            "down": half_view / (forward @ up).abs() * along,
            "middle": eye + depth[:, None] * forward,
            "normal": up,
            "upright": _upright(up),
        }
        for name, value in buffers.items():
            self.register_buffer(name, value.float(), persistent=False)
        self.register_buffer("order", torch.tensor([float(s.order) for s in self.symmetries]), persistent=False)

    def to_pose(self, numbers: Tensor) -> Tensor:
        """Turn raw numbers (..., N, 4 or 5) into poses: position [m] and unit quaternion, shape (..., N, 7)."""
        a, b, cosine, sine = numbers[..., :4].unbind(-1)
        position = (
            self.middle.to(numbers) + a[..., None] * self.right.to(numbers) + b[..., None] * self.down.to(numbers)
        )
        if self.hovering:
            height = numbers[..., 4:] * self.down.to(numbers).norm(dim=-1, keepdim=True)
            position = position + height * self.normal.to(numbers)
        yaw = torch.atan2(sine, cosine) / self.order.to(numbers)
        zero = torch.zeros_like(yaw)
        turn = exponential(torch.stack([zero, zero, yaw], -1))
        return torch.cat([position, multiply(self.upright.to(numbers).expand_as(turn), turn)], -1)

    def to_numbers(self, pose: Tensor) -> Tensor:
        """Turn poses (..., N, 7) into raw numbers (..., N, 4 or 5), dropping what does not lie in the plane."""
        from_middle = pose[..., :3] - self.middle.to(pose)
        right, down = self.right.to(pose), self.down.to(pose)
        a = (from_middle * right).sum(-1) / right.square().sum(-1)
        b = (from_middle * down).sum(-1) / down.square().sum(-1)
        turn = multiply(conjugate(self.upright.to(pose)).expand_as(pose[..., 3:]), pose[..., 3:])
        angle = 2 * torch.atan2(turn[..., 2], turn[..., 3]) * self.order.to(pose)
        numbers = torch.stack([a, b, angle.cos(), angle.sin()], -1)
        if not self.hovering:
            return numbers
        height = (from_middle * self.normal.to(pose)).sum(-1, keepdim=True) / down.norm(dim=-1, keepdim=True)
        return torch.cat([numbers, height], -1)

    def neutral(self) -> Tensor:
        """Give the raw numbers of an unturned body in the middle of the view."""
        return torch.tensor([0.0, 0.0, 1.0, 0.0] + [0.0] * self.hovering)


@final
class SpatialChart(PoseChart):
    """Bodies anywhere in front of the camera: numbers (a, b, c) for the position and six for the rotation.

    The centre falls on the image at (a, b), 1 being half the view, at depth d exp(c), with d that of the camera's
    target. The six numbers are two columns of the rotation matrix before they are made orthonormal (Zhou et al.
    2019), which is continuous for all rotations.

    Args:
        camera: The camera.
        bodies: Number of bodies N. Their appearance must show every rotation: there is no continuous chart of all
            rotations modulo a symmetry.
    """

    def __init__(self, camera: PinholeCamera, bodies: int) -> None:
        super().__init__()
        self.symmetries = (Symmetry.NONE,) * bodies
        self.numbers, self.turning, self.heights = 9, slice(3, 9), slice(0)
        axis = torch.tensor(camera.target, dtype=torch.float64) - torch.tensor(camera.position, dtype=torch.float64)
        self.depth = float(axis.norm())
        self.camera = camera

    def to_pose(self, numbers: Tensor) -> Tensor:
        """Turn raw numbers (..., N, 9) into poses: position [m] and unit quaternion, shape (..., N, 7)."""
        view = numbers.new_tensor([self.camera.width, self.camera.height]) / 2
        pixels = view * (1 + numbers[..., :2])
        position = self.depth * torch.exp(numbers[..., 2:3]) * self.camera.rays(pixels)
        first, second = numbers[..., 3:6], numbers[..., 6:9]
        x = first / first.norm(dim=-1, keepdim=True)
        second = second - (x * second).sum(-1, keepdim=True) * x
        y = second / second.norm(dim=-1, keepdim=True)
        matrix = torch.stack([x, y, torch.linalg.cross(x, y)], -1)
        return torch.cat([position + numbers.new_tensor(self.camera.position), from_matrix(matrix)], -1)

    def to_numbers(self, pose: Tensor) -> Tensor:
        """Turn poses (..., N, 7) of bodies in front of the camera into raw numbers (..., N, 9)."""
        view = pose.new_tensor([self.camera.width, self.camera.height]) / 2
        image = self.camera.project(pose[..., :3]) / view - 1
        depth = self.camera.to_camera(pose[..., :3])[..., 2:]
        columns = to_matrix(pose[..., 3:])[..., :2].transpose(-1, -2).flatten(-2)
        return torch.cat([image, torch.log(depth / self.depth), columns], -1)

    def neutral(self) -> Tensor:
        """Give the raw numbers of an unturned body in the middle of the view."""
        return torch.tensor([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0])
