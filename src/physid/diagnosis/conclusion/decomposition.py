"""How the gap divides among effects: what each closes alone and beside the others, on trajectories held out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations, permutations
from math import factorial

import torch

from physid.diagnosis.conclusion.closings import BySplit, Kinds, closings_of
from physid.diagnosis.conclusion.gap import Closing
from physid.diagnosis.document.document import Split
from physid.diagnosis.reference.nominal_fit import NominalFit
from physid.diagnosis.selection.contact_free import refit_all_segments
from physid.diagnosis.selection.search import Attribution
from physid.diagnosis.testing import Hypothesis, begin_hypothesis, finish_hypothesis
from physid.physics import SolverError


def decompose(
    nominal_fit: NominalFit,
    found: Attribution,
    together: BySplit,
    kinds: Kinds,
    generator: torch.Generator,
) -> dict[Split, dict[str, float]]:
    """Divide the share of the gap that closes among the effects that are blamed.

    With v(S) the share that the effects S close together, an effect adds v(S + A) - v(S) where it comes after S. Its
    part is the mean over all orders (Shapley 1953); parts add up to what all close. Each choice of effects is refitted
    for that.

    Args:
        nominal_fit: The recordings and the fitted nominal model.
        found: What the search found; its best hypothesis is blamed.
        together: How far the gap closes with all effects.
        kinds: By what the gap is seen on each split, positions or rotations.
        generator: Randomness of intervals, which are not used here.

    Returns:
        The part of each effect, by split; empty where there is no gap to divide, and where a choice of effects cannot
        be simulated.
    """
    best = found.best
    whole = {split: one.shrink.value for split, one in together.items() if one is not None and one.shrink is not None}
    if best is None or not whole:
        return {}
    closed: dict[frozenset[str], BySplit] = {}
    for some in (chosen for size in range(1, len(best.names)) for chosen in combinations(best.names, size)):
        fitted = _of_effects(nominal_fit, found, some)
        if fitted is None:
            return {}
        made = {
            kind: closings_of(nominal_fit, found.whole_nominal, fitted, generator, kind)
            for kind in dict.fromkeys(kinds.values())
        }
        closed[frozenset(some)] = {split: made[kind][split] for split, kind in kinds.items()}
    return {
        split: shapley(
            {some: _value(one[split]) for some, one in closed.items()} | {frozenset(best.names): share}, best.names
        )
        for split, share in whole.items()
    }


def shapley(values: Mapping[frozenset[str], float], names: Sequence[str]) -> dict[str, float]:
    """Return the part of each, the mean over all orders of what it adds to those before it.

    phi_A = sum over S without A of |S|! (n - |S| - 1)! / n! (v(S + A) - v(S)), with v of nobody 0.

    Args:
        values: v of each choice of names but the empty one.
        names: All n names.
    """
    parts = dict.fromkeys(names, 0.0)
    for order in permutations(names):
        before = 0.0
        for count, name in enumerate(order, 1):
            after = values[frozenset(order[:count])]
            parts[name] += (after - before) / factorial(len(names))
            before = after
    return parts


def _value(one: Closing | None) -> float:
    return 0.0 if one is None or one.shrink is None else one.shrink.value


def _of_effects(nominal_fit: NominalFit, found: Attribution, names: Sequence[str]) -> Hypothesis | None:
    """Return the hypothesis of some of the effects, in all segments; None where it cannot be simulated."""
    try:
        experiment, settings = found.nominal.experiment, nominal_fit.settings
        tried = next((one for one in found.tried if {*one.names} == {*names}), None)
        fitted = tried or finish_hypothesis(begin_hypothesis(experiment, found.lack.fit, tuple(names), settings))
        return refit_all_segments(nominal_fit, fitted) if found.contact_free else fitted
    except SolverError:
        return None
