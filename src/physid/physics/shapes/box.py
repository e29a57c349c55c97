"""A box, and where boxes touch the ground and each other."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import final

import torch
from torch import Tensor

from physid.physics.contact import PATCH, Patch
from physid.physics.rotations import to_matrix
from physid.physics.shapes.shape import DISTINCT, FIRST, Finder, Placed, Shape, frame_of

_SIGNS = ((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0))
_OUTSIDE = 1e6


@final
@dataclass(frozen=True)
class Box(Shape):
    """A box; its extents are its edge lengths."""

    def inertia(self, mass: Tensor, size: Tensor) -> Tensor:
        """Compute I_x = m (b^2 + c^2) / 12 and so on (see `Shape.inertia`)."""
        square = size**2
        return mass[..., None] * (square.sum(-1, keepdim=True) - square) / 12

    def reach(self, quaternion: Tensor, size: Tensor, normal: Tensor) -> Tensor:
        """Compute sum_i |n . a_i| s_i / 2 with the axes a_i (see `Shape.reach`)."""
        half: Tensor = ((normal @ to_matrix(quaternion)).abs() * size).sum(-1) / 2
        return half

    def on_plane(self, body: Placed, normal: Tensor, offset: Tensor) -> Patch:
        """Find the four lowest corners (see `Shape.on_plane`)."""
        pose, size = body.pose, body.size
        arms = corner_signs(pose) * size[:, None] / 2
        corners = pose[:, None, :3] + arms @ to_matrix(pose[:, 3:]).mT
        height = corners @ normal - offset
        lowest = height.detach().topk(PATCH, dim=1, largest=False).indices
        gap = height.gather(1, lowest)
        point = corners.gather(1, lowest[..., None].expand(-1, -1, 3))
        frame = frame_of(normal).expand(pose.shape[0], 3, 3)
        return Patch(None, body.body, point, gap, frame, torch.ones_like(gap, dtype=torch.bool), size.max(1).values)

    def meets(self, other: Shape) -> Finder | None:
        """Return the contacts with boxes (see `Shape.meets`)."""
        return box_on_box if isinstance(other, Box) else None


def corner_signs(reference: Tensor) -> Tensor:
    """Return the signs of the 8 corners of a box, shape (8, 3)."""
    ones = reference.new_tensor([-1.0, 1.0])
    return torch.cartesian_prod(ones, ones, ones)


def box_on_box(first: Placed, second: Placed) -> Patch:
    """Find up to four contacts between two boxes, by face or by edge.

    The separating axis theorem (Gottschalk et al. 1996) over 3 + 3 face normals and 9 edge crosses picks the axis of
    least overlap. A face contact clips the other box's opposite face against it and keeps four points that span the
    touching area; an edge contact is the one pair of closest points.
    """
    pose, size = (first.pose, second.pose), (first.size, second.size)
    half = size[0] / 2, size[1] / 2
    axes = to_matrix(pose[0][:, 3:]).mT, to_matrix(pose[1][:, 3:]).mT
    between = pose[1][:, :3] - pose[0][:, :3]
    choice = _least_overlap(axes, half, between)
    first_face = _face_contacts(pose[0][:, :3], axes[0], half[0], pose[1][:, :3], axes[1], half[1], choice)
    second_face = _face_contacts(pose[1][:, :3], axes[1], half[1], pose[0][:, :3], axes[0], half[0], choice - 3)
    edge = _edge_contact(pose, axes, half, between, choice - 6)
    by_second, by_edge = ((choice >= 3) & (choice < 6)), choice >= 6
    point, gap, normal, active = (
        torch.where(_like(by_edge, e), e, torch.where(_like(by_second, s), s, f))
        for f, s, e in zip(
            first_face, (second_face[0], second_face[1], -second_face[2], second_face[3]), edge, strict=True
        )
    )
    scale = torch.minimum(size[0].amin(1), size[1].amin(1))
    return Patch(first.body, second.body, point, gap, frame_of(normal), active, scale)


def _like(mask: Tensor, value: Tensor) -> Tensor:
    return mask.reshape(-1, *[1] * (value.ndim - 1))


def _least_overlap(axes: tuple[Tensor, Tensor], half: tuple[Tensor, Tensor], between: Tensor) -> Tensor:
    """Return which axis has the largest separation: 0-2 first box, 3-5 second box, 6-14 edge pairs; shape (B,)."""
    with torch.no_grad():
        crosses = torch.linalg.cross(axes[0][:, :, None], axes[1][:, None, :]).flatten(1, 2)
        length = crosses.norm(dim=-1, keepdim=True)
        directions = torch.cat([axes[0], axes[1], crosses / length.clamp_min(1e-12)], 1)
        reach = sum((directions @ a.mT).abs() @ h[..., None] for a, h in zip(axes, half, strict=True))
        separation = (directions @ between[..., None]).abs()[..., 0] - reach[..., 0]  # type: ignore[index]
        # Edges win only if clearly better: a face contact has four points and does not flicker. So with the two faces.
        margin = 1e-2 * torch.minimum(half[0].amin(1), half[1].amin(1))[:, None]
        parallel = length[..., 0] < 1e-3
        bias = torch.cat([0 * margin.expand(-1, 3), margin.expand(-1, 3) * 1e-3, margin.expand(-1, 9)], 1)
        blocked = torch.cat([torch.zeros_like(parallel[:, :6]), parallel], 1)
        return torch.where(blocked, -_OUTSIDE, separation - bias).argmax(1)


def _face_contacts(
    centre: Tensor, axes: Tensor, half: Tensor, other: Tensor, other_axes: Tensor, other_half: Tensor, axis: Tensor
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Clip the opposite face of the other box against the face of this box across `axis` (0, 1 or 2)."""
    axis = axis.clamp(0, 2)
    order = torch.stack([axis, (axis + 1) % 3, (axis + 2) % 3], 1)
    frame = axes.gather(1, order[..., None].expand(-1, -1, 3))
    reach = half.gather(1, order)
    side = torch.where((frame[:, 0] * (other - centre)).sum(1) < 0, -1.0, 1.0).to(centre.dtype)
    frame = torch.cat([frame[:, :1] * side[:, None, None], frame[:, 1:]], 1)

    relative = other_axes @ frame.mT
    facing = relative[:, :, 0].detach().abs().argmax(1)
    turned = torch.stack([facing, (facing + 1) % 3, (facing + 2) % 3], 1)
    relative = relative.gather(1, turned[..., None].expand(-1, -1, 3))
    extent = other_half.gather(1, turned)
    away = torch.where(relative[:, 0, 0] > 0, -1.0, 1.0).to(centre.dtype)
    middle = ((other - centre)[:, None] @ frame.mT)[:, 0] + relative[:, 0] * (away * extent[:, 0])[:, None]
    spans = relative[:, 1:] * extent[:, 1:, None]
    candidates, valid = _clip(middle, spans, reach[:, 1:])
    chosen, active = _spread(candidates, valid, reach)
    gap = chosen[..., 0] - reach[:, :1]
    on_face = torch.cat([chosen[..., :1] - gap[..., None] / 2, chosen[..., 1:]], -1)
    return centre[:, None] + on_face @ frame, gap, frame[:, 0], active


def _clip(middle: Tensor, spans: Tensor, reach: Tensor) -> tuple[Tensor, Tensor]:
    """Return the 24 candidate corners of (a parallelogram) intersected with (a rectangle), and which are real.

    Args:
        middle: Centre of the parallelogram (height, x, y), shape (B, 3).
        spans: Its half edges, shape (B, 2, 3).
        reach: Half edges of the rectangle in x and y, shape (B, 2).
    """
    signs = middle.new_tensor(_SIGNS)
    corners = middle[:, None] + signs @ spans
    slack = 1e-9 + 1e-6 * reach[:, None]
    inside = (corners[..., 1:].abs() <= reach[:, None] + slack).all(-1)

    matrix = spans[:, :, 1:].mT
    determinant = matrix[:, 0, 0] * matrix[:, 1, 1] - matrix[:, 0, 1] * matrix[:, 1, 0]
    flat = determinant.abs() < 1e-9 * reach.prod(1)
    safe = torch.where(flat, torch.ones_like(determinant), determinant)[:, None]
    rectangle = signs * reach[:, None]
    away = rectangle - middle[:, None, 1:]
    u = (away[..., 0] * matrix[:, None, 1, 1] - away[..., 1] * matrix[:, None, 0, 1]) / safe
    v = (away[..., 1] * matrix[:, None, 0, 0] - away[..., 0] * matrix[:, None, 1, 0]) / safe
    height = middle[:, None, 0] + u * spans[:, None, 0, 0] + v * spans[:, None, 1, 0]
    lifted = torch.cat([height[..., None], rectangle], -1)
    covered = (u.abs() <= 1 + 1e-6) & (v.abs() <= 1 + 1e-6) & ~flat[:, None]

    start, step = corners, corners.roll(-1, 1) - corners
    crossings, real = [], []
    for k in (0, 1):
        bound = reach[:, k, None] * middle.new_tensor([-1.0, 1.0])
        along = step[:, :, None, 1 + k]
        level = along.abs() < 1e-12
        t = (bound[:, None] - start[:, :, None, 1 + k]) / torch.where(level, torch.ones_like(along), along)
        hit = start[:, :, None] + t[..., None] * step[:, :, None]
        within = (hit[..., 2 - k].abs() <= reach[:, None, None, 1 - k] + slack[..., None, 1 - k]) & ~level
        crossings.append(hit.flatten(1, 2))
        real.append((within & (t >= 0) & (t <= 1)).flatten(1))
    return torch.cat([corners, lifted, *crossings], 1), torch.cat([inside, covered, *real], 1)


def _spread(points: Tensor, valid: Tensor, reach: Tensor) -> tuple[Tensor, Tensor]:
    """Choose four of the candidates that span the touching area.

    Each is the furthest towards a corner of the face, the lower the better. Boxes turned by some 45 degrees may have
    the same one furthest towards two corners; then the second is the candidate that is furthest from those before it.
    """
    with torch.no_grad():
        flat, low = points[..., 1:] / reach[:, None, 1:], -4 * points[..., 0] / reach.amax(1, keepdim=True)
        score = flat @ points.new_tensor(_SIGNS).T + low[..., None]
        chosen: list[Tensor] = []
        real: list[Tensor] = []
        apart, later = torch.full_like(low, math.inf), FIRST * torch.arange(low.shape[1]).to(low)
        for towards in score.unbind(-1):
            furthest = torch.where(valid, towards, -_OUTSIDE).argmax(1, keepdim=True)
            other = torch.where(valid, apart - later, -_OUTSIDE).argmax(1, keepdim=True)
            repeated = _repeated(points, furthest, chosen, reach)
            index = torch.where(repeated, other, furthest)
            chosen.append(index)
            real.append(valid.gather(1, index) & (~repeated | (apart.gather(1, index) > DISTINCT)))
            away = (flat - flat.gather(1, index[..., None].expand(-1, -1, 2))).abs().sum(-1)
            apart = torch.minimum(apart, away + low - low.gather(1, index))
        best = torch.cat(chosen, 1)
    return points.gather(1, best[..., None].expand(-1, -1, 3)), torch.cat(real, 1)


def _repeated(points: Tensor, index: Tensor, chosen: list[Tensor], reach: Tensor) -> Tensor:
    """Return whether a candidate lies where one of those chosen before it does, shape (B, 1)."""
    before = points.gather(1, torch.cat([index, *chosen], 1)[..., None].expand(-1, -1, 3))
    return ((before[:, :1] - before[:, 1:]).abs().amax(-1) < 1e-6 * reach.amax(1, keepdim=True)).any(1, keepdim=True)


def _edge_contact(
    pose: tuple[Tensor, Tensor], axes: tuple[Tensor, Tensor], half: tuple[Tensor, Tensor], between: Tensor, pair: Tensor
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Find the closest points of an edge of the first and an edge of the second box; `pair` is 3 i + j."""
    pair = pair.clamp(0, 8)
    rows = torch.arange(pair.shape[0], device=pair.device)
    along = axes[0][rows, pair // 3], axes[1][rows, pair % 3]
    cross = torch.linalg.cross(*along)
    square = cross.square().sum(1, keepdim=True)
    usable = square > 1e-12
    normal = cross / torch.where(usable, square, torch.ones_like(square)).sqrt()
    normal = normal * torch.where((normal * between).sum(1, keepdim=True) < 0, -1.0, 1.0).to(normal.dtype)
    ends = []
    for body, sign in ((0, 1.0), (1, -1.0)):
        facing = (axes[body] @ (sign * normal)[..., None])[..., 0]
        reach = torch.where(facing > 0, 1.0, -1.0).to(normal.dtype) * half[body]
        reach = reach.scatter(1, (pair // 3 if body == 0 else pair % 3)[:, None], 0.0)
        ends.append(pose[body][:, :3] + (reach[:, None] @ axes[body])[:, 0])
    away = ends[1] - ends[0]
    gap = (away * normal).sum(1)
    t = (torch.linalg.cross(away, along[1]) * cross).sum(1) / torch.where(usable, square, torch.ones_like(square))[:, 0]
    point = ends[0] + t[:, None] * along[0] + gap[:, None] * normal / 2
    only = torch.zeros_like(pair)[:, None].expand(-1, PATCH) == torch.arange(PATCH, device=pair.device)
    return point[:, None].expand(-1, PATCH, 3), gap[:, None].expand(-1, PATCH), normal, only & usable
