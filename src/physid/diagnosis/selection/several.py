"""Several effects: combinations of one more than the best has, and exchanges of their effects."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from itertools import combinations

import torch

from physid.diagnosis.progress import Progress
from physid.diagnosis.reference.nominal_fit import NominalFit
from physid.diagnosis.selection.comparison import Names, by_prediction, compare_candidates
from physid.diagnosis.selection.evidence import all_needed, explained, least_gain
from physid.diagnosis.settings.testing import ScoreTestSettings
from physid.diagnosis.testing import (
    Hypothesis,
    LackOfFit,
    ScoreTest,
    begin_hypothesis,
    find_lack_of_fit,
    finish_hypothesis,
    gains,
    joined,
    score_test_of,
    twins,
)
from physid.estimation.least_squares import Fit
from physid.physics import SolverError


class Fitted:
    """Hypotheses that are fitted; a combination of more effects begins at what it holds of them.

    Far from the nominal model a line from there leads nowhere. Beside effects that are fitted, one alone is new.

    Args:
        nominal: The model without effects.
        start: Its fit, linearised with all effects.
        known: Fitted hypotheses.
    """

    def __init__(self, nominal: Hypothesis, start: Fit, known: Sequence[Hypothesis]) -> None:
        self.nominal = nominal
        self.known = {frozenset(one.names): one for one in known}
        self._start = start
        self._tests: dict[frozenset[str], ScoreTest] = {}

    def test(self, one: Hypothesis) -> ScoreTest:
        """Return the score test beside a hypothesis."""
        names = frozenset(one.names)
        if names not in self._tests:
            self._tests[names] = score_test_of(one)
        return self._tests[names]

    def begin(self, names: Names) -> Hypothesis:
        """Fit a combination for a few steps, from the hypothesis of most effects that it holds and that predicts best.

        Raises:
            SolverError: If it cannot be simulated.
        """
        held = [one for own, one in self.known.items() if own < {*names}]
        if not held:
            return begin_hypothesis(self.nominal.experiment, self._start, names, self.nominal.settings)
        base = min(held, key=lambda one: (-len(one.names), float(one.held_out.sum())))
        return begin_hypothesis(base.experiment, self.test(base).fit, names, base.settings)

    def without(self, one: Hypothesis) -> Iterator[Hypothesis]:
        """Fit a combination without each of its effects, where that can be simulated and is not known yet."""
        for names in combinations(one.names, len(one.names) - 1):
            with suppress(SolverError):
                if frozenset(names) not in self.known:
                    self.known[frozenset(names)] = finish_hypothesis(self.begin(names))
                yield self.known[frozenset(names)]

    def exchanges(self, one: Hypothesis, tried: Collection[frozenset[str]], most: int) -> list[Names]:
        """Return what a combination becomes if one effect is exchanged for another, most explained first.

        Two effects that act together can look like a third, which then stands where one of them belongs. Beside the
        other effects alone the score test shows the right one; at the nominal model, far from all of them, it may not.

        Args:
            one: The combination.
            tried: Combinations that are left out.
            most: At most so many are returned.
        """
        found: dict[Names, float] = {}
        for base in self.without(one):
            counts = base.experiment.fitted[base.experiment.predictor.segments.trajectory]
            left = float(base.fit.loss[counts].sum())
            for row in self.test(base).observed()[1]:
                names = tuple(sorted((*base.names, *row.names)))
                found[names] = max(found.get(names, -math.inf), row.gain - left)
        fresh = (names for names in found if frozenset(names) not in tried)
        return sorted(fresh, key=lambda names: -found[names])[:most]


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


def leaves(nominal: Hypothesis, best: Hypothesis, lack: LackOfFit, left: LackOfFit, least: float) -> bool:
    """Return whether the best leaves enough to look for one effect more: more than what it must gain at least.

    Args:
        nominal: The model without effects.
        best: The effects found.
        lack: What the model without effects leaves.
        left: What the best leaves.
        least: What one effect more must gain by frame.
    """
    settings = nominal.settings
    if left.p_value > settings.evidence.alpha:
        return False
    return left.missing > max(least * left.frames, settings.attribution.further * explained(nominal, best, lack))


def of_one_more(
    nominal_fit: NominalFit,
    nominal: Hypothesis,
    lack: LackOfFit,
    tried: list[Hypothesis],
    left: LackOfFit,
    generator: torch.Generator,
    say: Progress,
) -> list[Hypothesis]:
    """Fit combinations of one effect more than the best of what was tried.

    As long as the best of them leaves something, or not all of its effects are needed, one of its effects is exchanged,
    at most as many times as it has effects.

    Returns:
        Those of which all effects are needed.
    """
    best, settings = tried[0], nominal_fit.settings
    fits, least = Fitted(nominal, lack.fit, tried), least_gain(nominal_fit)

    def closes(one: Hypothesis) -> bool:
        with suppress(SolverError):
            return not leaves(nominal, one, lack, find_lack_of_fit(nominal_fit, one, generator), least)
        return False

    def needed(one: Hypothesis) -> bool:
        return all_needed(one, nominal, [*fits.known.values()], left, least, generator)

    most = settings.candidates.most_combinations
    ranked = one_more(lack, best.names, settings.score_test)
    fitted = compare_candidates(first_combinations(ranked, best, left, most), fits.begin, best, say)
    for _ in range(len(best.names) + 1 if fitted and settings.candidates.exchanged else 0):
        first = fitted[0]
        if needed(first) and closes(first):
            break
        names = fits.exchanges(first, {frozenset(one.names) for one in fitted}, most)
        fitted = by_prediction([*fitted, *compare_candidates(names, fits.begin, best, say)])
        if fitted[0] is first:
            break
    return [one for one in fitted if needed(one)]


def with_twins(lack: LackOfFit, nominal: Hypothesis, tried: list[Hypothesis], say: Progress) -> list[Hypothesis]:
    """Fit what several effects become if one is exchanged for another with its signature; best predictions first.

    Laws that start alike, such as a lag and a delay, are distinguished by their fits alone.
    """
    best = tried[0]
    if len(best.names) == 1:
        return tried
    known = {frozenset(one.names) for one in tried}
    exchanged = (tuple(sorted({*best.names} - {part} | {rival})) for part, rival in twins(lack, best, tried))
    names = [each for each in dict.fromkeys(exchanged) if frozenset(each) not in known]
    return by_prediction([*tried, *compare_candidates(names, Fitted(nominal, lack.fit, tried).begin, best, say)])
