"""Several effects: combinations of one more than the best has, and exchanges of their effects."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from itertools import combinations

import torch

from physid.diagnosis.progress import Progress
from physid.diagnosis.reference.nominal_fit import NominalFit
from physid.diagnosis.selection.comparison import Names, by_prediction, compare_candidates
from physid.diagnosis.selection.evidence import all_needed, explained
from physid.diagnosis.settings.testing import ScoreTestSettings
from physid.diagnosis.testing import (
    Hypothesis,
    LackOfFit,
    begin_hypothesis,
    find_lack_of_fit,
    finish_hypothesis,
    gains,
    joined,
    score_test_of,
)
from physid.estimation.least_squares import Experiment, Fit
from physid.physics import SolverError

Start = tuple[Experiment, Fit]
"""What is explained, and a fit of it that is linearised with all effects."""


def one_more(lack: LackOfFit, best: Names, settings: ScoreTestSettings) -> list[Names]:
    """Return combinations of one effect more than the best has, those with the largest linear gain first.

    They are made of effects that are significant alone, and share all effects of the best with it, or all but one.
    """
    alone = {row.names[0] for row in lack.significant}
    groups = [group for group in lack.groups if group.names[0] in alone]
    joint = {
        tuple(sorted(group.names[0] for group in chosen)): chosen
        for chosen in combinations(groups, len(best) + 1)
        if len({*best} & {group.names[0] for group in chosen}) >= len(best) - 1
    }
    gained = {names: float(gains(lack.conditional, joined(chosen), settings)[0]) for names, chosen in joint.items()}
    return sorted(gained, key=lambda names: -gained[names])


def first_combinations(ranked: list[Names], best: Hypothesis, left: LackOfFit, most: int) -> list[Names]:
    """Return at most so many: half of them the best with an effect that it leaves, half the first by linear gain."""
    further = (tuple(sorted((*best.names, row.names[0]))) for row in left.significant)
    with_best = [names for names in further if names in ranked][: most // 2]
    chosen = [*with_best, *(names for names in ranked if names not in with_best)]
    return chosen[:most]


def exchanges(without: Sequence[Hypothesis], tried: Collection[frozenset[str]], most: int) -> dict[Names, Start]:
    """Return combinations that a combination becomes if one effect is exchanged for another, most explained first.

    Two effects that act together can look like a third, which then stands where one of them belongs. Beside the other
    effects alone the score test shows the right one; at the nominal model, far from all of them, it may not.

    Args:
        without: The combination without each of its effects, fitted.
        tried: Combinations that are known.
        most: At most so many are returned.

    Returns:
        Their names, with the experiment and the fit without the exchanged effect, linearised with all effects.
    """
    found: list[tuple[float, Names, Hypothesis, Fit]] = []
    for base in without:
        test = score_test_of(base)
        left = float(base.fit.loss[base.experiment.fitted[base.experiment.predictor.segments.trajectory]].sum())
        rows = test.observed()[1]
        found += [(row.gain - left, tuple(sorted((*base.names, *row.names))), base, test.fit) for row in rows]
    starts: dict[Names, Start] = {}
    for _, names, base, fit in sorted(found, key=lambda one: -one[0]):
        if frozenset(names) not in tried and len(starts) < most:
            starts.setdefault(names, (base.experiment, fit))
    return starts


def leaves(nominal: Hypothesis, best: Hypothesis, lack: LackOfFit, left: LackOfFit) -> bool:
    """Return whether the best leaves enough to look for one effect more."""
    settings = nominal.settings
    if left.p_value > settings.evidence.alpha:
        return False
    return left.missing > settings.attribution.further * explained(nominal, best, lack)


def of_one_more(
    nominal_fit: NominalFit,
    nominal: Hypothesis,
    lack: LackOfFit,
    fewer: list[Hypothesis],
    left: LackOfFit,
    generator: torch.Generator,
    say: Progress,
) -> list[Hypothesis]:
    """Fit combinations of one effect more than the best of `fewer`.

    As long as the best of them leaves something, or not all of its effects are needed, one of its effects is exchanged,
    at most as many times as it has effects.

    Returns:
        Those of which all effects are needed.
    """
    best, settings, experiment = fewer[0], nominal_fit.settings, nominal_fit.experiment
    known = {frozenset(one.names): one for one in fewer}
    starts: dict[Names, Start] = {}

    def begin(names: Names) -> Hypothesis:
        beside = (best.experiment, left.fit) if set(best.names) < set(names) else (experiment, lack.fit)
        one, start = starts.get(names, beside)
        return begin_hypothesis(one, start, names, settings)

    def closes(one: Hypothesis) -> bool:
        with suppress(SolverError):
            return not leaves(nominal, one, lack, find_lack_of_fit(nominal_fit, one, generator))
        return False

    def without(one: Hypothesis) -> Iterator[Hypothesis]:
        for names in combinations(one.names, len(one.names) - 1):
            with suppress(SolverError):
                if frozenset(names) not in known:
                    known[frozenset(names)] = finish_hypothesis(begin(names))
                yield known[frozenset(names)]

    most = settings.candidates.most_combinations
    ranked = one_more(lack, best.names, settings.score_test)
    fitted = compare_candidates(first_combinations(ranked, best, left, most), begin, best, say)
    for _ in range(len(best.names) + 1 if fitted and settings.candidates.exchanged else 0):
        first = fitted[0]
        if all_needed(first, nominal, [*known.values()], left) and closes(first):
            break
        starts = exchanges([*without(first)], {frozenset(one.names) for one in fitted}, most)
        fitted = by_prediction([*fitted, *compare_candidates([*starts], begin, best, say)])
        if fitted[0] is first:
            break
    return [more for more in fitted if all_needed(more, nominal, [*known.values()], left)]
