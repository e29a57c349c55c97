"""Variants of one experiment, and what the model predicts of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace

import torch
from torch import Tensor


@dataclass(frozen=True)
class Variants:
    """C variants of an experiment with R trajectories in K segments.

    Attributes:
        pose: Initial poses of the segments, shape (C, K, N, 7); those of bodies that lie on the ground are where the
            sizes that were measured lay them, see `raise_lying`.
        twist: Initial twists, shape (C, K, N, 6).
        nominal: Unknown parameters in the coordinates of the fit, shape (C, P).
        effects: Parameters of the candidate effects, shape (C, Q).
        engine: How far the numerics of the reference simulator are followed (0: not, 1: all the way), shape (C, 1).
        force: Wrench on top of the acting one, shape (C, R, T, N, 6); None for none.
    """

    pose: Tensor
    twist: Tensor
    nominal: Tensor
    effects: Tensor
    engine: Tensor
    force: Tensor | None = None

    def __len__(self) -> int:
        return self.pose.shape[0]

    def __getitem__(self, chosen: slice) -> Variants:
        return self._each(lambda value: value[chosen])

    @classmethod
    def of_states(cls, pose: Tensor, twist: Tensor, nominal: Tensor, effects: Tensor) -> Variants:
        """Return variants (C, ...) that do not follow a reference simulator."""
        return cls(pose, twist, nominal, effects, torch.zeros(len(pose), 1, dtype=torch.float64))

    @classmethod
    def join(cls, parts: Sequence[Variants]) -> Variants:
        """Put variants without a force one after the other."""
        names = [field.name for field in fields(cls) if field.name != "force"]
        return cls(*(torch.cat([getattr(part, name) for part in parts]) for name in names))

    def repeat(self, times: int) -> Variants:
        """Repeat a single variant."""
        return self._each(lambda value: value.expand(times, *value.shape[1:]).clone())

    def _each(self, change: Callable[[Tensor], Tensor]) -> Variants:
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return Variants(**{name: None if value is None else change(value) for name, value in values.items()})  # type: ignore[arg-type]

    def replace(self, **changes: Tensor) -> Variants:
        """Return a copy with some fields changed."""
        return replace(self, **changes)


@dataclass(frozen=True)
class Prediction:
    """What the model says.

    Attributes:
        pose: Poses that the camera would report, shape (C, R, T, N, 7).
        state: Poses before the camera, shape (C, R, T, N, 7).
        twist: Shape (C, R, T, N, 6).
        impulse: Of contacts along their normals from each frame to the next [N s], zero in the last of a segment; shape
            (C, R, T, K).
    """

    pose: Tensor
    state: Tensor
    twist: Tensor
    impulse: Tensor
