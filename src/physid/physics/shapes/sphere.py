"""A sphere: contacts in one point, with the ground, with spheres and with boxes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import torch
from torch import Tensor

from physid.physics.contact import PATCH, Patch
from physid.physics.rotations import rotate, to_matrix
from physid.physics.shapes.box import Box
from physid.physics.shapes.shape import Finder, Placed, Shape, frame_of

NEAREST = 1e-12
"""Centres closer to a point than this have no direction to it [m]."""


@final
@dataclass(frozen=True)
class Sphere(Shape):
    """A sphere; its three extents are its diameter, of which the first counts."""

    def inertia(self, mass: Tensor, size: Tensor) -> Tensor:
        """Compute 2 m r^2 / 5 about every axis (see `Shape.inertia`)."""
        return (mass * size[..., 0] ** 2 / 10)[..., None].expand(*mass.shape, 3)

    def reach(self, quaternion: Tensor, size: Tensor, normal: Tensor) -> Tensor:
        """Return the radius (see `Shape.reach`)."""
        return size[..., 0] / 2

    def on_plane(self, body: Placed, normal: Tensor, offset: Tensor) -> Patch:
        """Find the lowest point, n . p - offset - r away from the ground (see `Shape.on_plane`)."""
        centre, radius = body.pose[:, :3], body.size[:, 0] / 2
        gap = centre @ normal - offset - radius
        return _patch((None, body.body), centre - radius[:, None] * normal, gap, normal.expand_as(centre), 2 * radius)

    def meets(self, other: Shape) -> Finder | None:
        """Return the contacts with spheres and with boxes (see `Shape.meets`)."""
        finders: dict[type[Shape], Finder] = {Sphere: _on_sphere, Box: _on_box}
        return finders.get(type(other))


def _on_sphere(first: Placed, second: Placed) -> Patch:
    """Find the contact of two spheres on the line between their centres."""
    between = second.pose[:, :3] - first.pose[:, :3]
    distance = between.square().sum(1).clamp_min(NEAREST**2).sqrt()
    gap = distance - first.size[:, 0] / 2 - second.size[:, 0] / 2
    normal = between / distance[:, None]
    point = first.pose[:, :3] + (first.size[:, 0] / 2 + gap / 2)[:, None] * normal
    return _patch((first.body, second.body), point, gap, normal, torch.minimum(first.size[:, 0], second.size[:, 0]))


def _on_box(ball: Placed, box: Placed) -> Patch:
    """Find the contact of a sphere with the point of a box that is closest to its centre.

    A centre inside the box is pushed out through the nearest face.
    """
    axes, half = to_matrix(box.pose[:, 3:]), box.size / 2
    centre = ((ball.pose[:, :3] - box.pose[:, :3])[:, None] @ axes)[:, 0]
    nearest = torch.maximum(torch.minimum(centre, half), -half)
    away = centre - nearest
    distance = away.square().sum(1).clamp_min(NEAREST**2).sqrt()
    depth = half - centre.abs()
    face = torch.zeros_like(centre).scatter(1, depth.detach().argmin(1, keepdim=True), 1.0)
    outwards = face * torch.where(centre < 0, -1.0, 1.0).to(centre.dtype)
    inside = (distance <= NEAREST)[:, None]
    normal = torch.where(inside, outwards, away / distance[:, None])
    on_box = torch.where(inside, centre + depth.amin(1, keepdim=True) * outwards, nearest)
    gap = torch.where(inside[:, 0], -depth.amin(1), distance) - ball.size[:, 0] / 2
    normal, point = rotate(box.pose[:, 3:], normal), box.pose[:, :3] + rotate(box.pose[:, 3:], on_box)
    return _patch((ball.body, box.body), point, gap, -normal, ball.size[:, 0])


def _patch(bodies: tuple[int | None, int], point: Tensor, gap: Tensor, normal: Tensor, scale: Tensor) -> Patch:
    """Return a patch of one contact, the first of its four: point (B, 3), gap (B,), normal (B, 3), scale (B,)."""
    points, gaps = point[:, None].expand(-1, PATCH, 3), gap[:, None].expand(-1, PATCH)
    active = (torch.arange(PATCH, device=gap.device) == 0).expand(gaps.shape)
    return Patch(*bodies, points, gaps, frame_of(normal), active, scale, rolling=True)
