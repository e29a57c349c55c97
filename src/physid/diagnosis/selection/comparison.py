"""Comparing candidates: those worth it are fitted, those far behind dropped, the best refitted with the reference."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from physid.diagnosis.progress import Progress, Stage
from physid.diagnosis.reference.discrepancy import fit_with_reference
from physid.diagnosis.settings.settings import Settings
from physid.diagnosis.testing import (
    Hypothesis,
    LackOfFit,
    Row,
    conclude,
    cosine,
    finish_hypothesis,
    refitted_from_new_states,
)
from physid.physics import SolverError

Names = tuple[str, ...]


def compare_candidates(
    wanted: Sequence[Names], begin: Callable[[Names], Hypothesis], before: Hypothesis, say: Progress
) -> list[Hypothesis]:
    """Fit hypotheses and settle the best of them with the reference simulator; best predictions first.

    Args:
        wanted: Names of the effects of each.
        begin: Fits one of them for a few steps.
        before: The hypothesis that they shall improve on.
        say: Called with what is being done.
    """
    settings, begun = before.settings.comparison, []
    for number, names in enumerate(wanted):
        say(Stage.FITTING, f"{' + '.join(names)} ({number + 1} of {len(wanted)})")
        try:
            begun.append(begin(names))
        except SolverError:
            continue  # a candidate that cannot be simulated where the data want it explains nothing
    begun = by_prediction(begun)
    hopeful = [gain(one, begun[0]) <= settings.behind * gain(before, begun[0]) for one in begun]
    fitted = by_prediction([_finished(one, say) if worth else one for one, worth in zip(begun, hopeful, strict=True)])
    settled: list[Hypothesis] = []
    for one in fitted[: settings.most_refitted]:
        if settled and gain(one, settled[0]) > settings.near * gain(before, settled[0]):
            break
        rivals = [each for each in (before, *settled, *fitted[len(settled) :]) if each is not one]
        settled.append(_fitted_with_reference(one, by_prediction(rivals)[0], say))
    return by_prediction([*settled, *fitted[len(settled) :]])


def gain(worse: Hypothesis, better: Hypothesis) -> float:
    """Return how much better one hypothesis predicts the fitted trajectories, each from the others."""
    fitted = worse.experiment.fitted
    return float((worse.held_out - better.held_out)[fitted].sum())


def by_prediction(hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Sort hypotheses, those that predict best first."""
    return sorted(hypotheses, key=lambda one: float(one.held_out.sum()))


def _finished(one: Hypothesis, say: Progress) -> Hypothesis:
    """Fit a hypothesis to the end; where that cannot be simulated it stays as it is."""
    say(Stage.FINISHING, " + ".join(one.names))
    try:
        return finish_hypothesis(one)
    except SolverError:
        return one


def _fitted_with_reference(one: Hypothesis, rival: Hypothesis, say: Progress) -> Hypothesis:
    """Fit a hypothesis with the numerics of the reference simulator; where these cannot be simulated it stays."""
    say(Stage.REPLAYING, " + ".join(one.names))
    try:
        again = refitted_from_new_states(one, rival)
        experiment, fit = fit_with_reference(again.experiment, again.fit, again.columns, again.names, one.settings)
    except SolverError:
        return one
    return conclude(experiment, fit, one.names, one.settings)


def survivors(lack: LackOfFit, settings: Settings) -> list[Names]:
    """Return the effects worth fitting: those that explain more than chance, however little beside the best.

    What a line at the null says of a strong effect may fall short by far. In a push the slope of a compliance explained
    a seventeenth of what the size of the body did; fitted, it explained more. Where none stands out although there is a
    gap, any may explain it.

    Laws that start alike, such as a lag and a delay, are distinguished by their fits alone: all are fitted, or none.
    """
    own, groups = settings.candidates, {group.names: group for group in lack.groups}
    worth = lack.significant or lack.rows
    chosen, visible = worth[: own.most_singles], settings.score_test.visible

    def begins_as(row: Row, one: Row) -> bool:
        share = cosine(lack.conditional, groups[one.names], one.change, groups[row.names], visible)
        return share >= settings.equivalence.alike

    further = [row for row in worth[own.most_singles :] if any(begins_as(row, one) for one in chosen)]
    return [row.names for row in [*chosen, *further]]
