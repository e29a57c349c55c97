"""How far a model leaves recordings, before effects are added and after: a part of diagnosis.json."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

from annotated_types import Ge, MinLen

from physid.typed_files import CLOSED

Positive = Annotated[float, Ge(0)]
Text = Annotated[str, MinLen(1)]


@dataclass(frozen=True)
class Errors:
    """Root mean square errors of what was held out; `after` is None where no effect was added."""

    __pydantic_config__: ClassVar[Any] = CLOSED
    before: Positive
    after: Positive | None


@dataclass(frozen=True)
class Allowed:
    """How far a model may leave the recordings before anything is blamed [m, rad]."""

    __pydantic_config__: ClassVar[Any] = CLOSED
    position: Positive
    rotation: Positive


@dataclass(frozen=True)
class Rotations:
    """Root mean square errors of held-out rotations [rad], beside the floor that a true model would leave."""

    __pydantic_config__: ClassVar[Any] = CLOSED
    floor: Positive
    same: Errors | None
    transfer: Errors | None


@dataclass(frozen=True)
class Impacts:
    """What the nominal model leaves at impacts, beyond noise [m, rad], where many of them are not explained.

    They count little in `same` and `transfer`, as single ones that are not explained should. `with_effects` are the
    segments that are not explained with the effects that are blamed; None where none are.
    """

    __pydantic_config__: ClassVar[Any] = CLOSED
    unexplained: Annotated[int, Ge(1)]
    among: Annotated[int, Ge(1)]
    position: Positive
    rotation: Positive
    with_effects: Annotated[int, Ge(0)] | None = None


@dataclass(frozen=True)
class Gap:
    """Errors on the same protocol and on the transfer protocol, beside the floor that a true model would leave.

    `rotations` are given for splits where they show the gap more clearly than positions do; shares that close are then
    of rotations. `impacts` says what is left there, where many of them are not explained.
    """

    __pydantic_config__: ClassVar[Any] = CLOSED
    unit: Text
    floor: Positive
    tolerance: Allowed
    same: Errors
    transfer: Errors | None
    rotations: Rotations | None = None
    impacts: Impacts | None = None

    @property
    def most_beyond_noise(self) -> float:
        """By how much the nominal model leaves positions beyond noise [m]: on the same protocol, or at its impacts."""
        return max(self.beyond_noise(self.same), 0.0 if self.impacts is None else self.impacts.position)

    def beyond_noise(self, errors: Errors | None) -> float:
        """Return by how much the nominal model leaves positions beyond the noise [m], sqrt(error^2 - floor^2)."""
        return 0.0 if errors is None else math.sqrt(max(errors.before**2 - self.floor**2, 0.0))
