"""What a better model would have to add, as diagnosis.json says it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

from annotated_types import Ge, Le, MinLen

from physid.diagnosis.document.errors import Text
from physid.typed_files import CLOSED


@dataclass(frozen=True)
class ResidualLaw:
    """A force, a torque or a shift of the picture that explains what the model leaves.

    Attributes:
        kind: Which of these.
        direction: Along what it acts.
        variable: On what its size depends; None for nothing.
        variable_unit: Of that.
        region: Where it acts.
        at: Values of the variable, increasing, shape (B,); a single 0 without one.
        size: Its size there; linear in between. Of a shift only what initial states do not follow is known.
        low: Lower ends of the 90 % intervals; high: upper ones.
        unit: Of sizes.
        moves: How far it moves predicted positions, but for what initial states follow, root mean square over frames
            [m].
        explains: Which share of what the model leaves it explains, with the laws before it, in trajectories that it was
            not fitted to.
        gain: By how much it predicts these better [squared residuals].
    """

    __pydantic_config__: ClassVar[Any] = CLOSED
    kind: Literal["force", "torque", "shift"]
    direction: Text
    variable: Text | None
    variable_unit: Text | None
    region: Literal["everywhere", "in contact", "in flight"]
    at: Annotated[tuple[float, ...], MinLen(1)]
    size: Annotated[tuple[float, ...], MinLen(1)]
    low: Annotated[tuple[float, ...], MinLen(1)]
    high: Annotated[tuple[float, ...], MinLen(1)]
    unit: Text
    moves: Annotated[float, Ge(0)]
    explains: Annotated[float, Ge(0), Le(1)]
    gain: float

    def __post_init__(self) -> None:
        lengths = {len(each) for each in (self.at, self.size, self.low, self.high)}
        if len(lengths) > 1:
            raise ValueError("at, size, low, high: expected as many values in each")
