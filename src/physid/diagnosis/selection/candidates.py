"""Which hypotheses are worth fitting, by what the score test says of them."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from itertools import combinations

from physid.diagnosis.selection.comparison import Names
from physid.diagnosis.settings.settings import Settings
from physid.diagnosis.settings.testing import ScoreTestSettings
from physid.diagnosis.testing import Hypothesis, LackOfFit, Row, cosine, gains, joined, score_test_of
from physid.estimation.least_squares import Experiment, Fit

Start = tuple[Experiment, Fit]
"""What is explained, and a fit of it that is linearised with all effects."""


def survivors(lack: LackOfFit, settings: Settings) -> list[Names]:
    """Return the effects worth fitting: what a line at the null says of a strong effect may fall short by far.

    Laws that start alike, such as a lag and a delay, are distinguished by their fits alone: all are fitted, or none.
    """
    own, groups = settings.candidates, {group.names: group for group in lack.groups}
    worth = [row for row in lack.rows if row.gain >= own.survive * lack.rows[0].gain]
    chosen, visible = worth[: own.most_singles], settings.score_test.visible

    def begins_as(row: Row, one: Row) -> bool:
        share = cosine(lack.conditional, groups[one.names], one.change, groups[row.names], visible)
        return share >= settings.equivalence.alike

    further = [row for row in worth[own.most_singles :] if any(begins_as(row, one) for one in chosen)]
    return [row.names for row in [*chosen, *further]]


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
