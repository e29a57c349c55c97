"""Frames at which small errors grow fast: impacts, contact between bodies, tumbling on an edge."""

from __future__ import annotations

import torch
from torch import Tensor

from physid.diagnosis.phases import PHASES
from physid.physics.rotations import to_matrix
from physid.scenes.scene import Scene

TILTED = 0.05  # [rad]
HOT = ("impact", "contact_between_objects")


def find_events(phases: Tensor, pose: Tensor, scene: Scene) -> Tensor:
    """Find the frames at which some body hits another, or touches the ground other than with a whole face.

    Args:
        phases: Codes of PHASES, shape (R, T, N).
        pose: Poses, shape (R, T, N, 7).
        scene: The ground.

    Returns:
        Shape (R, T).
    """
    normal = torch.tensor(scene.ground.normal, dtype=pose.dtype)
    along = (normal @ to_matrix(pose[..., 3:])).abs().amax(-1)
    tilted = torch.acos(along.clamp(-1, 1)) > TILTED
    hot = torch.stack([phases == PHASES.index(name) for name in HOT]).any(0)
    flying = phases == PHASES.index("free_fall")
    return (hot | (tilted & ~flying)).any(-1)
