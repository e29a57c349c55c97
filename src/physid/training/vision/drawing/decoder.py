"""The decoder of the paper: poses in, frames out, by a renderer that knows what the bodies look like."""

from __future__ import annotations

import dataclasses
from typing import final

import torch
from torch import Tensor, nn

from physid.networks import PinholeCamera
from physid.networks.appearance import Appearance, cut_appearance
from physid.networks.renderer import BoxRenderer
from physid.scenes import Scene
from physid.training.vision.drawing.cast_shadow import CastShadow

TEXELS = 32


def camera_of(scene: Scene) -> PinholeCamera:
    """Return the camera of a scene.

    Raises:
        ValueError: If it has none.
    """
    if scene.camera is None:
        raise ValueError(f"scene {scene.name} has no camera; learning from video needs one (recording.yaml: camera)")
    return PinholeCamera(**dataclasses.asdict(scene.camera))


@final
class Decoder(nn.Module):
    """Draws the bodies of a scene at given poses, on the known background.

    Args:
        scene: Gives the camera and the sizes of the bodies.

    Attributes:
        patches: What the faces look like (see `Appearance`), shape (1, N, 6, 3, P, P); not finite until `cut` was
            called. They are part of a checkpoint, so that a trained model predicts recordings without masks.
        shadow: What the bodies cast on the ground; None draws none.

    Raises:
        ValueError: If the scene has no camera.
    """

    patches: Tensor

    def __init__(self, scene: Scene) -> None:
        super().__init__()
        self.renderer = BoxRenderer(camera_of(scene), torch.from_numpy(scene.sizes))
        unknown = torch.full((1, len(scene.bodies), 6, 3, TEXELS, TEXELS), torch.nan)
        self.register_buffer("patches", unknown)
        self.shadow: CastShadow | None = None

    def cut(self, frame: Tensor, mask: Tensor, pose: Tensor) -> None:
        """Take the look of the bodies from first frames (M, 3, H, W), masks (M, N, H, W) and poses (M, N, 7).

        Raises:
            ValueError: If a mask does not lie where the pose says.
        """
        camera, size = self.renderer.camera, self.renderer.size.cpu()
        self.patches = cut_appearance(camera, frame, mask, pose, size, texels=TEXELS, shared=True).patches.to(
            self.patches
        )

    def forward(self, pose: Tensor, background: Tensor, edge: float = 1.0, corner: Tensor | None = None) -> Tensor:
        """Draw frames.

        Args:
            pose: Poses, shape (B, f, N, 7).
            background: The empty scenes in [0, 1], shape (B, 3, H, W).
            edge: Width of edges [px].
            corner: Where the backgrounds show only parts of the view (see `BoxRenderer`), shape (B, 2).

        Returns:
            Images in [0, 1], shape (B, f, 3, H, W).
        """
        if self.shadow is None:
            image: Tensor = self.renderer(pose, Appearance(self.patches), background, edge, corner)
            return image
        corner = background.new_zeros(len(background), 2, dtype=torch.long) if corner is None else corner
        # Each frame has a background of its own.
        frames, shape = pose.shape[1], (background.shape[-2], background.shape[-1])
        light = self.shadow.light(self.renderer.camera, pose.to(background), self.renderer.size, shape, corner)
        behind = (background[:, None] * light[:, :, None]).flatten(0, 1)
        corner = corner.repeat_interleave(frames, 0)
        image = self.renderer(pose.flatten(0, 1)[:, None], Appearance(self.patches), behind, edge, corner)
        return image.view(*pose.shape[:2], *image.shape[2:])
