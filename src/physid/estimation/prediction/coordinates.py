"""Coordinates in which parameters are fitted: logarithms of what is positive, sizes of effects in typical ones."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import torch
from torch import Tensor

from physid.effects import find, from_values, known_effects
from physid.estimation.prediction.effect_parameters import EffectParameter
from physid.physics import Effect
from physid.scenes import Scene
from physid.scenes.parameters import highest_value, unit_of
from physid.scenes.scene import HIGHEST_RESTITUTION
from physid.strict import nearest, quoted

Kind = Literal["logarithm", "linear"]
LEARNED = "learned"
"""Where a checkpoint keeps the names of what it has learned: its coordinates are numbers without names."""
SMALLEST = 1e-6
FARTHEST = 14.0
"""Largest logarithm, and minus the smallest, that is told from others."""
FIRST_GUESS = 0.1
"""Size of an effect, as a share of its typical one, with which a fit begins: near the nominal model, and not at it."""


@dataclass(frozen=True)
class Unknown:
    """One parameter that is fitted.

    Attributes:
        name: Of a body (block.friction), or of an effect (viscous_drag.coefficient).
        unit: Its unit; "" for a pure number.
        kind: Whether its coordinate is its logarithm, or linear: (value - null) / scale.
        low: Least value that is possible.
        high: Largest.
        scale: Unit of a linear coordinate: the typical size of an effect.
        null: Value at which a linear coordinate is zero.
    """

    name: str
    unit: str
    kind: Kind
    low: float
    high: float
    scale: float = 1.0
    null: float = 0.0

    @classmethod
    def of(cls, name: str, *, logarithmic: bool = True) -> Unknown:
        """Describe a parameter by its name.

        Args:
            name: Of a body or an effect.
            logarithmic: Whether a restitution is fitted as a logarithm too, and therefore never zero.
        """
        if is_effect(name):
            known = parameter_of_effect(name).quantity
            size, unit = known.typical - known.null, "" if known.unit == "-" else known.unit
            return cls(name, unit, "linear", known.low, known.high, size, known.null)
        if name.endswith(".restitution") and not logarithmic:
            return cls(name, "", "linear", 0.0, HIGHEST_RESTITUTION)
        return cls(name, unit_of(name), "logarithm", 0.0, highest_value(name))

    def coordinate(self, value: float) -> float:
        """Return the coordinate of a value, infinite at an end that no coordinate reaches."""
        if self.kind == "linear":
            return (value - self.null) / self.scale
        return math.log(value) if value > 0 else -math.inf


@dataclass(frozen=True)
class Coordinates:
    """The coordinates of P parameters, (..., P), and what they stand for."""

    unknowns: tuple[Unknown, ...]

    @classmethod
    def of(cls, names: Iterable[str], *, logarithmic: bool = True) -> Coordinates:
        """Describe parameters by their names (see `Unknown.of`)."""
        return cls(tuple(Unknown.of(name, logarithmic=logarithmic) for name in names))

    def to_coordinates(self, values: Tensor) -> Tensor:
        """Return the coordinates of values; a logarithm has a value of `SMALLEST` at least."""
        linear, scale, null = self._like(values)
        return torch.where(linear, (values - null) / scale, values.clamp_min(SMALLEST).log())

    def to_values(self, coordinates: Tensor) -> Tensor:
        """Invert `to_coordinates`; beyond an end of its range every value is that of the end."""
        linear, scale, null = self._like(coordinates)
        inside = self.within(coordinates)
        return torch.where(linear, null + scale * inside, inside.clamp(-FARTHEST, FARTHEST).exp())

    def slopes(self, coordinates: Tensor) -> Tensor:
        """Return d value / d coordinate."""
        linear, scale, _ = self._like(coordinates)
        return torch.where(linear, scale.expand_as(coordinates), self.to_values(coordinates))

    def within(self, coordinates: Tensor) -> Tensor:
        """Bring what lies beyond the range of a parameter back to the end of it."""
        low, high = (end.to(coordinates) for end in self.ends)
        return coordinates.clamp(low, high)  # with a slope of 1 at the ends themselves

    @cached_property
    def ends(self) -> tuple[Tensor, Tensor]:
        """The coordinates of the least and the largest values, (P,) each; of a logarithm -inf at least."""
        ends = [[one.coordinate(value) for value in (one.low, one.high)] for one in self.unknowns]
        low, high = torch.tensor(ends, dtype=torch.float64).reshape(-1, 2).unbind(1)
        return low, high

    def _like(self, reference: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return which are linear, their scales and nulls."""
        linear, scale, null = self._known
        return linear.to(reference.device), scale.to(reference), null.to(reference)

    @cached_property
    def _known(self) -> tuple[Tensor, Tensor, Tensor]:
        linear = torch.tensor([one.kind == "linear" for one in self.unknowns], dtype=torch.bool)
        scale, null = (
            torch.tensor([getattr(one, name) for one in self.unknowns], dtype=torch.float64)
            for name in ("scale", "null")
        )
        return linear, scale, null


def is_effect(name: str) -> bool:
    """Return whether a parameter is named after an effect that is known."""
    return name.partition(".")[0] in {effect.name for effect in known_effects()}


def parameter_of_effect(name: str) -> EffectParameter:
    """Find the parameter of an effect by its name, say viscous_drag.coefficient.

    Raises:
        ValueError: If there is none; the message names the nearest.
    """
    owner, _, parameter = name.partition(".")
    effect = find(owner)
    if parameter not in effect.quantities():
        known = [f"{owner}.{each}" for each in effect.quantities()]
        raise ValueError(f"unknown parameter {quoted(name)}{nearest(name, known)}; known are {', '.join(known)}")
    return EffectParameter(effect, parameter)


def sorted_out(names: Iterable[str], scene: Scene) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Tell parameters of bodies from those of effects, each in their order.

    Raises:
        ValueError: If there is no such parameter, where the message names the nearest, or one is named twice.
    """
    bodies, effects = [], []
    for name in names:
        if is_effect(str(name)):
            effects.append(parameter_of_effect(str(name)).label)
            continue
        try:
            scene.locate(name)
        except ValueError as error:
            word = str(name).rpartition(".")[2]
            alike = [
                f"{each.name}.{size}"
                for each in known_effects()
                if word in each.name.split("_")
                for size in each.quantities()
            ]
            others = (
                "`physid effects` lists the effects that can be learned too; those of your own need --allow FILE.py"
            )
            hint = f"an effect is learned by its own name, here {', '.join(alike)}" if alike else others
            raise ValueError(f"{error}; {hint}") from None
        bodies.append(name)
    if twice := {str(name) for names in (bodies, effects) for name in names if names.count(name) > 1}:
        raise ValueError(f"learn: {', '.join(sorted(twice))} is named twice; name it once")
    return tuple(bodies), tuple(effects)


def with_first_sizes(
    known: Mapping[str, Mapping[str, float]], learned: Iterable[str], given: Mapping[str, float]
) -> tuple[Effect, ...]:
    """Return the effects at work, those that are learned at their first guesses.

    Args:
        known: Values of the parameters of effects that are at work, by the names of the effects.
        learned: Parameters that are learned ("viscous_drag.coefficient").
        given: First guesses of such; others are as they are known, or `FIRST_GUESS` of what is typical.

    Raises:
        ValueError: If an effect or a parameter of it does not exist, or a value is beyond its range.
    """
    values = {name: dict(own) for name, own in known.items()}
    for label in learned:
        one, (name, _, key) = parameter_of_effect(label).quantity, label.partition(".")
        guess = values.get(name, {}).get(key, one.null + FIRST_GUESS * (one.typical - one.null))
        values.setdefault(name, {})[key] = given.get(label, guess)
    return tuple(from_values(name, own) for name, own in values.items())


def logged_name(key: str) -> tuple[str, str] | None:
    """Return parameter and word of a figure `params/PARAMETER/WORD`, say estimate; None of every other figure.

    The name of a body may hold a slash, so that a key is read from its end.
    """
    name, _, word = key.removeprefix("params/").rpartition("/")
    return (name, word) if key.startswith("params/") and name else None


def logged_names(figures: Iterable[str], word: str) -> list[str]:
    """Return the parameters of which `params/PARAMETER/word` is among figures, sorted."""
    return sorted({found[0] for key in figures if (found := logged_name(key)) and found[1] == word})


def correlated_names(key: str) -> tuple[str, str]:
    """Return the two parameters of a figure `correlation/ONE/OTHER`: one ends with the word after its full stop."""
    both = key.removeprefix("correlation/")
    found = re.fullmatch(r"([^.]*\.[^/]*)/(.*)", both, re.DOTALL)
    one, _, other = both.partition("/")
    return (found[1], found[2]) if found else (one, other)
