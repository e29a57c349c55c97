"""Which parameters trajectories identify, which only in a combination, and which not at all."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, final

import torch
from torch import Tensor

from physid.estimation.measurement import Noise
from physid.estimation.prediction.coordinates import is_effect
from physid.strict import number
from physid.typed_files import CLOSED

Kind = Literal["identified", "combination", "unobservable"]
ACCEPT = 0.05
NOTHING = 10.0
"""A relative deviation beyond which nothing is known."""
FLOOR = 1e-5
"""Singular values below this share of the largest are zero: pushing a block with one constant force gives 7e-7, with
forces redrawn at each step 1.4e-2."""
CANCELLED = 1e-3
"""Smallest ratio of the deviation that a parameter has if the others are known to that which it has beside them. Below,
it rests on what is left where derivatives cancel: a model that is right to a part in a thousand says something else. A
block pushed from rest by one steady force leaves 4e-4, all of it from initial velocities that noise feigned."""
OVERLAP = 1e-3
"""Smallest share of a parameter in a direction of which nothing is known that counts."""
ALIKE = 0.99
"""Correlation beyond which two estimates are hardly distinguished: the deviation of each is 7 times that if the other
were known."""
FAINT = 0.02
"""Smallest exponent in a combination that is written down."""


@final
@dataclass(frozen=True)
class SensorNoise:
    """White noise of the observed poses.

    Attributes:
        position: Standard deviation of each coordinate [m].
        rotation: Standard deviation of each component of a rotation vector [rad].

    Raises:
        ValueError: If one is not positive.
    """

    __pydantic_config__: ClassVar[Any] = CLOSED
    position: float = 1e-3
    rotation: float = 1e-2

    def __post_init__(self) -> None:
        number(self.position, "noise.position", low=0.0, strict=True)
        number(self.rotation, "noise.rotation", low=0.0, strict=True)

    def spread(self) -> Tensor:
        """Return the standard deviation of each coordinate, rotation vector and position, shape (6,)."""
        return Noise(self.rotation, self.position).spread()


@final
@dataclass(frozen=True)
class Verdict:
    """What can be said of one parameter.

    Attributes:
        name: The parameter.
        kind: identified; known only in a combination with others; or unobservable.
        deviation: Relative standard deviation to expect of its estimate, the other parameters being estimated too.
        alone: The same if the other parameters were known.
        combination: What is known where it is not known by itself, say "block.mass * block.friction^0.43".
        combined: Relative standard deviation to expect of that.
    """

    name: str
    kind: Kind
    deviation: float
    alone: float
    combination: str | None = None
    combined: float | None = None

    @property
    def words(self) -> str:
        """The verdict in words."""
        if self.kind == "combination" and self.combined is not None:
            return f"only in the combination {self.combination}, to {percent(self.combined)}"
        return "identified" if self.kind == "identified" else "not at all"

    def __str__(self) -> str:
        of = " of its typical size" if is_effect(self.name) else ""
        expected = f"expected deviation {percent(self.deviation)}{of}, {percent(self.alone)} if all else were known"
        return f"{self.name}: {self.words} ({expected})"


@final
@dataclass(frozen=True)
class Identifiability:
    """Fisher's information on the coordinates of the parameters, and what follows from it.

    Coordinates are logarithms, so that deviations are relative; those of effects are in units of the typical size.

    F = J^T S^-1 J; no unbiased estimate has a covariance below F^-1 (Cramer 1946, Rao 1945). The eigenvectors of F are
    the combinations that are known independently of each other, the roots of its eigenvalues the singular values of
    S^-1/2 J.

    Attributes:
        names: The P parameters.
        information: F, with J the sensitivity of the poses and S the variance of the sensor; shape (P, P).
        accept: Largest relative deviation of a parameter that counts as identified.

    Raises:
        ValueError: If the information has another shape or is not finite.
    """

    names: tuple[str, ...]
    information: Tensor
    accept: float = ACCEPT

    def __post_init__(self) -> None:
        shape = (len(self.names), len(self.names))
        if tuple(self.information.shape) != shape or not bool(torch.isfinite(self.information).all()):
            raise ValueError(f"information must be finite, of shape {shape}, got shape {tuple(self.information.shape)}")

    @classmethod
    def of(
        cls, names: tuple[str, ...], sensitivity: Tensor, real: Tensor, spread: Tensor, accept: float = ACCEPT
    ) -> Identifiability:
        """Compute the information.

        Args:
            names: The P parameters.
            sensitivity: J by ln(parameter) [m, rad], shape (P, B, T, N, 6).
            real: Which frames are observed, shape (B, T).
            spread: Standard deviation of each coordinate of a pose, shape (6,).
            accept: See the class.
        """
        seen = (sensitivity / spread.to(sensitivity) * real[..., None, None]).flatten(1)
        return cls(names, (seen @ seen.T).cpu(), accept)

    @property
    def singular_values(self) -> list[float]:
        """Singular values of S^-1/2 J, largest first: one over the deviation of each independent combination."""
        return self._spectrum()[0].tolist()

    @property
    def condition(self) -> float:
        """Largest over smallest singular value; inf where one is zero."""
        values, spread, _ = self._spectrum()
        return math.inf if bool(torch.isinf(spread[-1])) else float(values[0] * spread[-1])

    @property
    def correlation(self) -> Tensor:
        """Correlation of the estimates, shape (P, P); its limit where nothing is known of a combination."""
        values, _, directions = self._spectrum()
        least = values[0] * FLOOR + torch.finfo(values.dtype).tiny
        scaled = directions * (values[-1].clamp_min(least) / values.clamp_min(least))
        covariance = scaled @ scaled.T
        deviation = covariance.diagonal().sqrt()
        return covariance / deviation / deviation[:, None]

    @property
    def deviations(self) -> dict[str, float]:
        """Relative standard deviation to expect of each parameter, all being estimated; inf where nothing is known."""
        return {each.name: each.deviation for each in self.verdicts()}

    def alike(self) -> list[tuple[str, str, float]]:
        """Return pairs of parameters, an effect's among them, that are hardly distinguished, and their correlation."""
        correlation = self.correlation.tolist()
        return [
            (self.names[i], self.names[j], correlation[i][j])
            for i, j in itertools.combinations(range(len(self.names)), 2)
            if abs(correlation[i][j]) > ALIKE and (is_effect(self.names[i]) or is_effect(self.names[j]))
        ]

    def verdicts(self) -> list[Verdict]:
        """Judge every parameter."""
        return [self._verdict(index) for index in range(len(self.names))]

    def to_mapping(self) -> dict[str, Any]:
        """Return everything as plain values; what is infinite is None."""
        return {
            "parameters": list(self.names),
            "accept": self.accept,
            "singular_values": self.singular_values,
            "directions": self._spectrum()[2].T.tolist(),
            "condition": _plain(self.condition),
            "correlation": self.correlation.tolist(),
            "information": self.information.tolist(),
            "verdicts": {
                each.name: {
                    "kind": each.kind,
                    "deviation": _plain(each.deviation),
                    "alone": _plain(each.alone),
                    "combination": each.combination,
                    "combined": each.combined,
                }
                for each in self.verdicts()
            },
        }

    def table(self) -> str:
        """Return what a reader wants to know, as lines of text."""
        width = max(9, *map(len, self.names))
        lines = [f"{'parameter':<{width}}  {'expected':>10}  {'if alone':>10}  verdict"]
        for each in self.verdicts():
            shown = f"{percent(each.deviation):>10}  {percent(each.alone):>10}"
            lines.append(f"{each.name:<{width}}  {shown}  {each.words}")
        lines += ["", f"{'singular value':<14}  {'known to':>10}  combination"]
        for value, spread, direction in zip(*map(torch.Tensor.tolist, self.transposed()), strict=True):
            lines.append(f"{value:<14.4g}  {percent(spread):>10}  {self._product(torch.tensor(direction))}")
        lines.append("")
        for i, j in itertools.combinations(range(len(self.names)), 2):
            correlation = float(self.correlation[i, j])
            lines.append(f"correlation of {self.names[i]} and {self.names[j]}: {correlation:+.4f}")
        condition = "infinite" if math.isinf(self.condition) else f"{self.condition:.4g}"
        return "\n".join([*lines, f"condition number: {condition}"])

    def transposed(self) -> tuple[Tensor, Tensor, Tensor]:
        """Return singular values (P,), deviations (P,), and the combinations that they belong to as rows (P, P)."""
        values, spread, directions = self._spectrum()
        return values, spread, directions.T

    def _verdict(self, index: int) -> Verdict:
        name, (values, spread, directions) = self.names[index], self._spectrum()
        share, lost = directions[index], torch.isinf(spread)
        squares = torch.where(lost, torch.zeros_like(spread), share * spread).square()
        open_ended = bool((lost & (share.abs() > OVERLAP)).any())
        deviation = math.inf if open_ended else math.sqrt(float(squares.sum()))
        strength = math.sqrt(float(self.information[index, index]))
        alone = 1 / strength if strength > FLOOR * float(values[0]) else math.inf
        trusted = alone / CANCELLED
        if deviation <= min(self.accept, trusted):
            return Verdict(name, "identified", deviation, alone)
        known = (spread <= self.accept) & (spread * share.abs() <= trusted)
        if alone > self.accept or not bool(known.any()):
            return Verdict(name, "unobservable", deviation, alone)
        exponents = directions[:, known] @ share[known]
        largest = float(exponents.abs().max())
        combined = math.sqrt(float(squares[known].sum())) / largest
        return Verdict(name, "combination", deviation, alone, self._product(exponents / largest), combined)

    def _spectrum(self) -> tuple[Tensor, Tensor, Tensor]:
        """Return singular values, largest first, the deviations they stand for, and their directions as columns."""
        squares, directions = torch.linalg.eigh(self.information)
        values, directions = squares.flip(0).clamp_min(0).sqrt(), directions.flip(1)
        largest = directions.gather(0, directions.abs().argmax(0, keepdim=True))
        spread = torch.where(values > FLOOR * values[0], values.reciprocal(), torch.full_like(values, math.inf))
        return values, spread, directions * largest.sign()

    def _product(self, exponents: Tensor) -> str:
        """Write a direction in ln(parameter) as a product of powers, the largest first."""
        order = exponents.abs().argsort(descending=True).tolist()
        kept = [place for place in order if abs(float(exponents[place])) >= FAINT]
        return " * ".join(_power(self.names[place], float(exponents[place])) for place in kept)


def percent(deviation: float) -> str:
    """Write a relative standard deviation."""
    return f"{100 * deviation:.2g} %" if deviation < NOTHING else "unbounded"


def _power(name: str, exponent: float) -> str:
    shown = f"{exponent:.2f}"
    return name if shown == "1.00" else f"{name}^{shown}"


def _plain(value: float) -> float | None:
    return value if math.isfinite(value) else None
