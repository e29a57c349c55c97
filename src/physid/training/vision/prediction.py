"""What a model predicts of the trajectories of a batch: those that are shown, and on into the future."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from physid.networks import PlanarChart, as_image
from physid.training.parameters import PoseLoss, Trajectories
from physid.training.vision.landing_height import land
from physid.training.vision.model import VideoModel
from physid.training.vision.shown_frames import at_frames, over_time


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


def predict(model: VideoModel, batch: Mapping[str, Any]) -> Prediction:
    """Encode the frames of a batch of the data module, and roll out its trajectories from the first one."""
    encoded, refined = model.read(as_image(batch["frames"]), as_image(batch["background"]))
    rolled = model.roll_out(refined, batch["shown"], batch["wrench"])
    if model.pose_refinement.steps and isinstance(model.chart, PlanarChart) and model.chart.hovering:
        refined = _landed(model, model.chart, refined, batch)
    return Prediction(encoded, refined, rolled)


@torch.no_grad()
def _landed(model: VideoModel, chart: PlanarChart, pose: Tensor, batch: Mapping[str, Any]) -> Tensor:
    """Move refined poses (B, f, N, 7) along the rays from the camera to where the motion says they are."""
    there, shown = model.physics_device, batch["shown"]
    state = model.initial_state(pose, shown, batch["wrench"])
    goal, real = over_time(pose.to(there, torch.float64), batch)
    wrench = batch["wrench"].to(state.pose)
    twist = state.twist[:, None].expand(-1, goal.shape[1], -1, -1)
    given = Trajectories(goal, twist, wrench, batch["length"].to(there), batch["index"].to(there))
    eye, known = model.decoder.renderer.camera.position, model.parameters_there()
    landing = land(model.layer, known, chart, eye, PoseLoss(), given, real.to(there))
    return at_frames(landing.trajectories.pose, shown).to(pose)


@torch.no_grad()
def predict_trajectories(model: VideoModel, batch: Mapping[str, Any]) -> Trajectories:
    """Predict whole trajectories from their first frames, under the recorded wrenches or planned ones.

    Args:
        model: Reads frames and rolls out states.
        batch: A batch of the data module; with `future`, planned wrenches (B, T', N, 6), these count, from the
            first frame on.
    """
    place = model.start.places(batch["shown"])
    row = torch.arange(len(place), device=place.device)[:, None]
    _, pose = model.read(as_image(batch["frames"][row, place]), as_image(batch["background"]))
    state = model.initial_state(pose, batch["shown"][row, place], batch["wrench"])
    wrench, length = batch["wrench"], batch["length"]
    if "future" in batch:
        wrench, length = batch["future"], torch.full_like(length, batch["future"].shape[1])
    rollout = model.rolled(state, wrench)
    there = rollout.pose.device
    return Trajectories(rollout.pose, rollout.twist, wrench.to(rollout.pose), length.to(there), batch["index"])
