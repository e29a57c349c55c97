"""The evidence that the probabilities of causes follow from, as diagnosis.json and the training table hold it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

from annotated_types import Ge, MinLen

from physid.typed_files import CLOSED

NONE, UNKNOWN, OTHER = "none", "unknown", "other"
"""Causes that are no hypothesis: no effect; one that the catalogue lacks; one of the catalogue that is not listed."""


@dataclass(frozen=True)
class Evidence:
    """What speaks for and against each cause.

    Attributes:
        said: Causes that the verdict allows: `none`, `unknown`, or the hypotheses of its group.
        behind: For each hypothesis (effects joined by " + ") log(1 + d), with d how far its score falls behind the best
            one, in multiples of what the search takes for a tie.
        gap: By how much the nominal model leaves held-out positions beyond the noise [tolerances].
        bend: By how much a position leaves the line between its neighbours beyond the noise, root mean square: how
            coarsely the frames resolve the motion [errors that a perfect model leaves].
        poses: Observed poses.
    """

    __pydantic_config__: ClassVar[Any] = CLOSED
    said: Annotated[tuple[str, ...], MinLen(1)]
    behind: dict[str, Annotated[float, Ge(0)]]
    gap: Annotated[float, Ge(0)]
    bend: Annotated[float, Ge(0)]
    poses: Annotated[int, Ge(1)]


def hypothesis(names: tuple[str, ...]) -> str:
    """Return the name of a hypothesis: its effects in alphabetical order, joined by " + "."""
    return " + ".join(sorted(names))
