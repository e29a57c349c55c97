"""Pushed blocks predicted by the layer itself: recordings whose parameters are known exactly."""

from __future__ import annotations

import dataclasses
from typing import Any

import torch

from physid.physics import PhysicsLayer, State
from physid.scenes import Integration, Scene, find_setup
from physid.scenes.scene import SEMI_IMPLICIT_EULER
from physid.training.learners.engine import Engine
from physid.training.parameters.physical_parameters import PhysicalParameters

TRUE_FRICTION = 0.12
SCENE: Scene = dataclasses.replace(
    find_setup("push").scene, unknown=("block.friction",), integration=Integration(SEMI_IMPLICIT_EULER, 1 / 240)
)


def layer() -> PhysicsLayer:
    """Return the physics of the scene."""
    return Engine().layer(SCENE)


def push_batch(count: int = 3, frames: int = 25) -> dict[str, Any]:
    """Return blocks that slide under different forces, as the data module serves them."""
    pose = torch.tensor([[0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0]], dtype=torch.float64).expand(count, 1, 7)
    wrench = torch.zeros(count, frames, 1, 6, dtype=torch.float64)
    wrench[:, :, 0, 3] = 5.0 + torch.arange(count)[:, None] + torch.arange(frames) / frames
    with torch.no_grad():
        known = PhysicalParameters(SCENE)()
        rollout = layer().rollout(State.at_rest(pose), wrench[:, :-1], known)
    return {
        "pose": rollout.pose,
        "twist": rollout.twist,
        "wrench": wrench,
        "length": torch.full((count,), frames),
        "index": torch.arange(count),
    }
