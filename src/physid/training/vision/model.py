"""Everything between frames and predicted frames: encoder, initial state, physics, decoder."""

from __future__ import annotations

import copy
import dataclasses
from typing import final

import torch
from torch import Tensor, nn

from physid.networks import Encoding
from physid.physics import Parameters, PhysicsLayer, Rollout, State
from physid.scenes import Scene
from physid.training.parameters import PhysicalParameters
from physid.training.vision.calibration import Calibration
from physid.training.vision.deep_supervision import DeepSupervision
from physid.training.vision.drawing.decoder import Decoder
from physid.training.vision.reading import EncoderFactory, Vision, chart_of

AT_ONCE = 256
"""Images that are encoded at once where no gradient needs them together."""


@final
class VideoModel(nn.Module):
    """Encodes frames into poses, rolls them out under known wrenches, and draws poses.

    Args:
        scene: The scene as far as it is known.
        physical: The physical parameters.
        layer: The physics.
        encoder: Builds the encoder.
        vision: How frames are read.
    """

    def __init__(
        self,
        scene: Scene,
        physical: PhysicalParameters,
        layer: PhysicsLayer,
        encoder: EncoderFactory,
        vision: Vision,
    ) -> None:
        super().__init__()
        if layer.distorts:
            raise ValueError(
                "expected no effects of perception, for images are drawn as the camera is believed to see; read the "
                "poses from the films (physid track), and fit these with SysID"
            )
        self.physical, self.layer = physical, layer
        self.start, self.pose_refinement = vision.start, vision.pose_refinement
        self.chart, self.decoder, self.calibration = chart_of(scene, vision.chart), Decoder(scene), Calibration()
        camera = self.decoder.renderer.camera
        self.encoder = encoder(self.chart, camera.height, camera.width)
        self.supervision = DeepSupervision(self.chart)
        self.physics_device, self.up = torch.device(vision.physics_device), scene.ground.normal

    def encode(self, image: Tensor, background: Tensor) -> Encoding:
        """Encode f images of each of B trajectories.

        Args:
            image: In [0, 1], shape (B, f, 3, H, W).
            background: The empty scenes in [0, 1], shape (B, 3, H, W).

        Returns:
            Poses (B, f, N, 7), numbers (B, f, N, K), divergences (B, f) and features (B, f, C).
        """
        flat = image.flatten(0, 1)
        behind = background[:, None].expand_as(image).flatten(0, 1)
        size = len(flat) if torch.is_grad_enabled() else AT_ONCE
        parts = [self.encoder(*part) for part in zip(flat.split(size), behind.split(size), strict=True)]
        fields = {
            field.name: torch.cat([getattr(part, field.name) for part in parts]).unflatten(0, image.shape[:2])
            for field in dataclasses.fields(Encoding)
        }
        return Encoding(**fields)

    @torch.no_grad()
    def read(self, image: Tensor, background: Tensor) -> tuple[Tensor, Tensor]:
        """Read poses (B, f, N, 7) from images (see `encode`), as the encoder gives them, and refined."""
        encoded = self.encode(image, background).pose
        refined = self.pose_refinement(self.chart, self.decoder, encoded, image, background)
        return encoded, self.calibration(self.chart, self.decoder.renderer.camera, refined)

    def physical_there(self) -> PhysicalParameters:
        """Return a copy of the learned parameters on the device of the physics."""
        return copy.deepcopy(self.physical).to(self.physics_device)

    def parameters_there(self) -> Parameters:
        """Return the physical parameters on the device of the physics."""
        here: Parameters = self.physical()
        return here.map(lambda _, value: value.to(self.physics_device))

    def initial_state(self, pose: Tensor, shown: Tensor, wrench: Tensor) -> State:
        """Find the states at the first frames from encoded poses (B, f, N, 7) of the frames shown (B, f)."""
        there = self.physics_device
        pose, shown, wrench = pose.to(there, torch.float64), shown.to(there), wrench.to(there, torch.float64)
        return self.start(pose, shown, wrench, self.layer, self.parameters_there())

    def roll_out(self, pose: Tensor, shown: Tensor, wrench: Tensor) -> Tensor:
        """Predict T frames from the encoded poses of a few.

        Args:
            pose: Encoded poses, shape (B, f, N, 7).
            shown: Which frames they belong to, shape (B, f); the first one must be among them.
            wrench: Known wrenches, shape (B, T, N, 6).

        Returns:
            Poses, shape (B, T, N, 7), float64, on the device of the physics.
        """
        return self.rolled(self.initial_state(pose, shown, wrench), wrench).pose

    def rolled(self, state: State, wrench: Tensor) -> Rollout:
        """Roll out states under wrenches (B, T, N, 6), the last of which is not used."""
        rollout: Rollout = self.layer.rollout(
            state, wrench[:, :-1].to(self.physics_device, torch.float64), self.parameters_there()
        )
        return rollout
