"""Blocks that lie on the ground, and what a camera sees of them."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from estimation.flights import Flights, flights
from physid.estimation.prediction import NominalModel, Predictor, Segmentation, Timeline, Variants
from physid.scenes import find_setup


def two_blocks(places: Tensor, friction: float = 0.12, push: float = 0.0) -> Flights:
    """Lay two blocks on the ground 1 m apart, each trajectory a segment; places (R, T, 2) along x are observed."""
    rows, frames = places.shape[:2]
    scene = replace(find_setup("collide").scene, unknown=())
    scene = replace(scene, bodies=tuple(replace(body, friction=friction) for body in scene.bodies))
    wrench = torch.zeros(rows, frames, 2, 6).double()
    wrench[..., 0, 3] = push
    predictor = Predictor(
        NominalModel(scene), Timeline.regular(wrench, scene.time_step), Segmentation.equal(rows, frames, frames)
    )
    pose = torch.zeros(rows, frames, 2, 7).double()
    pose[..., 2], pose[..., 6] = torch.tensor([body.size[2] / 2 for body in scene.bodies]).double(), 1.0
    pose[..., 0] = places + torch.tensor([0.0, 1.0])
    made = flights(trajectories=rows, frames=frames, cuts=1)
    lies = torch.ones(rows, 2, dtype=torch.bool)
    directions = type(made.experiment.directions).of(torch.tensor([0.0, 0, 1]).double(), lies, lies)
    scale = torch.full((rows, frames, 2, 6), 1e3).double()
    experiment = made.experiment.replace(
        predictor=predictor, pose=pose, directions=directions, scale=scale, engine=torch.zeros_like(pose[..., :6]),
    )  # fmt: skip
    point = Variants.of_states(pose[:, 0][None], torch.zeros(1, rows, 2, 6).double(), predictor.model.guess[None],
                               predictor.null[None])  # fmt: skip
    return Flights(experiment, point, point)
