"""Which hypotheses are worth fitting, by what the score test says of them."""

from __future__ import annotations

from itertools import combinations

from physid.diagnosis.selection.comparison import Names
from physid.diagnosis.settings.settings import Settings
from physid.diagnosis.settings.testing import ScoreTestSettings
from physid.diagnosis.testing import Hypothesis, LackOfFit, Row, cosine, gains, joined


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


def ranked_pairs(lack: LackOfFit, settings: ScoreTestSettings) -> list[Names]:
    """Return all pairs of effects that are significant alone, those with the largest linear gain first."""
    alone = {row.names[0] for row in lack.significant}
    groups = [group for group in lack.groups if group.names[0] in alone]
    both = {
        tuple(sorted((one.names[0], two.names[0]))): float(gains(lack.conditional, joined((one, two)), settings)[0])
        for one, two in combinations(groups, 2)
    }
    return sorted(both, key=lambda names: -both[names])


def first_pairs(ranked: list[Names], best: Hypothesis, left: LackOfFit, most: int) -> list[Names]:
    """Return at most so many pairs: half of them the best effect with what it leaves, half the best by linear gain."""
    further = (tuple(sorted((*best.names, row.names[0]))) for row in left.significant)
    with_best = [names for names in further if names in ranked][: most // 2]
    chosen = [*with_best, *(names for names in ranked if names not in with_best)]
    return chosen[:most]


def swapped_pairs(ranked: list[Names], pair: Hypothesis, tried: list[Names], most: int) -> list[Names]:
    """Return pairs that share one effect with a pair, `most` of them: alone, the other may stand for a part of both."""
    return [names for names in ranked if len({*names, *pair.names}) == 3 and names not in tried][:most]
