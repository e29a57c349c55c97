"""What a fit knows of its parameters: a normal distribution of their coordinates, kept with the run, and drawn from."""

from __future__ import annotations

import csv
import itertools
import json
import math
import re
import zipfile
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, ClassVar, Literal

import torch
from torch import Tensor

from physid.data.files import write_text
from physid.estimation.prediction.coordinates import Coordinates, Kind, Unknown
from physid.strict import quoted, seen, whole
from physid.training.parameters.intervals import WIDEST, intervals, logged
from physid.typed_files import CLOSED, read_json_as
from physid.yaml_files import open_regular, parse_yaml

FILE = "posterior.json"
LEAST = 1e-3
"""Share of the draws that must lie within the physical ranges."""
AT_ONCE = 10_000
NAME = re.compile(r"[^./\\][^.]*(\.\w+)+")
"""Of a parameter: its body or effect, and which of its parameters."""
ROUNDED = 1e-5
"""Share by which an estimate may differ from what its coordinate stands for."""
LOOSE = 1e-3
"""Of correlations: what rounding may take them beyond one where parameters are known only together."""


@dataclass(frozen=True)
class Known:
    """One parameter in posterior.json; `coordinate` is its logarithm, or linear (value - null) / scale."""

    __pydantic_config__: ClassVar[Any] = CLOSED
    name: str
    unit: str
    kind: Kind
    scale: float
    null: float
    low: float | None
    high: float | None
    estimate: float
    coordinate: float

    def __post_init__(self) -> None:
        seen(self.name, "name")
        if not NAME.fullmatch(self.name):
            raise ValueError(f"name: expected one such as block.friction, got {quoted(self.name)}")
        if self.scale == 0 or not self.unknown().low < self.unknown().high:
            raise ValueError(f"{self.name}: expected a scale other than 0 and a range from low to high, found others")
        where = torch.tensor([self.coordinate], dtype=torch.float64)
        value = float(Coordinates((self.unknown(),)).to_values(where))
        if not abs(value - self.estimate) <= ROUNDED * max(abs(value), abs(self.estimate), abs(self.scale)):
            raise ValueError(
                f"{self.name}: expected the estimate that its coordinate {self.coordinate:g} stands for, {value:.6g}, "
                f"found {self.estimate:.6g}"
            )

    def unknown(self) -> Unknown:
        """Return what it is, whether or not its effect is known here."""
        low, high = -math.inf if self.low is None else self.low, math.inf if self.high is None else self.high
        return Unknown(self.name, self.unit, self.kind, low, high, self.scale, self.null)


@dataclass(frozen=True)
class _PosteriorFile:
    """The content of posterior.json; null stands for what is not known at all."""

    __pydantic_config__: ClassVar[Any] = CLOSED
    format: Literal["physid-posterior"]
    version: Literal[1]
    trajectories: int
    parameters: list[Known]
    covariance: list[list[float | None]]

    def __post_init__(self) -> None:
        whole(self.trajectories, "trajectories", low=1)
        names = [one.name for one in self.parameters]
        if not names:
            raise ValueError("parameters: expected at least one, found none")
        if twice := sorted({name for name in names if names.count(name) > 1}):
            raise ValueError(f"parameters: {', '.join(map(quoted, twice))} is there twice; each has one row")
        if [len(row) for row in self.covariance] != [len(names)] * len(names):
            raise ValueError(f"covariance: expected {len(names)} rows of {len(names)} values")
        self._check_covariance()

    def _check_covariance(self) -> None:
        """Check that some normal distribution has the covariance, as far as it is known."""
        matrix = self.matrix()
        known = matrix.diagonal().isfinite()
        variance, part = matrix.diagonal()[known], matrix[known][:, known]
        spread = torch.where(variance > 0, variance, 1.0).sqrt()
        apart = part.where(part.isfinite(), torch.zeros_like(part)) / spread / spread[:, None]  # correlations
        if not apart.isfinite().all() or (variance < 0).any() or (apart - apart.T).abs().sum() > LOOSE:
            raise ValueError("covariance: expected variances of at least 0 in a symmetric matrix, found others")
        if len(apart) and float(torch.linalg.eigvalsh((apart + apart.T) / 2)[0]) < -LOOSE:
            raise ValueError("covariance: expected one that a distribution can have, found correlations beyond one")

    def matrix(self) -> Tensor:
        """Return the covariance, infinite where nothing is known."""
        rows = [[math.inf if value is None else value for value in row] for row in self.covariance]
        return torch.tensor(rows, dtype=torch.float64)


@dataclass(frozen=True)
class Posterior:
    """Normal in the coordinates of the parameters (see `Coordinates`), within their physical ranges.

    Attributes:
        space: What their coordinates stand for.
        point: Their estimates, as coordinates, shape (P,).
        covariance: Of the coordinates, shape (P, P); infinite where nothing is known.
        trajectories: From how many independent trajectories it was estimated.
    """

    space: Coordinates
    point: Tensor
    covariance: Tensor
    trajectories: int

    @property
    def names(self) -> tuple[str, ...]:
        """The P learned parameters."""
        return tuple(one.name for one in self.space.unknowns)

    @property
    def unbounded(self) -> list[str]:
        """Parameters of which nothing is known."""
        told = self.covariance.diagonal() < WIDEST**2
        return [name for name, known in zip(self.names, told.tolist(), strict=True) if not known]

    def correlations(self) -> dict[tuple[str, str], float]:
        """Return the correlation of each pair of estimates of which something is known."""
        spread = self.covariance.diagonal().sqrt()
        matrix = (self.covariance / spread / spread[:, None]).tolist()
        known = [row for row, name in enumerate(self.names) if name not in self.unbounded]
        return {
            (self.names[i], self.names[j]): matrix[i][j]
            for i, j in itertools.combinations(known, 2)
            if math.isfinite(matrix[i][j])
        }

    def logged(self) -> dict[str, Tensor]:
        """Return figures of a run: params/NAME/low and /high of 90 % intervals, correlation/NAME/OTHER.

        What is not known is nan: left out, the figure of an earlier epoch would stay.
        """
        estimates = dict(zip(self.names, self.space.to_values(self.point).tolist(), strict=True))
        pairs = dict.fromkeys(itertools.combinations(self.names, 2), math.nan) | self.correlations()
        return logged(dict.fromkeys(self.names, (math.nan, math.nan)) | intervals(estimates, self.covariance)) | {
            f"correlation/{one}/{other}": torch.tensor(value, dtype=torch.float64)
            for (one, other), value in pairs.items()
        }

    def sample(self, count: int, seed: int = 0) -> Tensor:
        """Draw sets of parameters, shape (count, P), in their units; what lies beyond a physical range is drawn again.

        Raises:
            ValueError: If nothing is known of a parameter, or hardly any draw lies within the ranges.
        """
        if self.unbounded:
            raise ValueError(
                f"{', '.join(self.unbounded)}: the recordings of this run do not identify it, so that there is nothing "
                "to draw from; fit again with the others alone (model.learn)"
            )
        values, vectors = torch.linalg.eigh((self.covariance + self.covariance.T) / 2)
        root = vectors * values.clamp_min(0).sqrt()
        source, (low, high) = torch.Generator().manual_seed(seed), self.space.ends
        kept, made, drawn = [torch.zeros(0, len(self.names), dtype=torch.float64)], 0, 0
        while made < count:
            draws = self.point + torch.randn(AT_ONCE, len(self.names), generator=source, dtype=torch.float64) @ root.T
            kept.append(draws[((draws >= low) & (draws <= high)).all(1)])
            made, drawn = made + len(kept[-1]), drawn + AT_ONCE
            if made < LEAST * drawn:
                raise ValueError(
                    f"of {drawn} draws {made} lie within the physical ranges; an estimate stands at the end of its "
                    "range, and is hardly known: leave it out of model.learn"
                )
        return self.space.to_values(torch.cat(kept)[:count])

    def write(self, folder: Path) -> None:
        """Write posterior.json into the folder of a run."""
        estimates = self.space.to_values(self.point).tolist()
        parameters = [
            {
                "name": one.name, "unit": one.unit, "kind": one.kind, "scale": one.scale, "null": one.null,
                "low": _finite(one.low), "high": _finite(one.high), "estimate": estimate, "coordinate": coordinate,
            }
            for one, estimate, coordinate in zip(self.space.unknowns, estimates, self.point.tolist(), strict=True)
        ]  # fmt: skip
        content = {
            "format": "physid-posterior", "version": 1, "trajectories": self.trajectories, "parameters": parameters,
            "covariance": [[_finite(value) for value in row] for row in self.covariance.tolist()],
        }  # fmt: skip
        write_text(folder / FILE, json.dumps(content, indent=2) + "\n")


def read_posterior(run: Path) -> Posterior:
    """Read what a run knows of its parameters.

    Args:
        run: The folder of a fit, or its posterior.json.

    Raises:
        ValueError: If there is none, or the file breaks the format, or says what no fit can know.
    """
    path = run / FILE if run.is_dir() else run
    if not path.is_file():
        raise ValueError(f"{path} does not exist: expected a run of `physid fit` that has come to its end")
    known = read_json_as(_PosteriorFile, path)
    return Posterior(
        Coordinates(tuple(one.unknown() for one in known.parameters)),
        torch.tensor([one.coordinate for one in known.parameters], dtype=torch.float64),
        known.matrix(),
        known.trajectories,
    )


def holds_samples(path: Path, names: tuple[str, ...]) -> bool:
    """Return whether a file holds sets of these parameters, by its beginning or its list of arrays.

    Raises:
        OSError: If it cannot be read, or is no regular file.
    """
    with open_regular(path) as file:
        try:
            if path.suffix.lower() == ".npz":
                return zipfile.ZipFile(file).namelist() == [f"{name}.npy" for name in names]
            lines = [line.decode() for line in islice(file, len(names) + 1)]
            if path.suffix.lower() == ".csv":
                return next(csv.reader(lines), []) == list(names)
            first, next_one = parse_yaml("".join(lines[: len(names)]), str(path)), "".join(lines[len(names) :])
        except (ValueError, zipfile.BadZipFile, csv.Error):
            return False
    whole = next_one.startswith("- ") or not next_one
    return whole and isinstance(first, list) and [tuple(one) for one in first if isinstance(one, dict)] == [names]


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
