"""How the gap divides among effects: what each closes alone and beside the others, on trajectories held out."""

from __future__ import annotations

from collections.abc import Mapping

import torch

from physid.diagnosis.conclusion.gap import (
    Closing,
    closing,
    held_out_parts,
    position_errors,
    position_floors,
    position_values,
)
from physid.diagnosis.document.document import Split
from physid.diagnosis.reference.nominal_fit import NominalFit
from physid.diagnosis.selection.attribution import Attribution
from physid.diagnosis.selection.contact_free import refit_all_segments
from physid.diagnosis.testing import Hypothesis, begin_hypothesis, finish_hypothesis
from physid.physics import SolverError

Closings = Mapping[Split, Closing | None]


def closings_of(
    nominal_fit: NominalFit, nominal: Hypothesis, best: Hypothesis | None, generator: torch.Generator
) -> dict[Split, Closing | None]:
    """Compare errors before and after on each part of the recordings that nothing was fitted to."""
    before = position_errors(nominal, nominal_fit.observations)
    after = before if best is None else position_errors(best, nominal_fit.observations)
    floors = position_floors(nominal.experiment, nominal_fit.noise)
    values = position_values(nominal.experiment)
    parts = held_out_parts(nominal_fit.observations)
    return {
        name: closing(before, after, floors, values, chosen, nominal_fit.settings.gap, generator)
        for name, chosen in parts.items()
    }


def decompose(
    nominal_fit: NominalFit, found: Attribution, together: Closings, generator: torch.Generator
) -> dict[Split, dict[str, float]]:
    """Divide the share of the gap that closes among the effects that are blamed.

    With v(A) the share that A closes alone and v(AB) that of both, A closes v(A) if it comes first and v(AB) - v(B) if
    it comes last. Its part is the mean of the two (Shapley 1953); the parts of both add up to v(AB). Each effect is
    refitted alone for that.

    Args:
        nominal_fit: The recordings and the fitted nominal model.
        found: What the search found; its best hypothesis is blamed.
        together: How far the gap closes with all effects.
        generator: Randomness of intervals, which are not used here.

    Returns:
        The part of each effect, by split; empty where there is no gap to divide, where an effect alone cannot be
        simulated, and for more than two effects.
    """
    best = found.best
    whole = {split: one.shrink.value for split, one in together.items() if one is not None and one.shrink is not None}
    if best is None or not whole:
        return {}
    if len(best.names) == 1:
        return {split: {best.names[0]: share} for split, share in whole.items()}
    alone = [_alone(nominal_fit, found, name) for name in best.names]
    if len(alone) != 2 or None in alone:
        return {}
    one, other = (closings_of(nominal_fit, found.whole_nominal, each, generator) for each in alone)
    return {
        split: dict(zip(best.names, shapley(_value(one[split]), _value(other[split]), share), strict=True))
        for split, share in whole.items()
    }


def shapley(one: float, other: float, both: float) -> tuple[float, float]:
    """Return the parts of two that close so much alone, and together: the means over the two orders."""
    return (one + both - other) / 2, (other + both - one) / 2


def _value(one: Closing | None) -> float:
    return 0.0 if one is None or one.shrink is None else one.shrink.value


def _alone(nominal_fit: NominalFit, found: Attribution, name: str) -> Hypothesis | None:
    """Return the hypothesis of one effect of a pair, in all segments; None where it cannot be simulated."""
    try:
        experiment, settings = found.nominal.experiment, nominal_fit.settings
        tried = next((one for one in found.tried if one.names == (name,)), None)
        alone = tried or finish_hypothesis(begin_hypothesis(experiment, found.lack.fit, (name,), settings))
        return refit_all_segments(nominal_fit, alone) if found.contact_free else alone
    except SolverError:
        return None
