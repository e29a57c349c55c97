"""Which effect: survivors of the score test are fitted, compared on trajectories that they were not fitted to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch

from physid.diagnosis.reference.discrepancy import Say
from physid.diagnosis.reference.nominal_fit import Prepared
from physid.diagnosis.selection.candidates import first_pairs, ranked_pairs, survivors, swapped_pairs
from physid.diagnosis.selection.comparison import by_prediction, contest
from physid.diagnosis.selection.contact_free import calm, everywhere
from physid.diagnosis.selection.evidence import (
    ALPHA,
    both_needed,
    complete,
    distinguishable,
    evident,
    explained,
    sound,
)
from physid.diagnosis.testing.equivalence import alike
from physid.diagnosis.testing.hypothesis import Hypothesis, begin_afresh, begin_hypothesis, conclude
from physid.diagnosis.testing.lack_of_fit import Stage, examine
from physid.physics.layer import SolverError

SECOND = 0.01  # share of the gap from which on a second effect is looked for
AFRESH = 6  # single effects that are fitted again from finite sizes, where the best leaves a gap
AT_HITS = 3  # effects that are tried beside one that calm windows showed


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
    quiet = calm(prepared, generator, say)
    if quiet is not None:
        found = _search(quiet, generator, say)
        if found.best is not None or unexplained(found):
            return _with_second(prepared, _with_all_frames(prepared, found, say), generator, say)
    return _search(prepared, generator, say)


def _with_all_frames(prepared: Prepared, found: Attribution, say: Say) -> Attribution:
    """Fit what calm windows showed to all frames; where that cannot be simulated, it stays as it is."""
    say("fitting what was found to all frames")
    try:
        best = None if found.best is None else everywhere(prepared, found.best)
    except SolverError:
        return found
    return replace(found, everywhere=(conclude(prepared.experiment, prepared.fit, ()), best))


def _with_second(prepared: Prepared, found: Attribution, generator: torch.Generator, say: Say) -> Attribution:
    """Look in all windows for a second effect: it may act at hits alone, or move all that a camera sees of a flight."""
    one = found.whole_best
    if not found.calm or one is None or len(one.names) > 1:
        return found
    say(f"looking at what {one.names[0]} leaves at hits")
    try:
        return _beside(prepared, found, one, generator, say) or found
    except SolverError:
        return found  # what cannot be simulated does not undo what calm windows showed


def _beside(
    prepared: Prepared, found: Attribution, one: Hypothesis, generator: torch.Generator, say: Say
) -> Attribution | None:
    """Return the best pair of an effect and another that are both needed in all windows; None if there is none."""
    nominal = found.whole_nominal
    left = examine(prepared, one, generator)
    further = sorted(left.significant, key=lambda row: -row.deviation())[:AT_HITS]
    if left.p_value > ALPHA or not further:
        return None
    pairs = contest(
        [(*one.names, *row.names) for row in further],
        lambda names: begin_hypothesis(one.experiment, left.fit, names),
        one,
        say,
    )
    needed = [pair for pair in pairs if sound(nominal, pair, left) and both_needed(pair, nominal, [one], left)]
    if not needed:
        return None
    stage, rest = examine(prepared, nominal, generator), examine(prepared, needed[0], generator)
    whole = complete(nominal, needed[0], stage, rest)
    group = [pair for pair in needed if pair is needed[0] or not distinguishable(nominal, needed[0], pair, rest, whole)]
    return Attribution(nominal, stage, [*needed, one], needed[0], rest, group, alike(stage, needed[0]))


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
    tried = singles = [one for one in _since(best, singles) if sound(nominal, one, stage)]
    if left.p_value <= ALPHA and left.missing > SECOND * explained(nominal, best, stage):
        tried = by_prediction([*singles, *_needed_pairs(prepared, nominal, stage, singles, left, say)])
        if tried[0] is not best:
            best, left = _best_of(prepared, nominal, stage, tried, generator, say)
            assert best is not None and left is not None
            tried = _since(best, tried)
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
    """Return the hypothesis that predicts best, of those that are confirmed, and what it leaves.

    One near which the model cannot be simulated is passed over: what it leaves cannot be told.
    """
    for one in tried:
        if sound(nominal, one, stage):
            say(f"looking at what {' + '.join(one.names)} leaves")
            try:
                return one, examine(prepared, one, generator)
            except SolverError:
                continue
    return None, None


def _since(best: Hypothesis, tried: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Leave out what was passed over before the best."""
    return list(tried[next(k for k, one in enumerate(tried) if one is best) :])


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
