"""Which effect: survivors of the score test are fitted, compared on trajectories that they were not fitted to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch

from physid.diagnosis.calm import calm, everywhere
from physid.diagnosis.candidates import first_pairs, ranked_pairs, survivors, swapped_pairs
from physid.diagnosis.contest import by_prediction, contest, gain
from physid.diagnosis.equivalence import alike
from physid.diagnosis.hypothesis import Hypothesis, begin_afresh, begin_hypothesis, conclude
from physid.diagnosis.prepare import Prepared
from physid.diagnosis.settle import Say
from physid.diagnosis.stage import Stage, examine
from physid.physics.layer import SolverError

ALPHA = 0.01  # effect-free data are called suspicious this often
CLEAR = 2.5  # standard errors by which a prediction must be worse to be told apart
NATS = 12.0  # and by how much squared residual at least
SAME = 0.003  # share of what the best explains that the numerics may decide between two hypotheses
EVIDENT = 2.0  # mean squared residual, in units of the noise, that no effect-free trajectories have
CLOSED = 0.02  # share of the gap that may be left without a second look
CLOSED_BY_PAIR = 0.005  # the same where two effects are blamed
SECOND = 0.01  # share of the gap from which on a second effect is looked for
AFRESH = 6  # single effects that are fitted again from finite sizes, where the best leaves a gap
MOST_OF_IT = 0.5  # share of what one effect leaves that a second one must explain


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
        everywhere: The nominal model and the best fitted to all windows, where calm ones alone were searched; the
            effects are as these say.
    """

    nominal: Hypothesis
    stage: Stage
    tried: list[Hypothesis]
    best: Hypothesis | None
    left: Stage | None
    group: list[Hypothesis]
    alike: tuple[str, ...] = ()
    everywhere: tuple[Hypothesis, Hypothesis | None] | None = None

    @property
    def calm(self) -> bool:
        """Whether calm windows alone were searched."""
        return self.everywhere is not None

    @property
    def whole_nominal(self) -> Hypothesis:
        """The model without effects, in all windows."""
        return self.nominal if self.everywhere is None else self.everywhere[0]

    @property
    def whole_best(self) -> Hypothesis | None:
        """The best hypothesis, in all windows."""
        return self.best if self.everywhere is None else self.everywhere[1]


def attribute(prepared: Prepared, generator: torch.Generator, say: Say = lambda _: None) -> Attribution:
    """Search the catalogue for what the nominal model lacks: first where the motion is calm, then everywhere.

    Args:
        prepared: The fitted nominal model.
        generator: Randomness of effect-free data.
        say: Told what is being done.
    """
    quiet = calm(prepared, say)
    if quiet is not None:
        found = _search(quiet, generator, say)
        if found.best is not None or unexplained(found):
            return _with_all_frames(prepared, found, say)
    return _search(prepared, generator, say)


def _with_all_frames(prepared: Prepared, found: Attribution, say: Say) -> Attribution:
    """Fit what calm windows showed to all frames; where that cannot be simulated, it stays as it is."""
    say("fitting what was found to all frames")
    try:
        best = None if found.best is None else everywhere(prepared, found.best)
    except SolverError:
        return found
    return replace(found, everywhere=(conclude(prepared.experiment, prepared.fit, ()), best))


def unexplained(found: Attribution) -> bool:
    """Tell whether a gap is beyond doubt although no effect was confirmed."""
    return found.best is None and (found.stage.p_free <= ALPHA or evident(found.nominal))


def _search(prepared: Prepared, generator: torch.Generator, say: Say) -> Attribution:
    """Search the catalogue for what the nominal model lacks in the windows given."""
    nominal = conclude(prepared.experiment, prepared.fit, ())
    say("testing all effects at once, against effect-free data")
    stage = examine(prepared, nominal, generator)
    if stage.p_value > ALPHA and not evident(nominal):
        return Attribution(nominal, stage, [], None, None, [])
    singles = contest(
        survivors(stage), lambda names: begin_hypothesis(prepared.experiment, stage.fit, names), nominal, say
    )
    best, left = _best_of(prepared, nominal, stage, singles, generator, say)
    if best is not None and left is not None and not complete(nominal, best, stage, left) and evident(nominal):
        singles = _afresh(prepared, nominal, stage, singles, say)
        best, left = _best_of(prepared, nominal, stage, singles, generator, say)
    if best is None or left is None:
        return Attribution(nominal, stage, [], None, None, [])
    tried = singles = [one for one in singles if sound(nominal, one, stage)]
    if left.p_value <= ALPHA and left.missing > SECOND * explained(nominal, best, stage):
        tried = by_prediction([*singles, *_needed_pairs(prepared, nominal, stage, singles, left, say)])
        if tried[0] is not best:
            best, left = _best_of(prepared, nominal, stage, tried, generator, say)
            assert best is not None and left is not None
    whole = complete(nominal, best, stage, left)
    group = [one for one in tried if one is best or not distinguishable(nominal, best, one, left, whole)]
    return Attribution(nominal, stage, tried, best, left, group, alike(stage, best))


def _best_of(
    prepared: Prepared,
    nominal: Hypothesis,
    stage: Stage,
    tried: Sequence[Hypothesis],
    generator: torch.Generator,
    say: Say,
) -> tuple[Hypothesis, Stage] | tuple[None, None]:
    """Return the hypothesis that predicts best, of those that are confirmed, and what it leaves."""
    best = next((one for one in tried if sound(nominal, one, stage)), None)
    if best is None:
        return None, None
    say(f"looking at what {' + '.join(best.names)} leaves")
    return best, examine(prepared, best, generator)


def _afresh(
    prepared: Prepared, nominal: Hypothesis, stage: Stage, singles: list[Hypothesis], say: Say
) -> list[Hypothesis]:
    """Fit single effects again from finite sizes and first guesses; of each, what predicts better is returned.

    A strong effect has driven the nominal fit far away, to a friction of nearly nothing, say, and no small step of
    any effect leads back from there.
    """
    changes = {row.names: row.change for row in stage.rows}
    again = contest(
        [one.names for one in singles[:AFRESH]],
        lambda names: begin_afresh(prepared.experiment, stage.fit.point, names, changes[names]),
        nominal,
        say,
    )
    best: dict[tuple[str, ...], Hypothesis] = {}
    for one in by_prediction([*singles, *again]):
        best.setdefault(one.names, one)
    return list(best.values())


def _needed_pairs(
    prepared: Prepared, nominal: Hypothesis, stage: Stage, singles: list[Hypothesis], left: Stage, say: Say
) -> list[Hypothesis]:
    """Fit pairs, and then those that share one effect with the best of them; return the pairs that are needed."""
    best = singles[0]

    def begin(names: tuple[str, ...]) -> Hypothesis:
        if set(best.names) < set(names):
            return begin_hypothesis(best.experiment, left.fit, names)
        return begin_hypothesis(prepared.experiment, stage.fit, names)

    ranked = ranked_pairs(stage)
    pairs = contest(first_pairs(ranked, best, left), begin, best, say)
    needed = [pair for pair in pairs if both_needed(pair, nominal, singles, left)]
    if not needed:
        return []
    further = contest(swapped_pairs(ranked, needed[0], [pair.names for pair in pairs]), begin, best, say)
    return [*needed, *(pair for pair in further if both_needed(pair, nominal, singles, left))]


def sound(nominal: Hypothesis, one: Hypothesis, stage: Stage) -> bool:
    """Tell whether a hypothesis explains more than chance, where it was fitted and where it was not."""
    return confirmed(nominal, one) and beyond_chance(nominal, one, stage)


def explained(nominal: Hypothesis, best: Hypothesis, stage: Stage) -> float:
    """Return what the best explains: in squared residual of the fitted trajectories, or by a free residual wrench."""
    return max(gain(nominal, best), stage.excess, 1e-9)


def complete(nominal: Hypothesis, best: Hypothesis, stage: Stage, left: Stage) -> bool:
    """Tell whether the best leaves nothing, or so little that laws which differ by a hair account for it.

    Two effects follow a foreign law more closely than one: of a pair less may be left.
    """
    closed = CLOSED if len(best.names) == 1 else CLOSED_BY_PAIR
    return left.p_value > ALPHA or left.missing < closed * explained(nominal, best, stage)


def confirmed(nominal: Hypothesis, one: Hypothesis) -> bool:
    """Tell whether a hypothesis predicts better than the nominal model where nothing was fitted to."""
    reported = ~nominal.experiment.fitted
    better = (nominal.held_out - one.held_out)[reported]
    return len(better) == 0 or float(better.sum()) > 0


def beyond_chance(nominal: Hypothesis, one: Hypothesis, stage: Stage) -> bool:
    """Tell whether a hypothesis explains more than it does in effect-free data."""
    return gain(nominal, one) > stage.limit * stage.scale(one.names)


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


def both_needed(pair: Hypothesis, nominal: Hypothesis, singles: list[Hypothesis], left: Stage) -> bool:
    """Tell whether a pair accounts for most of what the best single effect leaves, and for more than each part alone.

    Neither part may have sizes that are known no better than that they may be null.
    """
    if gain(singles[0], pair) < MOST_OF_IT * left.missing or pair.absent(pair.covariance()):
        return False
    least = max(NATS, SAME * float((nominal.held_out - pair.held_out).sum()))
    return all(
        float((one.held_out - pair.held_out).sum()) > least and gain(one, pair) > left.limit * left.scale(pair.names)
        for one in singles
        if one.names[0] in pair.names
    )
