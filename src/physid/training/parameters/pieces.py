"""Pieces of trajectories that are cut around impacts, each predicted from an initial state of its own."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import torch
from torch import Tensor

from physid.training.parameters.trajectories import OVER_TIME, Trajectories

NEARLY = 1.5
"""Ratio of two weights that are nearly the same."""


@final
@dataclass(frozen=True)
class Pieces:
    """K pieces of trajectories.

    Attributes:
        index: Trajectory of the recording set that each is of, shape (K,).
        start: First frame, shape (K,).
        size: Frames, at least two, shape (K,).
        weight: How much a frame of it counts beside those of others, shape (K,).
        struck: Whether it holds an event, shape (K,).
    """

    index: Tensor
    start: Tensor
    size: Tensor
    weight: Tensor
    struck: Tensor

    @classmethod
    def of_state(cls, state: Mapping[str, Tensor]) -> Pieces | None:
        """Take what `state_dict` returned; None for an empty mapping. Older checkpoints do not say what is struck."""
        return cls(**{"struck": torch.zeros(len(state["index"]), dtype=torch.bool), **state}) if state else None

    def state_dict(self) -> dict[str, Tensor]:
        """Return what a checkpoint needs."""
        return dict(vars(self))

    def described(self) -> str:
        """Say that trajectories are cut, a sentence for the user."""
        return f"{len(self.index.unique())} trajectories are cut around their impacts into {len(self.index)} pieces"

    def counts_like(self, other: Pieces) -> bool:
        """Return whether each piece counts nearly as much as it does there, beside the others."""
        return bool(((self.weight / other.weight).log().abs() <= math.log(NEARLY)).all())

    def of(self, whole: Trajectories) -> Trajectories:
        """Cut them out of whole trajectories; shorter ones are padded at the end.

        Raises:
            ValueError: If a trajectory is not there.
        """
        device = whole.pose.device
        index, start, size, weight = (each.to(device) for each in (self.index, self.start, self.size, self.weight))
        same = index[:, None] == whole.index
        if not bool(same.any(1).all()):
            raise ValueError(f"expected the trajectories {sorted(set(index.tolist()))}, got {whole.index.tolist()}")
        row = same.to(torch.uint8).argmax(1)
        at = start[:, None] + torch.arange(int(size.max()), device=device)
        at = torch.minimum(at, (start + size - 1)[:, None])
        cut = {name: value[row[:, None], at] for name in OVER_TIME if (value := getattr(whole, name)) is not None}
        grid = None if whole.grid is None else whole.grid.between(row, at)
        return Trajectories(**cut, length=size, index=index, grid=grid, weight=weight)
