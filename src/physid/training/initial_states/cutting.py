"""What of recorded trajectories a fit is to: segments or pieces of them, without frames that stand alone."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import torch
from torch import Tensor

from physid.training.parameters import Pieces, Trajectories


@final
@dataclass(frozen=True)
class OutlierFrames:
    """Frames in which the pose of a body stands alone (see `frame_weights`): neither motion nor impact explains it.

    Attributes:
        index: Trajectory of the recording set that each is of, shape (n,).
        frame: Its place there, shape (n,).
    """

    index: Tensor
    frame: Tensor

    @classmethod
    def among(cls, whole: Trajectories, outlier: Tensor) -> OutlierFrames:
        """Take those of whole trajectories, of which some frames (B, T) are outliers."""
        row, frame = (outlier & whole.real.to(outlier.device)).nonzero().unbind(1)
        return cls(whole.index.to(row.device)[row], frame)

    @classmethod
    def of_state(cls, state: Mapping[str, Tensor]) -> OutlierFrames | None:
        """Take what `state_dict` returned; None for an empty mapping."""
        return cls(**state) if state else None

    def __len__(self) -> int:
        return len(self.index)

    def state_dict(self) -> dict[str, Tensor]:
        """Return what a checkpoint needs."""
        return dict(vars(self))

    def described(self, frames: int) -> str:
        """Say that they do not count, of so many frames, a sentence for the user."""
        return (
            f"{len(self)} of {frames} frames do not count: a pose in them stands alone, off what comes before and "
            f"after (the first in trajectory {int(self.index[0])}, frame {int(self.frame[0])})"
        )

    def left_out_of(self, whole: Trajectories) -> Trajectories:
        """Return whole trajectories of which these frames do not count; those that are not here stay as they are."""
        device = whole.pose.device
        at = (self.index.to(device)[:, None] == whole.index).nonzero()
        outlier = torch.zeros_like(whole.real)
        outlier[at[:, 1], self.frame.to(device)[at[:, 0]]] = True
        return dataclasses.replace(whole, seen=whole.real & ~outlier)


@final
@dataclass(frozen=True)
class Cutting:
    """How whole trajectories become what a fit is to.

    Attributes:
        parts: Steps of a segment, or pieces; None for whole trajectories.
        outliers: Frames that do not count; None for no such frame.
    """

    parts: int | Pieces | None = None
    outliers: OutlierFrames | None = None

    def of(self, whole: Trajectories) -> Trajectories:
        """Cut whole trajectories."""
        counted = whole if self.outliers is None else self.outliers.left_out_of(whole)
        return self.parts.of(counted) if isinstance(self.parts, Pieces) else counted.segments(self.parts)


WHOLE = Cutting()
"""All frames of whole trajectories."""
