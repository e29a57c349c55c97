"""How far the gap closes on each part of the recordings that nothing was fitted to, in positions and in rotations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import torch

from physid.diagnosis.conclusion.gap import (
    POSITION,
    ROTATION,
    Closing,
    clearer,
    closing,
    errors_of,
    floor_of,
    floors_of,
    held_out_parts,
    values_of,
)
from physid.diagnosis.document.document import Allowed, Errors, Gap, Impacts, Rotations, Share, Shrink, Split
from physid.diagnosis.reference.nominal_fit import NominalFit
from physid.diagnosis.selection.materiality import Tolerance, tolerance_of, unexplained_impacts
from physid.diagnosis.testing import Hypothesis
from physid.estimation.measurement import Noise

BySplit = Mapping[Split, Closing | None]
Kinds = Mapping[Split, int]
"""What shows the gap on each split: positions or rotations."""


@dataclass(frozen=True)
class Closings:
    """How far the gap closes on each split; None where a split has no trajectories.

    Attributes:
        positions: By errors of positions.
        rotations: By errors of rotations.
        kinds: Which of the two shows the gap.
    """

    positions: BySplit
    rotations: BySplit
    kinds: Kinds

    @property
    def seen(self) -> BySplit:
        """How far the gap closes by that which shows it."""
        made = {POSITION: self.positions, ROTATION: self.rotations}
        return {split: made[kind][split] for split, kind in self.kinds.items()}

    def unclosed(self) -> Closings:
        """Return the errors before alone, of positions: what is said where nothing is blamed."""
        positions, rotations = (
            {split: None if one is None else replace(one, after=None, shrink=None) for split, one in made.items()}
            for made in (self.positions, self.rotations)
        )
        return Closings(positions, rotations, dict.fromkeys(self.kinds, POSITION))


def compare(
    nominal_fit: NominalFit,
    nominal: Hypothesis,
    best: Hypothesis | None,
    generator: torch.Generator,
    kinds: Kinds | None = None,
) -> Closings:
    """Compare errors before and after, of positions and of rotations, whose intervals come from the same draws.

    Args:
        nominal_fit: The recordings.
        nominal: The model without effects.
        best: With effects; None where there are none.
        generator: Of the intervals' bootstrap.
        kinds: What shows the gap on each split; None for what shows it more clearly here.
    """
    same_draws = torch.Generator().set_state(generator.get_state())
    positions = closings_of(nominal_fit, nominal, best, generator)
    rotations = closings_of(nominal_fit, nominal, best, same_draws, ROTATION)
    if kinds is None:
        allowed = tolerance_of(nominal_fit)
        kinds = {split: clearer(one, rotations[split], allowed) for split, one in positions.items()}
    return Closings(positions, rotations, kinds)


def closings_of(
    nominal_fit: NominalFit,
    nominal: Hypothesis,
    best: Hypothesis | None,
    generator: torch.Generator,
    kind: int = POSITION,
) -> dict[Split, Closing | None]:
    """Compare errors before and after on each part of the recordings that nothing was fitted to.

    Args:
        nominal_fit: The recordings.
        nominal: The model without effects.
        best: With effects; None where there are none.
        generator: Of the intervals' bootstrap.
        kind: Of positions, or of rotations.
    """
    before = errors_of(nominal, kind)
    after = before if best is None else errors_of(best, kind)
    floors = floors_of(nominal.experiment, nominal_fit.noise, kind)
    values = values_of(nominal.experiment, kind)
    parts = held_out_parts(nominal_fit.observations)
    return {
        name: closing(before, after, floors, values, chosen, nominal_fit.settings.gap, generator)
        for name, chosen in parts.items()
    }


def describe_gap(closings: Closings, allowed: Tolerance, noise: Noise, impacts: Impacts | None) -> Gap:
    """Give the errors before and after on each split; of rotations as well where these show the gap more clearly."""
    (same, transfer), kinds = _errors(closings.positions), closings.kinds
    assert same is not None
    turned = _errors({split: one if kinds[split] == ROTATION else None for split, one in closings.seen.items()})
    rotations = Rotations(floor_of(noise, ROTATION), *turned) if any(turned) else None
    limits = Allowed(allowed.position, allowed.rotation)
    return Gap("m", floor_of(noise), limits, same, transfer, rotations, impacts)


def describe_impacts(nominal_fit: NominalFit, shown: Hypothesis | None) -> Impacts | None:
    """Give what is left at impacts, where many of them are not explained, and how many are not with effects."""
    left = nominal_fit.unexplained_events
    if left is None:
        return None
    after = None if shown is None else int(unexplained_impacts(nominal_fit, shown).sum())
    return Impacts(**vars(left), with_effects=after)


def describe_shrink(closings: Closings, parts: dict[Split, dict[str, float]]) -> Shrink:
    """Give the share of the gap that closes on each split, and the parts of the effects in it."""
    return Shrink(_share(closings.seen["same"]), _share(closings.seen["transfer"]), parts)


def _errors(closings: BySplit) -> list[Errors | None]:
    return [None if one is None else Errors(one.before, one.after) for one in closings.values()]


def _share(one: Closing | None) -> Share | None:
    return None if one is None or one.shrink is None else Share(one.shrink.value, one.shrink.low, one.shrink.high)
