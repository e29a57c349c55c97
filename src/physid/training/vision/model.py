"""Everything between frames and predicted frames: encoder, initial state, physics, decoder."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, final

import torch
from torch import Tensor, nn

from physid.data import RecordingSet
from physid.networks import Encoder, Encoding, PlanarChart, PoseChart, SpatialChart, as_image
from physid.physics import Parameters, PhysicsLayer, Rollout, State
from physid.scenes import Scene
from physid.training.parameters import PhysicalParameters, PoseLoss, Trajectories
from physid.training.vision.calibration import Calibration
from physid.training.vision.decoder import Decoder, camera_of
from physid.training.vision.deep_supervision import DeepSupervision
from physid.training.vision.initial_state import Start
from physid.training.vision.landing_height import land
from physid.training.vision.pose_refinement import PoseRefinement

ChartName = Literal["planar", "hovering", "spatial"]
EncoderFactory = Callable[[PoseChart, int, int], Encoder]
"""Builds an encoder for a chart, and images of so many rows and columns."""
AT_ONCE = 256
"""Images that are encoded at once where no gradient needs them together."""


def chart_of(scene: Scene, name: ChartName) -> PoseChart:
    """Build the chart of a scene: which poses an encoder can express.

    Args:
        scene: Gives camera, ground and bodies.
        name: planar for bodies that lie flat on the ground, hovering for bodies parallel to it at any height, spatial
            for all poses.

    Raises:
        ValueError: If the scene has no camera, or it does not look down on the ground.
    """
    camera = camera_of(scene)
    if name == "spatial":
        return SpatialChart(camera, len(scene.bodies))
    thickness = scene.sizes[:, 2].tolist()
    return PlanarChart(camera, scene.ground.normal, scene.ground.offset, thickness, hovering=name == "hovering")


@dataclass(frozen=True)
class Vision:
    """How frames are read.

    Attributes:
        chart: Which poses the encoder can express: planar, hovering or spatial (see `chart_of`).
        start: How the initial state follows from the encoded poses.
        pose_refinement: How encoded poses are made better by the decoder where no gradient is needed.
        weights: Checkpoint of another run with the same kind of encoder, which a fit begins with; None for new weights.
        physics_device: Where trajectories are rolled out; the fastest implementation runs on a CPU.
    """

    chart: ChartName = "planar"
    start: Start = Start()
    pose_refinement: PoseRefinement = PoseRefinement()
    weights: str | None = None
    physics_device: str = "cpu"


@dataclass(frozen=True)
class Prediction:
    """What a model makes of a batch of B trajectories, of which f frames are shown.

    Attributes:
        encoded: Poses as the encoder reads them from the frames, shape (B, f, N, 7).
        refined: The same, refined; of bodies that may hover, as far away as the motion over all frames says. Without
            refinement they are the encoded ones.
        rolled: Poses rolled out from the first refined one, shape (B, T, N, 7), float64, on the physics' device.
    """

    encoded: Tensor
    refined: Tensor
    rolled: Tensor


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

    def look_at(self, recordings: RecordingSet, trajectories: Sequence[int]) -> None:
        """Learn what the bodies look like, and how exactly they are found, from some first frames (see `Decoder`)."""
        pose, image, background = self.decoder.model(recordings, trajectories)
        found = self.pose_refinement(self.chart, self.decoder, pose, image, background)
        self.calibration.measure(self.decoder.renderer.camera, found[:, 0], pose[:, 0], offset=True)

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
        return self._rolled(self.initial_state(pose, shown, wrench), wrench).pose

    def _rolled(self, state: State, wrench: Tensor) -> Rollout:
        """Roll out states under wrenches (B, T, N, 6), the last of which is not used."""
        rollout: Rollout = self.layer.rollout(
            state, wrench[:, :-1].to(self.physics_device, torch.float64), self.parameters_there()
        )
        return rollout

    def predict(self, batch: Mapping[str, Any]) -> Prediction:
        """Encode the frames of a batch of the data module, and roll out its trajectories from the first one."""
        encoded, refined = self.read(as_image(batch["frames"]), as_image(batch["background"]))
        rolled = self.roll_out(refined, batch["shown"], batch["wrench"])
        if self.pose_refinement.steps and isinstance(self.chart, PlanarChart) and self.chart.hovering:
            refined = self._landed(self.chart, refined, batch)
        return Prediction(encoded, refined, rolled)

    @torch.no_grad()
    def _landed(self, chart: PlanarChart, pose: Tensor, batch: Mapping[str, Any]) -> Tensor:
        """Move refined poses (B, f, N, 7) along the rays from the camera to where the motion says they are."""
        there, shown = self.physics_device, batch["shown"]
        state = self.initial_state(pose, shown, batch["wrench"])
        goal, real = over_time(pose.to(there, torch.float64), batch)
        wrench = batch["wrench"].to(state.pose)
        twist = state.twist[:, None].expand(-1, goal.shape[1], -1, -1)
        given = Trajectories(goal, twist, wrench, batch["length"].to(there), batch["index"].to(there))
        eye, known = self.decoder.renderer.camera.position, self.parameters_there()
        landing = land(self.layer, known, chart, eye, PoseLoss(), given, real.to(there))
        return at_frames(landing.trajectories.pose, shown).to(pose)

    @torch.no_grad()
    def foresee(self, batch: Mapping[str, Any]) -> Trajectories:
        """Predict whole trajectories from their first frames, under the recorded wrenches or planned ones.

        Args:
            batch: A batch of the data module; with `future`, planned wrenches (B, T', N, 6), these count, from the
                first frame on.
        """
        place = self.start.places(batch["shown"])
        row = torch.arange(len(place), device=place.device)[:, None]
        _, pose = self.read(as_image(batch["frames"][row, place]), as_image(batch["background"]))
        state = self.initial_state(pose, batch["shown"][row, place], batch["wrench"])
        wrench, length = batch["wrench"], batch["length"]
        if "future" in batch:
            wrench, length = batch["future"], torch.full_like(length, batch["future"].shape[1])
        rollout = self._rolled(state, wrench)
        there = rollout.pose.device
        return Trajectories(rollout.pose, rollout.twist, wrench.to(rollout.pose), length.to(there), batch["index"])


def at_frames(pose: Tensor, shown: Tensor) -> Tensor:
    """Pick frames (B, f) of poses (B, T, N, 7); frames beyond the end give the last one. Shape (B, f, N, 7)."""
    shown = shown.to(pose.device).clamp_max(pose.shape[1] - 1)
    return pose[torch.arange(len(pose), device=pose.device)[:, None], shown]


def over_time(encoded: Tensor, batch: Mapping[str, Any]) -> tuple[Tensor, Tensor]:
    """Spread encoded poses (B, f, N, 7) over the frames of a trajectory.

    Returns:
        Poses (B, T, N, 7), unturned bodies at the origin where none was encoded, and where one was (B, T).
    """
    rows, frames = batch["wrench"].shape[:2]
    shown = batch["shown"]
    row, reached = torch.arange(rows, device=shown.device)[:, None].expand_as(shown), shown < batch["length"][:, None]
    goal = encoded.new_zeros(rows, frames, *encoded.shape[2:])
    goal[..., 6] = 1.0
    goal[row[reached], shown[reached]] = encoded[reached]
    real = torch.zeros(rows, frames, dtype=torch.bool, device=shown.device)
    real[row[reached], shown[reached]] = True
    return goal, real
