"""Which effect: survivors of the score test are fitted, compared on trajectories that they were not fitted to."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import torch

from physid.diagnosis.equivalence import alike
from physid.diagnosis.hypothesis import Hypothesis, begin_hypothesis, conclude, finish_hypothesis, retried
from physid.diagnosis.prepare import Prepared
from physid.diagnosis.score import Group, gains
from physid.diagnosis.settle import Say, settle
from physid.diagnosis.stage import Stage, examine
from physid.physics.layer import SolverError

ALPHA = 0.01  # effect-free data are called suspicious this often
SURVIVE = 0.1  # share of the best gain that a candidate needs to be fitted
MOST_SINGLES, MOST_PAIRS = 10, 5
BEHIND = 0.5  # share of the gap that a hypothesis may leave open after a few steps, beyond the best, to be fitted on
SETTLE_MOST = 4  # hypotheses that are settled with the other engine: the best, and others ...
NEAR = 0.2  # ... whose gap is open by at most this share more
CLEAR = 2.5  # standard errors by which a prediction must be worse to be told apart
NATS = 12.0  # and by how much squared residual at least
SAME = 0.003  # share of what the best explains that the numerics may decide between two hypotheses
EVIDENT = 2.0  # mean squared residual, in units of the noise, that no effect-free trajectories have
CLOSED = 0.02  # share of the gap that may be left without a second look
SECOND = 0.01  # share of the gap from which on a second effect is looked for


@dataclass(frozen=True)
class Attribution:
    """What the search found.

    Attributes:
        nominal: The model without effects.
        stage: What it leaves unexplained.
        tried: All hypotheses that were fitted, best predictions first.
        best: The best of them; None if nothing is missing, or no effect is confirmed by held-out trajectories.
        left: What the best leaves unexplained; None if nothing is missing.
        group: Hypotheses that predict as well as the best, itself included.
        alike: Effects whose signature is that of a part of the best wherever the motion is calm.
    """

    nominal: Hypothesis
    stage: Stage
    tried: list[Hypothesis]
    best: Hypothesis | None
    left: Stage | None
    group: list[Hypothesis]
    alike: tuple[str, ...] = ()


def attribute(prepared: Prepared, generator: torch.Generator, say: Say = lambda _: None) -> Attribution:
    """Search the catalogue for what the nominal model lacks.

    Args:
        prepared: The fitted nominal model.
        generator: Randomness of effect-free data.
        say: Told what is being done.
    """
    nominal = conclude(prepared.experiment, prepared.fit, ())
    say("testing all effects at once, against effect-free data")
    stage = examine(prepared, nominal, generator)
    if stage.p_value > ALPHA and not evident(nominal):
        return Attribution(nominal, stage, [], None, None, [])
    singles = _fit_all(prepared, nominal, stage, _survivors(stage), say)
    singles = [one for one in singles if confirmed(nominal, one) and beyond_chance(nominal, one, stage)]
    if not singles:
        return Attribution(nominal, stage, [], None, None, [])
    best = singles[0]
    say(f"looking at what {' + '.join(best.names)} leaves")
    left = examine(prepared, best, generator)
    tried = singles
    if left.p_value <= ALPHA and left.missing > SECOND * explained(nominal, best, stage):
        pairs = _fit_all(prepared, nominal, stage, _pairs(stage, singles, left), say, best, left)
        sound = [pair for pair in pairs if _both_needed(pair, singles, left)]
        tried = _sorted([*singles, *sound])
        if tried[0] is not best:
            best = tried[0]
            say(f"looking at what {' + '.join(best.names)} leaves")
            left = examine(prepared, best, generator)
    whole = complete(nominal, best, stage, left)
    group = [one for one in tried if one is best or not distinguishable(nominal, best, one, left, whole)]
    return Attribution(nominal, stage, tried, best, left, group, alike(stage, best))


def explained(nominal: Hypothesis, best: Hypothesis, stage: Stage) -> float:
    """Return what the best explains: in squared residual of the fitted trajectories, or by a free residual wrench."""
    return max(_gain(nominal, best), stage.excess, 1e-9)


def complete(nominal: Hypothesis, best: Hypothesis, stage: Stage, left: Stage) -> bool:
    """Tell whether the best leaves nothing, or so little that laws which differ by a hair account for it."""
    return left.p_value > ALPHA or left.missing < CLOSED * explained(nominal, best, stage)


def confirmed(nominal: Hypothesis, one: Hypothesis) -> bool:
    """Tell whether a hypothesis predicts better than the nominal model where nothing was fitted to."""
    reported = ~nominal.experiment.fitted
    better = (nominal.held_out - one.held_out)[reported]
    return len(better) == 0 or float(better.sum()) > 0


def beyond_chance(nominal: Hypothesis, one: Hypothesis, stage: Stage) -> bool:
    """Tell whether a hypothesis explains more than it does in effect-free data."""
    return _gain(nominal, one) > stage.limit * stage.scale(one.names)


def evident(nominal: Hypothesis) -> bool:
    """Tell whether trajectories that nothing was fitted to leave the model by more than any numerics account for.

    After hits effect-free data scatter widely and one effect alone may not stand out from them; the gap does.
    """
    experiment = nominal.experiment
    reported = ~experiment.fitted
    count = (experiment.scale[reported] > 0).sum()
    return float(nominal.held_out[reported].sum()) > EVIDENT * float(count)


def distinguishable(nominal: Hypothesis, best: Hypothesis, other: Hypothesis, left: Stage, whole: bool = False) -> bool:
    """Tell whether another hypothesis predicts held-out trajectories clearly worse than the best.

    If the other were true, the squared residuals of both would differ by more than d with a probability of at most
    exp(-d / 2). That bound trusts the noise, and the numerics, which are known to a share of what is explained; where
    the best leaves something (it is not the whole), the difference must exceed that as well, and hold in a paired test
    over trajectories.
    """
    worse = other.held_out - best.held_out
    closed = float((nominal.held_out - best.held_out).sum())
    least = max(NATS, SAME * closed, 2 * left.excess)
    if left.p_value <= ALPHA and not whole:
        error = float(worse.std()) * len(worse) ** 0.5
        least = max(least, CLEAR * error)
    return float(worse.sum()) > least


def _survivors(stage: Stage) -> list[tuple[str, ...]]:
    """Return the effects worth fitting: what a line at the null says of a strong effect may fall short by far."""
    worth = [row for row in stage.rows if row.gain >= SURVIVE * stage.rows[0].gain]
    return [row.names for row in worth][:MOST_SINGLES]


def _pairs(stage: Stage, singles: list[Hypothesis], left: Stage) -> list[tuple[str, ...]]:
    """Return pairs worth fitting: the best with what it leaves, and the best of all pairs by their linear gain.

    Both parts must be significant alone.
    """
    alone = {row.names[0] for row in stage.significant}
    with_best = [tuple(sorted((*singles[0].names, row.names[0]))) for row in left.significant if row.names[0] in alone][
        : MOST_PAIRS // 2
    ]
    groups = [group for group in stage.groups if group.names[0] in alone]
    both = {
        tuple(sorted((one.names[0], two.names[0]))): float(gains(stage.conditional, _joined(one, two))[0])
        for one, two in combinations(groups, 2)
    }
    ranked = sorted(both, key=lambda names: -both[names])
    chosen = [*with_best, *(names for names in ranked if names not in with_best)]
    return chosen[:MOST_PAIRS]


def _joined(one: Group, two: Group) -> Group:
    return Group(
        (*one.names, *two.names),
        *(torch.cat([getattr(one, name), getattr(two, name)]) for name in ("columns", "typical", "low", "high")),
    )


def _both_needed(pair: Hypothesis, singles: list[Hypothesis], left: Stage) -> bool:
    """Tell whether a pair predicts clearly better than each of its parts alone."""
    parts = [one for one in singles if one.names[0] in pair.names]
    return all(
        distinguishable(one, pair, one, left) and _gain(one, pair) > left.limit * left.scale(pair.names)
        for one in parts
    )


def _gain(worse: Hypothesis, better: Hypothesis) -> float:
    fitted = worse.experiment.fitted
    return float((worse.held_out - better.held_out)[fitted].sum())


def _fit_all(
    prepared: Prepared,
    nominal: Hypothesis,
    stage: Stage,
    wanted: list[tuple[str, ...]],
    say: Say,
    best: Hypothesis | None = None,
    left: Stage | None = None,
) -> list[Hypothesis]:
    """Fit hypotheses and settle the best of them with the other engine; best predictions first.

    Those that hold the best so far start at its fit, the others at the nominal one. After a few steps those that are
    far behind are left as they are.
    """
    begun = []
    for number, names in enumerate(wanted):
        say(f"fitting {' + '.join(names)} ({number + 1} of {len(wanted)})")
        try:
            if best is not None and left is not None and set(best.names) < set(names):
                begun.append(begin_hypothesis(best.experiment, left.fit, names))
            else:
                begun.append(begin_hypothesis(prepared.experiment, stage.fit, names))
        except SolverError:
            continue  # a candidate that cannot be simulated where the data want it explains nothing
    begun = _sorted(begun)
    fitted = _sorted([_finished(one, say) if _hopeful(one, begun[0], best or nominal) else one for one in begun])
    settled: list[Hypothesis] = []
    for one in fitted[:SETTLE_MOST]:
        if settled and _gain(one, settled[0]) > NEAR * _gain(best or nominal, settled[0]):
            break
        say(f"replaying {' + '.join(one.names)} in the other engine")
        again = retried(one)
        experiment, fit = settle(again.experiment, again.fit, again.columns, again.names)
        settled.append(conclude(experiment, fit, one.names))
    return _sorted([*settled, *fitted[len(settled) :]])


def _hopeful(one: Hypothesis, first: Hypothesis, before: Hypothesis) -> bool:
    """Tell whether a hypothesis that was begun may still become the best: how much of the gap it leaves open."""
    return _gain(one, first) <= BEHIND * _gain(before, first)


def _finished(one: Hypothesis, say: Say) -> Hypothesis:
    """Fit a hypothesis to the end; where that cannot be simulated it stays as it is."""
    say(f"fitting {' + '.join(one.names)} to the end")
    try:
        return finish_hypothesis(one)
    except SolverError:
        return one


def _sorted(hypotheses: list[Hypothesis]) -> list[Hypothesis]:
    return sorted(hypotheses, key=lambda one: float(one.held_out.sum()))
