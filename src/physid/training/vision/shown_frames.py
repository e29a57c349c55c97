"""The frames of a trajectory that a batch shows, among all of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor


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
