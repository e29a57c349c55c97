"""How far, and how many, trajectories are rolled out in training."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

Batch = Mapping[str, Any]


@dataclass(frozen=True)
class Horizon:
    """The part of a batch that is rolled out.

    After a collision every error grows from step to step, so that a long rollout says more about the error of the first
    pose than about the parameters; and every rollout costs time.

    Attributes:
        frames: Frames after the first one; None for all.
        trajectories: Trajectories of a batch that are rolled out while encoder and parameters learn together; None for
            all.
    """

    frames: int | None = None
    trajectories: int | None = None

    def __post_init__(self) -> None:
        for name in ("frames", "trajectories"):
            value = getattr(self, name)
            if value is not None and value < 1:
                raise ValueError(f"horizon.{name} must be positive or null, got {value}")

    def cut(self, batch: Batch, *, all_trajectories: bool = False) -> dict[str, Any]:
        """Return the part of a batch that is rolled out: its first trajectories, their first frames."""
        last = None if self.frames is None else self.frames + 1
        rows = None if all_trajectories else self.trajectories
        part = {name: value[:rows] for name, value in batch.items()}
        part |= {name: part[name][:, :last] for name in ("pose", "wrench")}
        part["length"] = part["length"].clamp_max(part["pose"].shape[1])
        return part


def spread(value: Tensor, count: int) -> Tensor:
    """Fill up values of the first trajectories (b,) with zeros to (count,), such that their mean stays the same."""
    return torch.cat([value * count / len(value), value.new_zeros(count - len(value))])
