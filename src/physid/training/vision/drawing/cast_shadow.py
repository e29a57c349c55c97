"""The shadow that boxes cast on the ground in the light of one lamp far away."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import torch
from torch import Tensor

from physid.networks import PinholeCamera
from physid.networks.appearance import pixel_rows
from physid.physics.rotations import to_matrix
from physid.scenes import Ground

UPRIGHT = 0.9
"""Share of x in the normal of a ground from which on y is the first axis along it."""


@final
@dataclass(frozen=True)
class CastShadow:
    """Light that the ground misses beside boxes.

    Along parallel rays each box is projected onto the ground. Its edges e_i become the vectors g_i of a plane, its
    centre the point c, and its shadow is the zonogon of all points x with |n_i . (x - c)| <= sum_j |n_i . g_j| / 2,
    where n_i is the unit normal of g_i. Each of its sides is as soft as the integral of a normal density. The ground
    lacks the share `darkness` of its light in a shadow, and as much of what is left in the shadow of another box.
    Shadows on boxes are left out.

    Attributes:
        ground: The plane that the shadow lies on.
        slope: How far a ray of light goes along the ground for each metre that it descends, along both of
            `axes_of(ground)`; the shadow of a point at height h lies -h slope from the point below it.
        darkness: Share of the light of the lamp in that of the ground, from 0 to 1.
        softness: Standard deviation of the edges [m].
    """

    ground: Ground
    slope: tuple[float, float]
    darkness: float
    softness: float

    def light(
        self, camera: PinholeCamera, pose: Tensor, size: Tensor, shape: tuple[int, int], corner: Tensor | None = None
    ) -> Tensor:
        """Measure which share of its light the ground has in each pixel.

        Args:
            camera: Sees the ground; above the horizon there is none, and no shadow.
            pose: Poses of the boxes, shape (B, T, N, 7).
            size: Full edge lengths [m], shape (N, 3).
            shape: Rows and columns of the part of the view that is compared.
            corner: Column and row of its first pixel, shape (B, 2); None for the whole view.

        Returns:
            Shares in [1 - darkness, 1], without regard to bodies before the ground, shape (B, T, *shape).
        """
        point = ground_points(camera, self.ground, shape, corner)
        share: Tensor = 1 - self.darkness * self.shade(point, pose, size)
        return share.view(*share.shape[:2], *shape)

    def shade(self, point: Tensor, pose: Tensor, size: Tensor) -> Tensor:
        """Measure how deep points of the ground (B, P, 2) lie in the shadow of boxes (B, T, N, 7), 0 to 1: (B, T, P).

        Points are counted along `axes_of(ground)`; those that are not finite lie in no shadow.
        """
        centre, edge = self._projected(pose, size)
        normal = torch.stack([-edge[..., 1], edge[..., 0]], -1)
        normal = normal / normal.norm(dim=-1, keepdim=True).clamp_min(torch.finfo(pose.dtype).tiny)
        half = (normal[..., :, None, :] * edge[..., None, :, :]).sum(-1).abs().sum(-1) / 2
        seen = torch.isfinite(point).all(-1)[:, None]
        along = torch.einsum("bpk,btnik->btnip", torch.where(seen[:, 0, :, None], point, 0.0), normal)
        away = (along - (normal * centre[..., None, :]).sum(-1)[..., None]).abs()
        beyond = half[..., None] > 0  # an edge along the light bounds nothing
        inside = torch.where(beyond, torch.special.ndtr((half[..., None] - away) / self.softness), 1.0).prod(-2)
        return torch.where(seen, 1 - (1 - inside).prod(-2), 0.0)

    def _projected(self, pose: Tensor, size: Tensor) -> tuple[Tensor, Tensor]:
        """Project centres and edges of boxes (..., N, 7) onto the ground: (..., N, 2) and (..., N, 3, 2)."""
        normal, axes = pose.new_tensor(self.ground.normal), axes_of(self.ground).to(pose)
        slope = pose.new_tensor(self.slope)
        centre, edges = pose[..., :3], to_matrix(pose[..., 3:]).transpose(-1, -2) * size.to(pose)[..., None]
        height = (centre @ normal - self.ground.offset)[..., None]
        return centre @ axes.T - height * slope, edges @ axes.T - (edges @ normal)[..., None] * slope


def axes_of(ground: Ground) -> Tensor:
    """Return two unit vectors along the ground, at right angles, shape (2, 3), float64: x and y where z is up."""
    normal = torch.tensor(ground.normal, dtype=torch.float64)
    first = torch.eye(3, dtype=torch.float64)[0 if abs(float(normal[0])) < UPRIGHT else 1]
    first = first - (first @ normal) * normal
    first = first / first.norm()
    return torch.stack([first, torch.linalg.cross(normal, first)])


def ground_points(
    camera: PinholeCamera, ground: Ground, shape: tuple[int, int], corner: Tensor | None = None
) -> Tensor:
    """Find the points of the ground that pixels show.

    Args:
        camera: Sees the ground.
        ground: The plane.
        shape: Rows and columns of the part of the view that is compared.
        corner: Column and row of its first pixel, shape (B, 2); None for the whole view.

    Returns:
        Points along `axes_of(ground)` [m], infinite above the horizon, shape (B, rows columns, 2).
    """
    corner = torch.zeros(1, 2) if corner is None else corner
    like = torch.zeros((), dtype=torch.float32, device=corner.device)
    ray = camera.rays(pixel_rows(*shape, like)[:, :2] + corner[:, None].to(like))
    normal, eye = like.new_tensor(ground.normal), like.new_tensor(camera.position)
    descent = -(ray @ normal)
    far = (eye @ normal - ground.offset) / descent
    point = (eye + far[..., None] * ray) @ axes_of(ground).to(like).T
    return torch.where((far > 0)[..., None], point, torch.inf)
