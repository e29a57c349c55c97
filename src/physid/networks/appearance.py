"""What the bodies look like: one content patch per face, cut from the first frame."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from physid.networks.camera import PinholeCamera
from physid.networks.faces import TANGENTS, coverage, visible_faces
from physid.physics import check_shape
from physid.physics.rotations import rotate

FEWEST_PIXELS = 6.0
"""A face that covers fewer pixels than this in the first frame gets one colour instead of a patch."""
FAINTEST = 0.05
"""Weight of a texel below which it fades into the mean colour of its face."""
LEAST_OVERLAP = 0.5
WRONG_PLACE = (
    "does not lie where camera, size and initial pose put the body: does the background show the body, too (import "
    "with background=FILE, an image of the empty scene), or are size or camera not in metres?"
)
"""Smallest share of a mask and its predicted outline that must coincide (intersection over union)."""


@dataclass(frozen=True)
class Appearance:
    """Content patches of the faces of N boxes.

    Attributes:
        patches: Colours in [0, 1], faces in the order -x, +x, -y, +y, -z, +z; rows along the second, columns along
            the first surface coordinate of `faces.TANGENTS`; shape (B, N, 6, 3, P, P).
    """

    patches: Tensor

    def __post_init__(self) -> None:
        check_shape("patches", self.patches, (None, None, 6, 3, None, self.patches.shape[-2]))

    @property
    def atlas(self) -> Tensor:
        """All faces of a body in one image, axes side by side, negative above positive; shape (B, N, 3, 2 P, 3 P)."""
        batch, bodies, _, colours, texels, _ = self.patches.shape
        tiles = torch.unflatten(self.patches, 2, (3, 2)).permute(0, 1, 4, 3, 5, 2, 6)
        return tiles.reshape(batch, bodies, colours, 2 * texels, 3 * texels)


def cut_appearance(
    camera: PinholeCamera,
    frame: Tensor,
    mask: Tensor,
    pose: Tensor,
    size: Tensor,
    *,
    texels: int = 32,
    shared: bool = False,
) -> Appearance:
    """Cut the content patches of all bodies out of the first frames, at their known initial poses.

    A patch is the frame at the image points of the face, averaged over those neighbours alone that lie within the
    mask and well within the face. Texels that are not seen take the mean colour of their face; a face that is not
    seen that of the seen sides (all but the face most turned to the camera), or of the whole body.

    Args:
        camera: The camera.
        frame: First frames in [0, 1], shape (B, 3, H, W).
        mask: Which pixels show which body, shape (B, N, H, W).
        pose: Poses in the first frames, shape (B, N, 7).
        size: Full edge lengths [m], shape (N, 3).
        texels: Length of a patch's sides P.
        shared: Whether all frames show the same bodies: their patches are then averaged, and a face seen in one of
            them is known in all.

    Returns:
        The patches; with a batch axis of length 1 if shared.

    Raises:
        ValueError: If a mask is empty, or does not lie where the pose and the camera say; it names the body.
    """
    check_shape("frame", frame, (None, 3, camera.height, camera.width))
    check_shape("mask", mask, (len(frame), None, camera.height, camera.width))
    check_shape("pose", pose, (len(frame), mask.shape[1], 7))
    check_shape("size", size, (mask.shape[1], 3))
    pose, size, mask = pose.to(frame), size.to(frame), mask.to(frame)
    weight = _owned_pixels(camera, mask, pose, size)
    area = weight.sum((-2, -1))
    weighted, weight = _sample(camera, frame, weight, pose, size, texels)
    if shared:
        share = (area / area.sum(0).clamp_min(1))[..., None, None, None]
        weighted, weight = (share * weighted).sum(0, keepdim=True), (share * weight).sum(0, keepdim=True)
        area = area.sum(0, keepdim=True)
    return Appearance(_fill(weighted, weight, area))


def _owned_pixels(camera: PinholeCamera, mask: Tensor, pose: Tensor, size: Tensor) -> Tensor:
    """Weigh the pixels that show a face and nothing else, from 0 on its edges to 1 inside; shape (B, N, 6, H, W)."""
    faces = visible_faces(camera, pose, size)
    of_face, of_box = coverage(faces, pixel_rows(camera.height, camera.width, pose))
    _check_overlap(mask, of_box.view_as(mask))
    owned = (4 * of_face - 3).clamp(0, 1).view(*of_face.shape[:3], *mask.shape[-2:]) * mask[:, :, None]
    weight = owned.new_zeros(*mask.shape[:2], 6, *mask.shape[-2:])
    return weight.scatter(2, faces.index[..., None, None].expand_as(owned), owned)


def pixel_rows(height: int, width: int, like: Tensor) -> Tensor:
    """List (u, v, 1) of all pixel centres [px], row by row; shape (height width, 3)."""
    v, u = torch.meshgrid(torch.arange(height) + 0.5, torch.arange(width) + 0.5, indexing="ij")
    return torch.stack([u, v, torch.ones_like(u)], -1).flatten(0, 1).to(like)


def _check_overlap(mask: Tensor, outline: Tensor) -> None:
    area = mask.sum((-2, -1))
    overlap = torch.minimum(mask, outline).sum((-2, -1)) / torch.maximum(mask, outline).sum((-2, -1)).clamp_min(1)
    for wrong, complaint in (
        (area == 0, "is empty: the body is out of view; draw the recording again, or leave it out"),
        (overlap < LEAST_OVERLAP, WRONG_PLACE),
    ):
        if wrong.any():
            sample, body = wrong.nonzero()[0].tolist()
            raise ValueError(f"mask of body {body} in sample {sample} of the batch {complaint}")


def _face_points(size: Tensor, texels: int) -> Tensor:
    """List the texel centres of all faces in body axes [m]; shape (N, 6, P P, 3)."""
    along = (torch.arange(texels).to(size) + 0.5) * 2 / texels - 1
    t, s = torch.meshgrid(along, along, indexing="ij")
    points = size.new_zeros(6, texels, texels, 3)
    for axis, (first, second) in enumerate(TANGENTS):
        for side in (0, 1):
            face = points[2 * axis + side]
            face[..., axis], face[..., first], face[..., second] = 2 * side - 1, s, t
    return points.flatten(1, 2) * size[:, None, None, :] / 2


def _sample(
    camera: PinholeCamera, frame: Tensor, weight: Tensor, pose: Tensor, size: Tensor, texels: int
) -> tuple[Tensor, Tensor]:
    """Look up weighted colours (B, N, 6, 3, P, P) and weights (B, N, 6, 1, P, P) at the texel centres."""
    points = rotate(pose[..., None, None, 3:], _face_points(size, texels)[None]) + pose[..., None, None, :3]
    image_size = frame.new_tensor([camera.width, camera.height])
    grid = (2 * camera.project(points) / image_size - 1).view(-1, texels, texels, 2)
    weighted = torch.cat([frame[:, None, None] * weight[..., None, :, :], weight[..., None, :, :]], 3)
    sampled = functional.grid_sample(weighted.flatten(0, 2), grid, align_corners=False)
    sampled = sampled.view(*weight.shape[:3], 4, texels, texels)
    return sampled[..., :3, :, :], sampled[..., 3:, :, :]


def _fill(weighted: Tensor, weight: Tensor, area: Tensor) -> Tensor:
    """Divide colours by weights, and take mean colours where nothing was seen; shape (B, N, 6, 3, P, P)."""
    tiny = torch.finfo(weight.dtype).eps
    total, count = weighted.mean((-2, -1)), weight.mean((-2, -1))
    mean = total / count.clamp_min(tiny)
    seen = (area >= FEWEST_PIXELS)[..., None].to(weight)
    share = area[..., None] * seen
    sides = share * (area < area.amax(-1, keepdim=True))[..., None]
    body = (share * mean).sum(-2) / share.sum(-2).clamp_min(tiny)
    of_sides = (sides * mean).sum(-2) / sides.sum(-2).clamp_min(tiny)
    unseen = torch.where(sides.sum(-2) > 0, of_sides, body)[..., None, :]
    mean = torch.where(seen > 0, mean, unseen)[..., None, None]
    kept = weight * seen[..., None, None]
    blend = (kept / FAINTEST).clamp(0, 1)
    return blend * weighted / weight.clamp_min(tiny) + (1 - blend) * mean
