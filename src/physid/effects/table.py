"""The catalogue as a table."""

from __future__ import annotations

import inspect
from dataclasses import dataclass

from physid.physics import Effect


@dataclass(frozen=True)
class Row:
    """One parameter of one effect, in words.

    Attributes:
        name: The effect.
        site: actuation, dynamics, contact or perception.
        formula: First line of the effect's docstring.
        parameter: The parameter.
        unit: Its unit.
        range: Its lowest and highest value.
        null: The value at which the effect does nothing.
        typical: A size that is typical in practice.
    """

    name: str
    site: str
    formula: str
    parameter: str
    unit: str
    range: str
    null: str
    typical: str


def rows_of(effect: type[Effect]) -> list[Row]:
    """Describe an effect, one row for each parameter."""
    formula = (inspect.getdoc(effect) or "").partition("\n")[0]
    return [
        Row(
            name=effect.name,
            site=effect.site,
            formula=formula,
            parameter=name,
            unit=quantity.unit,
            range=f"{quantity.low:g} to {quantity.high:g}",
            null=f"{quantity.null:g}",
            typical=f"{quantity.typical:g}",
        )
        for name, quantity in effect.quantities().items()
    ]
