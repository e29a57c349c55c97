"""Comparing candidates: each is fitted, those far behind are dropped, the best are refitted with the reference."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from physid.diagnosis.reference.discrepancy import Say, fit_with_reference
from physid.diagnosis.testing.hypothesis import Hypothesis, conclude, finish_hypothesis, refitted_from_new_states
from physid.physics.layer import SolverError

BEHIND = 0.5  # share of the gap that a hypothesis may leave open after a few steps, beyond the best, to be fitted on
MOST_REFITTED = 4  # hypotheses that are settled with the reference simulator: the best, and others ...
NEAR = 0.2  # ... whose gap is open by at most this share more

Names = tuple[str, ...]


def compare_candidates(
    wanted: Sequence[Names], begin: Callable[[Names], Hypothesis], before: Hypothesis, say: Say
) -> list[Hypothesis]:
    """Fit hypotheses and settle the best of them with the reference simulator; best predictions first.

    Args:
        wanted: Names of the effects of each.
        begin: Fits one of them for a few steps.
        before: The hypothesis that they shall improve on.
        say: Called with what is being done.
    """
    begun = []
    for number, names in enumerate(wanted):
        say(f"fitting {' + '.join(names)} ({number + 1} of {len(wanted)})")
        try:
            begun.append(begin(names))
        except SolverError:
            continue  # a candidate that cannot be simulated where the data want it explains nothing
    begun = by_prediction(begun)
    fitted = by_prediction([_finished(one, say) if _hopeful(one, begun[0], before) else one for one in begun])
    settled: list[Hypothesis] = []
    for one in fitted[:MOST_REFITTED]:
        if settled and gain(one, settled[0]) > NEAR * gain(before, settled[0]):
            break
        settled.append(_fitted_with_reference(one, say))
    return by_prediction([*settled, *fitted[len(settled) :]])


def gain(worse: Hypothesis, better: Hypothesis) -> float:
    """Return how much better one hypothesis predicts the fitted trajectories, each from the others."""
    fitted = worse.experiment.fitted
    return float((worse.held_out - better.held_out)[fitted].sum())


def by_prediction(hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Sort hypotheses, those that predict best first."""
    return sorted(hypotheses, key=lambda one: float(one.held_out.sum()))


def _hopeful(one: Hypothesis, first: Hypothesis, before: Hypothesis) -> bool:
    """Return whether a hypothesis that was begun may still become the best: how much of the gap it leaves open."""
    return gain(one, first) <= BEHIND * gain(before, first)


def _finished(one: Hypothesis, say: Say) -> Hypothesis:
    """Fit a hypothesis to the end; where that cannot be simulated it stays as it is."""
    say(f"fitting {' + '.join(one.names)} to the end")
    try:
        return finish_hypothesis(one)
    except SolverError:
        return one


def _fitted_with_reference(one: Hypothesis, say: Say) -> Hypothesis:
    """Fit a hypothesis with the numerics of the reference simulator; where these cannot be simulated it stays."""
    say(f"replaying {' + '.join(one.names)} in the reference simulator")
    try:
        again = refitted_from_new_states(one)
        experiment, fit = fit_with_reference(again.experiment, again.fit, again.columns, again.names)
    except SolverError:
        return one
    return conclude(experiment, fit, one.names)
