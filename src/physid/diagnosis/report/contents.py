"""What a report draws beside diagnosis.json."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from physid.diagnosis.document.document import SPLITS, Split

LEVELS = ("sensor", "numerical")


@dataclass(frozen=True)
class Curve:
    """Position error over time, root mean square over the trajectories of a split.

    Attributes:
        split: same or transfer.
        time: Shape (T,) [s].
        before: Of the refitted nominal model, shape (T,) [m].
        after: With the effect, shape (T,) [m]; None where no effect was added.
    """

    split: Split
    time: NDArray[np.float64]
    before: NDArray[np.float64]
    after: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        """Check the split and the shapes."""
        if self.split not in SPLITS:
            raise ValueError(f"Curve.split: expected one of {', '.join(SPLITS)}, found {self.split!r}")
        shape = np.shape(self.time)
        if len(shape) != 1 or shape[0] < 2:
            raise ValueError(f"Curve.time: expected shape (T,) with at least two frames, found {shape}")
        for name, values in self.lines.items():
            if np.shape(values) != shape or not np.isfinite(values).all():
                raise ValueError(f"Curve.{name}: expected finite values of shape {shape}, found {np.shape(values)}")

    @property
    def lines(self) -> dict[str, NDArray[np.float64]]:
        """The lines that there are, by name."""
        lines = {"before": self.before, "after": self.after}
        return {name: values for name, values in lines.items() if values is not None}


@dataclass(frozen=True)
class TimeMap:
    """Evidence over time.

    Attributes:
        rows: Pairs (body, degree of freedom), F of them.
        edges: Limits of the pieces of time, shape (K + 1,) [s].
        evidence: Shape (F, K).
    """

    rows: tuple[tuple[str, str], ...]
    edges: NDArray[np.float64]
    evidence: NDArray[np.float64]

    def __post_init__(self) -> None:
        """Check the shapes."""
        expected = (len(self.rows), len(self.edges) - 1)
        if min(expected) < 1 or np.shape(self.evidence) != expected or not np.isfinite(self.evidence).all():
            found = np.shape(self.evidence)
            raise ValueError(
                f"TimeMap.evidence: expected finite values of shape {expected} (rows, pieces), found {found}"
            )


@dataclass(frozen=True)
class Still:
    """A picture out of a film.

    Attributes:
        caption: When, and how far off the models are.
        picture: A WebP file.
    """

    caption: str
    picture: bytes


@dataclass(frozen=True)
class Overlay:
    """What models predict, drawn over a recorded film, side by side.

    Attributes:
        trajectory: Which one.
        models: Names of the models, one or two.
        larger: How many times as large as they are differences are drawn.
        stills: Pictures at some times.
        film: All of them as an mp4 file; None where it could not be written.
    """

    trajectory: str
    models: tuple[str, ...]
    larger: int
    stills: tuple[Still, ...]
    film: Path | None


@dataclass(frozen=True)
class ReportData:
    """What a report draws beside diagnosis.json; whatever is left out is left out of the page.

    Attributes:
        title: Name of the recording set.
        curves: Errors over time.
        time_map: Evidence over time.
        levels: Floors [m] by name: sensor, numerical.
        residual_wrench: Error [m] that a free residual wrench leaves, by split.
        threshold: Score that null simulations seldom exceed.
        replicates: How many null simulations stand behind the p-values.
        formulas: A line about each effect, by name.
        next_config: Text of the generate config of the next experiment.
        missing_effects: Text of a file with what is missing as effects.
        overlay: Recording and models, before and after, drawn over a recorded film.
        facts: What was diagnosed, for the small print.
    """

    title: str = ""
    curves: tuple[Curve, ...] = ()
    time_map: TimeMap | None = None
    levels: Mapping[str, float] = field(default_factory=dict)
    residual_wrench: Mapping[str, float] = field(default_factory=dict)
    threshold: float | None = None
    replicates: int | None = None
    formulas: Mapping[str, str] = field(default_factory=dict)
    next_config: str | None = None
    missing_effects: str | None = None
    overlay: Overlay | None = None
    facts: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check the names of levels and splits."""
        for what, names, known in (("levels", self.levels, LEVELS), ("residual_wrench", self.residual_wrench, SPLITS)):
            strange = [name for name in names if name not in known]
            if strange:
                raise ValueError(f"ReportData.{what}: expected {', '.join(known)} only, found {', '.join(strange)}")
