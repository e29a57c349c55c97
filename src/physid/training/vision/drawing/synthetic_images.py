"""Images that the decoder draws of the bodies at random poses: exact labels without any recording's poses."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from physid.networks import Encoding, PlanarChart, PoseChart
from physid.physics.rotations import normalize, to_matrix
from physid.training.vision.model import VideoModel

HARD = 0.125
"""Width of hard edges [px]: simulators draw without anti-aliasing, cameras with soft edges; an encoder learns both."""
HEIGHT = 0.04
"""Price of an error of a height [m]: as much as its square at four centimetres, more below."""
SMOOTH = 0.005
"""Error of a height below which it counts by its square after all [m]."""
PLACES = 3.0
"""Weight of positions: a tenth of a block is to cost about as much as some six degrees of its heading."""
FROM_FEATURES = 0.3
"""Weight of a rotation's numbers relative to that of its features, which come first: before, they drown positions."""


@dataclass(frozen=True)
class SyntheticImages:
    """How bodies are placed in imagined images.

    Recordings show few headings, one per trajectory where nothing turns, and an encoder learns those by heart. What the
    bodies look like is known, hence what they would look like anywhere. This is the sleep phase of Hinton et al.
    (1995).

    Attributes:
        frames: Imagined images per trajectory and step; 0 for none.
        extent: How far from the middle of the view bodies are placed, 1 being its edge.
        near: Share of images in which each body lies beside the previous one, as in a collision.
        height: Greatest height above the ground where the chart lets bodies hover [m]; half of them lie on the ground.
        levels: Number of values of a colour; recorded video has 256.
    """

    frames: int = 8
    extent: float = 0.85
    near: float = 0.7
    height: float = 0.15
    levels: int = 256

    def __post_init__(self) -> None:
        if self.frames < 0 or not 0 < self.extent <= 1 or not 0 <= self.near <= 1 or self.height < 0:
            raise ValueError(
                f"synthetic_images needs frames >= 0, extent in (0, 1], near in [0, 1] and height >= 0, got "
                f"{self.frames}, {self.extent}, {self.near} and {self.height}"
            )

    def draw_poses(self, model: VideoModel, batch: int) -> Tensor:
        """Draw poses for the images of so many trajectories, shape (B, frames, N, 7)."""
        chart, like = model.chart, model.decoder.patches
        shape = (batch, self.frames, chart.bodies)
        numbers = like.new_zeros(*shape, chart.numbers)
        numbers[..., :2] = self._places(shape, model, like)
        numbers[..., chart.turning] = _turns(chart, shape, like)
        if isinstance(chart, PlanarChart) and chart.hovering:
            unit = chart.down.norm(dim=-1)
            up = (2 * torch.rand(shape, device=like.device) - 1).clamp_min(0)
            numbers[..., 4] = self.height / unit * up
        return chart.to_pose(numbers)

    def _places(self, shape: tuple[int, int, int], model: VideoModel, like: Tensor) -> Tensor:
        """Draw the first two numbers, where a body appears in the image: (..., N, 2)."""
        place = self.extent * (2 * torch.rand(*shape, 2, device=like.device) - 1)
        size = model.decoder.renderer.size
        camera = model.decoder.renderer.camera
        depth = math.dist(camera.position, camera.target)
        unit = depth * math.tan(math.radians(camera.fov_y) / 2)
        for body in range(1, shape[-1]):
            reach = size[[body - 1, body], :2].mean() / unit
            angle = 2 * math.pi * torch.rand(shape[:2], device=like.device)
            distance = reach * (0.9 + torch.rand(shape[:2], device=like.device))
            beside = place[..., body - 1, :] + distance[..., None] * torch.stack([angle.cos(), angle.sin()], -1)
            close = torch.rand(shape[:2], device=like.device) < self.near
            place[..., body, :] = torch.where(close[..., None], beside.clamp(-1, 1), place[..., body, :])
        return place

    @torch.no_grad()
    def draw_images(self, model: VideoModel, pose: Tensor, background: Tensor) -> Tensor:
        """Draw images (B, f, 3, H, W) of poses (B, f, N, 7), half with hard edges, rounded as a camera rounds."""
        halves = zip(pose.split((pose.shape[1] + 1) // 2, 1), (1.0, HARD), strict=False)
        image = torch.cat([model.decoder(half, background, edge) for half, edge in halves], 1)
        rounded: Tensor = (image * (self.levels - 1)).round() / (self.levels - 1)
        return rounded

    def losses(
        self, model: VideoModel, background: Tensor, rotation_weight: float, *, features: bool = True
    ) -> dict[str, Tensor]:
        """Compute how far the encoder is from the poses of imagined images.

        Args:
            model: Encoder and decoder.
            background: The empty scenes in [0, 1], shape (B, 3, H, W).
            rotation_weight: Weight of the rotation's part [m^2].
            features: Whether early layers learn rotations, too.

        Returns:
            The losses of each trajectory, shape (B,) (see `encoding_losses`); nothing without images.
        """
        if not self.frames:
            return {}
        pose = self.draw_poses(model, len(background))
        encoding = model.encode(self.draw_images(model, pose, background), background)
        losses = encoding_losses(model, encoding, pose, rotation_weight)
        if not features:
            del losses["features"]
        return {f"imagined_{name}": value.mean(1) for name, value in losses.items()}


def _turns(chart: PoseChart, shape: tuple[int, ...], like: Tensor) -> Tensor:
    """Draw the numbers that stand for the rotation, any rotation of the chart alike; (..., N, K')."""
    if isinstance(chart, PlanarChart):
        angle = 2 * math.pi * torch.rand(shape, device=like.device)
        return torch.stack([angle.cos(), angle.sin()], -1)
    turn = normalize(torch.randn(*shape, 4, device=like.device))
    return to_matrix(turn)[..., :2].transpose(-1, -2).flatten(-2)


def encoding_losses(model: VideoModel, encoding: Encoding, pose: Tensor, rotation_weight: float) -> dict[str, Tensor]:
    """Compare what an encoder says with known poses, in the raw numbers of rotations, which have no seam.

    Args:
        model: What the numbers mean, and the encoder's deep supervision.
        encoding: Of B f images.
        pose: The poses that the images show, shape (B, f, N, 7).
        rotation_weight: Weight of rotations [m^2].

    Returns:
        Losses (B, f), summed over bodies: position, 3 times `place_errors` [m^2], rotation, the squared error of its
        numbers, and features, that of the rotation as early layers see it (see `DeepSupervision`), times
        `unknown_share`.
    """
    pose = pose.to(encoding.pose)
    place = PLACES * place_errors(model.chart, encoding.pose[..., :3] - pose[..., :3]).sum(-1)
    numbers, turning = model.chart.to_numbers(pose), model.chart.turning
    turn = (encoding.numbers - numbers)[..., turning].square().sum((-2, -1))
    features = unknown_share(turn, model.chart.bodies) * model.supervision(model.chart, encoding, numbers)
    turn, features = FROM_FEATURES * rotation_weight * turn, rotation_weight * features
    return {"position": place, "rotation": turn, "features": features}


def place_errors(chart: PoseChart, error: Tensor) -> Tensor:
    """Return what errors (..., N, 3) of positions cost [m^2], their squares; of heights d, HEIGHT |d|, smooth near 0.

    A single image hardly says how high a body hovers. By the square the best answer is the mean of all heights that it
    may have, right for none of them; by the absolute value it is their median, the ground where most bodies lie.
    """
    if not (isinstance(chart, PlanarChart) and chart.hovering):
        return error.square().sum(-1)
    normal = chart.normal.to(error)
    height = (error * normal).sum(-1)
    across = error - height[..., None] * normal
    return across.square().sum(-1) + HEIGHT * ((height.square() + SMOOTH**2).sqrt() - SMOOTH)


def unknown_share(error: Tensor, bodies: int) -> Tensor:
    """Return how little is known of rotations, by which features count: 1 at first, 0 where all are right.

    Once rotations are known, positions have the layers to themselves; of a constant weight the features would outweigh
    them to the end.

    Args:
        error: Squared errors of the rotations' numbers, summed over bodies; 1 for each of which nothing is known.
        bodies: Number of bodies.
    """
    return (error.detach().mean() / bodies).clamp(max=1)
