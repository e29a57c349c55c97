"""The catalogue of effects that a nominal model may lack."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import torch

from physid.effects import actuation, contact, dynamics, perception
from physid.effects.table import Row, rows_of
from physid.physics import Effect, Quantity
from physid.strict import nearest

CATALOGUE: tuple[type[Effect], ...] = (*actuation.EFFECTS, *dynamics.EFFECTS, *contact.EFFECTS, *perception.EFFECTS)
"""Every effect that ships with physid, by site: actuation, dynamics, contact, perception."""

__all__ = ["CATALOGUE", "Row", "admit", "describe", "find", "from_values", "known_effects"]


_admitted: dict[str, type[Effect]] = {}


def admit(effects: Sequence[type[Effect]]) -> None:
    """Let configurations of this process name effects of a user's own, as they name those of the catalogue."""
    _admitted.update((effect.name, effect) for effect in effects)


def known_effects() -> tuple[type[Effect], ...]:
    """Return the catalogue, and the effects of the user's own that were admitted."""
    return (*CATALOGUE, *_admitted.values())


def find(name: str, among: Sequence[type[Effect]] | None = None) -> type[Effect]:
    """Find an effect by its name.

    Args:
        name: Its name.
        among: Effects to look in; None for those that are known.

    Raises:
        ValueError: If there is none; the message names the nearest.
    """
    known = {effect.name: effect for effect in (known_effects() if among is None else among)}
    if name not in known:
        raise ValueError(
            f'unknown effect "{name}"{nearest(name, list(known))}; `physid effects` lists all; those of a file of your '
            "own need --allow FILE.py"
        )
    return known[name]


def candidates_beside(known: Sequence[Effect], own: Sequence[type[Effect]] = ()) -> list[type[Effect]]:
    """Return the catalogue and effects of one's own, without those that a model knows already."""
    names = {effect.name for effect in known}
    return [kind for kind in (*CATALOGUE, *own) if kind.name not in names]


def from_values(name: str, values: Mapping[str, float], among: Sequence[type[Effect]] | None = None) -> Effect:
    """Build an effect from numbers; parameters that are left out keep their null value.

    Args:
        name: Name of the effect.
        values: Parameters by name, in the units of the catalogue.
        among: Effects to look in; None for those that are known.

    Raises:
        ValueError: If the effect or a parameter does not exist, or a value is not a number within its range.
    """
    effect = find(name, among)
    quantities = effect.quantities()
    for key, value in values.items():
        if key not in quantities:
            raise ValueError(f'effect {name} has no parameter "{key}"{nearest(key, list(quantities))}')
        _check(f"{name}.{key}", value, quantities[key])
    return effect(**{key: torch.tensor([float(value)], dtype=torch.float64) for key, value in values.items()})


def describe(among: Sequence[type[Effect]] = CATALOGUE) -> list[Row]:
    """Describe effects as the rows of a table, one for each parameter."""
    return [row for effect in among for row in rows_of(effect)]


def _check(name: str, value: float, quantity: Quantity) -> None:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"{name} must be a finite number [{quantity.unit}], got {value!r}")
    if not quantity.low <= value <= quantity.high:
        raise ValueError(
            f"{name} must lie between {quantity.low:g} and {quantity.high:g} [{quantity.unit}], got {value:g}; "
            "check its unit"
        )
