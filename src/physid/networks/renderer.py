"""A spatial transformer without weights: draws boxes with known appearance at given poses."""

from __future__ import annotations

from typing import final

import torch
from torch import Tensor, nn
from torch.nn import functional

from physid.networks.appearance import Appearance, pixel_rows
from physid.networks.camera import PinholeCamera
from physid.networks.faces import NEAR, Faces, corners, coverage, visible_faces
from physid.physics import check_shape

MARGIN = 2
"""Pixels kept around a box when only its surroundings are drawn."""
STEP = 8
"""Windows grow in steps of so many pixels."""
LEAST_WEIGHT = 1e-4
"""Weight of a visible face where none covers the pixel, so that colours stay defined on the outline."""


@final
class BoxRenderer(nn.Module):
    """Draws the visible faces of boxes by homographies, on a known background, seen by a known pinhole camera.

    Edges are one pixel wide, so that the image is a continuous function of the poses and its gradient the right one.
    Boxes farther from the camera are drawn first. Only a window around each box is worked on.

    Args:
        camera: The camera.
        size: Full edge lengths of the boxes [m], shape (N, 3).
    """

    size: Tensor

    def __init__(self, camera: PinholeCamera, size: Tensor) -> None:
        super().__init__()
        check_shape("size", size, (None, 3))
        self.camera = camera
        self.register_buffer("size", size.float(), persistent=False)

    def forward(
        self, pose: Tensor, appearance: Appearance, background: Tensor, edge: float = 1.0, corner: Tensor | None = None
    ) -> Tensor:
        """Draw T frames of each of B scenes.

        Args:
            pose: Poses, shape (B, T, N, 7).
            appearance: What the boxes look like in each scene, or in all; its type is that of the result.
            background: The empty scenes in [0, 1], shape (B, 3, H, W).
            edge: Width of edges [px]; the gradient needs 1, images without anti-aliasing have about 0.
            corner: Where the backgrounds are only parts of the view: the column and row of the pixel of the view that
                is the first of each, shape (B, 2). What is drawn is the same part of the whole image.

        Returns:
            Images in [0, 1], shape (B, T, 3, H, W), as large as the backgrounds.

        Raises:
            ValueError: If a shape is off, a pose is not finite, or a part leaves the view.
        """
        batch = len(background)
        check_shape("pose", pose, (batch, None, len(self.size), 7))
        if corner is None:
            check_shape("background", background, (None, 3, self.camera.height, self.camera.width))
            corner = torch.zeros(batch, 2, dtype=torch.long, device=pose.device)
        else:
            check_shape("background", background, (None, 3, None, None))
            check_shape("corner", corner, (batch, 2))
            beyond = corner + corner.new_tensor([background.shape[-1], background.shape[-2]])
            if bool((corner < 0).any() or (beyond > corner.new_tensor([self.camera.width, self.camera.height])).any()):
                raise ValueError(
                    f"corner: expected parts within the view of {self.camera.width} x {self.camera.height} pixels, got "
                    f"parts of {background.shape[-1]} x {background.shape[-2]} at {corner.tolist()}"
                )
        with torch.autocast(pose.device.type, enabled=False):
            return self._draw(pose.to(appearance.patches), appearance, background, edge, corner)

    def _draw(self, pose: Tensor, appearance: Appearance, background: Tensor, edge: float, part: Tensor) -> Tensor:
        corner, side = self._windows(pose, part[:, None, None], (background.shape[-1], background.shape[-2]))
        faces = visible_faces(self.camera, pose, self.size.to(pose)).shifted(corner.to(pose))
        rows = pixel_rows(side[1], side[0], pose)
        of_face, alpha = coverage(faces, rows, edge)
        colour = _paint(faces, of_face, rows, appearance)
        window = rows[:, :2].long() + (corner - part[:, None, None])[..., None, :]
        index = window[..., 1] * background.shape[-1] + window[..., 0]
        canvas = background.to(pose)[:, None].expand(-1, pose.shape[1], -1, -1, -1).flatten(-2)
        image = _overlay(canvas, colour, alpha, index, self._far_to_near(pose))
        return torch.unflatten(image, -1, background.shape[-2:])

    def silhouettes(self, pose: Tensor) -> Tensor:
        """Measure how much of each pixel each box would cover alone; pose (..., N, 7), result (..., N, H, W)."""
        with torch.autocast(pose.device.type, enabled=False):
            faces = visible_faces(self.camera, pose, self.size.to(pose))
            _, alpha = coverage(faces, pixel_rows(self.camera.height, self.camera.width, pose))
        return torch.unflatten(alpha, -1, (self.camera.height, self.camera.width))

    def _far_to_near(self, pose: Tensor) -> Tensor:
        """Order the boxes by the distance of their centres from the camera, the farthest first; shape (B, T, N)."""
        away = pose[..., :3] - pose.new_tensor(self.camera.position)
        return away.square().sum(-1).argsort(-1, descending=True)

    @torch.no_grad()
    def _windows(self, pose: Tensor, first: Tensor, shown: tuple[int, int]) -> tuple[Tensor, tuple[int, int]]:
        """Find the upper left corners (B, T, N, 2) [px] and the common size of windows that hold every box.

        They lie in the part of the view of `shown` columns and rows that begins at `first`.
        """
        view = pose.new_tensor([self.camera.width, self.camera.height])
        first = first.to(pose)
        last = first + pose.new_tensor(shown)
        points = corners(pose, self.size.to(pose))
        behind = (self.camera.to_camera(points)[..., 2:] < NEAR).any(-2, keepdim=True)
        image = self.camera.project(points).where(~behind, view / 2).clamp(-view, 2 * view)
        low, high = image.amin(-2) - MARGIN, image.amax(-2) + MARGIN
        inside = (high > first) & (low < last)
        extent = torch.where(inside.all(-1, keepdim=True), high - low, 0.0).flatten(0, -2).amax(0).tolist()
        width, height = (min(full, STEP * (int(e) // STEP + 1)) for e, full in zip(extent, shown, strict=True))
        size = view.new_tensor([width, height])
        corner = torch.minimum(torch.maximum(((low + high - size) / 2).round(), first), last - size)
        return corner.long(), (width, height)


def _paint(faces: Faces, of_face: Tensor, rows: Tensor, appearance: Appearance) -> Tensor:
    """Look up the colour of each box in its window, faces mixed by their coverage; shape (B, T, N, 3, P)."""
    texels = appearance.patches.shape[-1]
    s, t, w = torch.unflatten(faces.surface.flatten(-3, -2) @ rows.T, -2, (3, 3)).unbind(-2)
    s, t = (_ratio(x, w, of_face > 0, 1 - 1 / texels) for x in (s, t))
    tile = faces.index[..., None]
    grid = torch.stack([(2 * (tile // 2) + 1 + s) / 3 - 1, (2 * (tile % 2) + 1 + t) / 2 - 1], -1)
    # (B, T, N, 3, P, 2): the frames and faces of one body of one scene share an atlas.
    batch, frames, bodies, faced, pixels, _ = grid.shape
    grid = grid.transpose(1, 2).reshape(batch * bodies, frames * faced, pixels, 2)
    atlas = appearance.atlas.expand(batch, -1, -1, -1, -1).flatten(0, 1)
    colour = functional.grid_sample(atlas, grid, padding_mode="border", align_corners=False)
    colour = colour.view(batch, bodies, 3, frames, faced, pixels).permute(0, 3, 1, 2, 4, 5)
    weight = of_face + LEAST_WEIGHT * faces.facing[..., None]
    share = weight / weight.sum(-2, keepdim=True).clamp_min(LEAST_WEIGHT)
    return (colour * share[..., None, :, :]).sum(-2)


def _ratio(x: Tensor, w: Tensor, wanted: Tensor, most: float) -> Tensor:
    """Return x / w where it is wanted, at most `most` in size, and 0 elsewhere.

    On the horizon of a face that is seen edge-on w is 0. Where the limit holds nothing is divided, so that the gradient
    is finite there: 0 times an infinite slope would not be.
    """
    limited = most * torch.sign(x) * torch.where(w < 0, -1.0, 1.0)
    within = wanted & (x.abs() < most * w.abs())
    return torch.where(within, x / torch.where(within, w, 1.0), torch.where(wanted, limited, 0.0))


def _overlay(canvas: Tensor, colour: Tensor, alpha: Tensor, index: Tensor, order: Tensor) -> Tensor:
    """Lay the boxes' windows onto canvases (B, T, 3, H W), one box of every scene at a time."""
    for body in order.unbind(-1):
        pick = body[..., None, None]
        at = index.take_along_dim(pick, 2).squeeze(2)[..., None, :].expand(-1, -1, 3, -1)
        cover = alpha.take_along_dim(pick, 2)
        paint = colour.take_along_dim(pick[..., None], 2).squeeze(2)
        below = canvas.gather(-1, at)
        canvas = canvas.scatter(-1, at, below + cover * (paint - below))
    return canvas
