"""Boxes seen by a camera: their visible faces as linear functions of the image coordinates."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from physid.networks.camera import PinholeCamera
from physid.physics.rotations import to_matrix

TANGENTS = ((1, 2), (2, 0), (0, 1))
"""The body axes along which the surface coordinates (s, t) of a face run, whose normal is the body axis 0, 1 or 2."""
NEAR = 1e-3
"""Depth below which a point counts as behind the camera [m]."""


@dataclass(frozen=True)
class Faces:
    """Of each box and body axis, the one face that can be seen; all rows are linear functions r . (u, v, 1).

    Attributes:
        index: Which face, 2 axis + (1 if on the positive side else 0), shape (..., 3).
        facing: Whether it is seen at all, shape (..., 3).
        surface: Rows S, T, W: the pixel (u, v) shows the surface point s = S / W, t = T / W, both in [-1, 1]; the
            homography from the image to the face; shape (..., 3, 3, 3).
        edges: Distances from the edges s = -1, s = 1, t = -1, t = 1 [px], positive inside, shape (..., 3, 4, 3).
        outline: Whether an edge belongs to the outline of the box, shape (..., 3, 4).
    """

    index: Tensor
    facing: Tensor
    surface: Tensor
    edges: Tensor
    outline: Tensor

    def shifted(self, corner: Tensor) -> Faces:
        """Count image coordinates from `corner` (..., 2) [px]."""
        origin = torch.cat([corner, torch.ones_like(corner[..., :1])], -1)[..., None, None, :]
        surface, edges = (
            torch.cat([rows[..., :2], (rows * origin).sum(-1, keepdim=True)], -1) for rows in (self.surface, self.edges)
        )
        return Faces(self.index, self.facing, surface, edges, self.outline)


def corners(pose: Tensor, size: Tensor) -> Tensor:
    """List the eight corners of boxes with poses (..., 7) and sizes (..., 3), world frame [m]; shape (..., 8, 3)."""
    signs = torch.cartesian_prod(*[pose.new_tensor([-0.5, 0.5])] * 3)
    body = signs * size[..., None, :]
    return pose[..., None, :3] + body @ to_matrix(pose[..., 3:]).transpose(-1, -2)


def visible_faces(camera: PinholeCamera, pose: Tensor, size: Tensor) -> Faces:
    """Find the visible faces of boxes and the homographies from the image to them.

    A face with centre c and half edges e, g in camera axes is seen along the ray d where x d = c + s e + t g, hence
    s = d.(g x c) / d.(e x g) and t = d.(c x e) / d.(e x g); W = d.(e x g) has the sign of c.(e x g) in front of it.

    Args:
        camera: The camera.
        pose: Poses of the boxes, shape (..., 7).
        size: Full edge lengths [m], shape (..., 3).

    Returns:
        Three faces of each box.
    """
    centre = camera.to_camera(pose[..., :3])
    axes = (camera.rotation.to(pose) @ to_matrix(pose[..., 3:])).transpose(-1, -2)
    half = axes * size[..., :, None] / 2
    towards = (axes * centre[..., None, :]).sum(-1)
    side = torch.where(towards < 0, 1.0, -1.0).to(pose)
    in_front = camera.to_camera(corners(pose, size))[..., 2].amin(-1, keepdim=True) > NEAR
    facing = (towards.abs() > size / 2) & in_front
    middle = centre[..., None, :] + side[..., None] * half
    first, second = half[..., [j for j, _ in TANGENTS], :], half[..., [k for _, k in TANGENTS], :]
    across = torch.linalg.cross(first, second)
    sign = torch.sign((across * middle).sum(-1))[..., None, None]
    rows = torch.stack([torch.linalg.cross(second, middle), torch.linalg.cross(middle, first), across], -2) * sign
    surface = _in_pixels(rows, camera)
    s, t, w = surface.unbind(-2)
    edges = torch.stack([w + s, w - s, w + t, w - t], -2)
    edges = edges / edges[..., :2].norm(dim=-1, keepdim=True).clamp_min(torch.finfo(pose.dtype).tiny)
    index = 2 * torch.arange(3, device=pose.device) + (side > 0)
    return Faces(index, facing, surface, edges, _outline(side, facing))


def _in_pixels(rows: Tensor, camera: PinholeCamera) -> Tensor:
    """Rewrite functions of the ray (x, y, 1) as functions of (u, v, 1), with x = (u - width / 2) / f and so on."""
    slope = rows[..., :2] / camera.focal_length
    constant = rows[..., 2] - slope[..., 0] * camera.width / 2 - slope[..., 1] * camera.height / 2
    return torch.cat([slope, constant[..., None]], -1)


def _outline(side: Tensor, facing: Tensor) -> Tensor:
    """Return which edges have no visible face beyond them: the neighbour at s = +-1 is the face on that side."""
    edges = []
    for tangents in TANGENTS:
        for axis in tangents:
            edges += [~(facing[..., axis] & (side[..., axis] == towards)) for towards in (-1.0, 1.0)]
    return torch.unflatten(torch.stack(edges, -1), -1, (3, 4))


def coverage(faces: Faces, pixels: Tensor, edge: float = 1.0) -> tuple[Tensor, Tensor]:
    """Measure how much of each pixel a face covers, and the box as a whole, with edges one pixel wide.

    An edge of width w at distance d covers clamp(d / w + 1/2, 0, 1) of a pixel; two opposite edges leave the sum less
    one, so that a face seen edge-on vanishes smoothly. The box covers the least that any edge of its outline leaves.

    Args:
        faces: Visible faces of boxes.
        pixels: Rows (u, v, 1) of the pixel centres, shape (P, 3).
        edge: Width of the edges [px]; near 0 a pixel is covered or not, as in images without anti-aliasing.

    Returns:
        Coverage of the faces, shape (..., 3, P), and of the boxes, shape (..., P).
    """
    inside = torch.unflatten((faces.edges.flatten(-3, -2) @ pixels.T / edge + 0.5).clamp(0, 1), -2, (3, 4))
    strips = (inside[..., 0::2, :] + inside[..., 1::2, :] - 1).clamp_min(0)
    of_face = strips[..., 0, :] * strips[..., 1, :] * faces.facing[..., None]
    bounds = (faces.outline & faces.facing[..., None])[..., None]
    of_box = torch.where(bounds, inside, 1.0).flatten(-3, -2).amin(-2)
    return of_face, of_box * faces.facing.any(-1)[..., None]
