"""The parameters of candidate effects: the columns that a fit may free."""

from __future__ import annotations

from dataclasses import dataclass

from physid.physics import Effect, Quantity


@dataclass(frozen=True)
class EffectParameter:
    """One parameter of a candidate effect."""

    effect: type[Effect]
    name: str

    @property
    def label(self) -> str:
        """How it is written: effect.parameter."""
        return f"{self.effect.name}.{self.name}"

    @property
    def quantity(self) -> Quantity:
        """Its unit, range, null value and typical value."""
        return self.effect.quantities()[self.name]
