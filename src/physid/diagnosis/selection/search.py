"""Search the catalogue in some segments: survivors of the score test are fitted, compared on held-out trajectories."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch

from physid.diagnosis.progress import Progress, Stage
from physid.diagnosis.reference.nominal_fit import NominalFit
from physid.diagnosis.selection.comparison import by_prediction, compare_candidates, survivors
from physid.diagnosis.selection.contact_free import with_own_steps
from physid.diagnosis.selection.evidence import complete, distinguishable, evident, least_gain, sound
from physid.diagnosis.selection.several import leaves, of_one_more, with_twins
from physid.diagnosis.testing import (
    Hypothesis,
    LackOfFit,
    alike,
    begin_from_finite_sizes,
    begin_hypothesis,
    conclude,
    find_lack_of_fit,
)
from physid.physics import SolverError


@dataclass(frozen=True)
class InAllSegments:
    """What contact-free segments found, fitted to all segments.

    Attributes:
        nominal: The model without effects.
        group: Hypotheses that contact-free segments cannot distinguish, the best first; none if it cannot be simulated.
    """

    nominal: Hypothesis
    group: list[Hypothesis]


@dataclass(frozen=True)
class Attribution:
    """What the search found.

    Attributes:
        nominal: The model without effects.
        lack: What it leaves unexplained.
        tried: All hypotheses that were fitted, best predictions first.
        best: The best of them; None if nothing is missing, or no effect is confirmed by held-out trajectories.
        left: What the best leaves unexplained; None if nothing is missing.
        group: Hypotheses that predict as well as the best, itself included.
        alike: Effects whose signature is that of a part of the best wherever the motion is calm.
        everywhere: The same in all segments, where contact-free ones alone were searched.
    """

    nominal: Hypothesis
    lack: LackOfFit
    tried: list[Hypothesis]
    best: Hypothesis | None
    left: LackOfFit | None
    group: list[Hypothesis]
    alike: tuple[str, ...] = ()
    everywhere: InAllSegments | None = None

    @property
    def contact_free(self) -> bool:
        """Whether contact-free segments alone were searched."""
        return self.everywhere is not None

    @property
    def whole_nominal(self) -> Hypothesis:
        """The model without effects, in all segments."""
        return self.nominal if self.everywhere is None else self.everywhere.nominal

    @property
    def whole_best(self) -> Hypothesis | None:
        """The best hypothesis, in all segments."""
        return next(iter(self.whole_group), None)

    @property
    def whole_group(self) -> list[Hypothesis]:
        """Hypotheses that predict as well as the best, the best first, in all segments."""
        if self.everywhere is not None:
            return self.everywhere.group
        return [] if self.best is None else [self.best, *(one for one in self.group if one is not self.best)]

    def reported(self, nominal_fit: NominalFit) -> Hypothesis | None:
        """Return that with the steps that it needs itself; as it is where these cannot be simulated."""
        one = self.whole_best
        try:
            return None if one is None else with_own_steps(nominal_fit, one)
        except SolverError:
            return one


def unexplained(found: Attribution) -> bool:
    """Return whether a gap is beyond doubt although no effect was confirmed.

    A free wrench is one of the two looks of `LackOfFit.p_value`: it has half of what chance is allowed.
    """
    alpha = found.nominal.settings.evidence.alpha
    return found.best is None and (2 * found.lack.p_free <= alpha or evident(found.nominal))


def leaves_nothing(found: Attribution) -> bool:
    """Return whether the best of a search leaves nothing."""
    if found.best is None or found.left is None:
        return False
    return complete(found.nominal, found.best, found.lack, found.left)


def search_catalogue(nominal_fit: NominalFit, generator: torch.Generator, say: Progress) -> Attribution:
    """Search the catalogue for what the nominal model lacks in the segments given."""
    settings = nominal_fit.settings
    nominal = conclude(nominal_fit.experiment, nominal_fit.fit, (), settings)
    say(Stage.TESTING)
    lack = find_lack_of_fit(nominal_fit, nominal, generator)
    if lack.p_value > settings.evidence.alpha and not evident(nominal):
        return Attribution(nominal, lack, [], None, None, [])
    singles = compare_candidates(
        survivors(lack, settings),
        lambda names: begin_hypothesis(nominal_fit.experiment, lack.fit, names, settings),
        nominal,
        say,
    )
    best, left = _best_of(nominal_fit, nominal, lack, singles, generator, say)
    open_gap = best is not None and left is not None and not complete(nominal, best, lack, left) and evident(nominal)
    if open_gap and settings.attribution.multi_start:
        singles = _from_finite_sizes(nominal_fit, nominal, lack, singles, say)
        best, left = _best_of(nominal_fit, nominal, lack, singles, generator, say)
    if best is None or left is None:
        return Attribution(nominal, lack, [], None, None, [])
    tried = [one for one in _since(best, singles) if sound(nominal, one, lack)]
    least, most = least_gain(nominal_fit), settings.candidates.most_effects
    while len(best.names) < most and leaves(nominal, best, lack, left, least):
        count = len(best.names)
        tried = by_prediction([*tried, *of_one_more(nominal_fit, nominal, lack, tried, left, generator, say)])
        if tried[0] is best:
            break
        best, left = _best_of(nominal_fit, nominal, lack, tried, generator, say)
        assert best is not None and left is not None
        tried = _since(best, tried)
        if len(best.names) == count:
            break
    tried = with_twins(lack, nominal, tried, say)
    if tried[0] is not best:
        best, left = _best_of(nominal_fit, nominal, lack, tried, generator, say)
        assert best is not None and left is not None
        tried = _since(best, tried)
    whole = complete(nominal, best, lack, left)
    group = [one for one in tried if one is best or not distinguishable(nominal, best, one, left, whole)]
    return Attribution(nominal, lack, tried, best, left, group, alike(lack, best, tried))


def _best_of(
    nominal_fit: NominalFit,
    nominal: Hypothesis,
    lack: LackOfFit,
    tried: Sequence[Hypothesis],
    generator: torch.Generator,
    say: Progress,
) -> tuple[Hypothesis, LackOfFit] | tuple[None, None]:
    """Return the hypothesis that predicts best, of those that are confirmed, and what it leaves.

    One near which the model cannot be simulated is passed over: what it leaves cannot be estimated.
    """
    for one in tried:
        if sound(nominal, one, lack):
            say(Stage.EXAMINING, " + ".join(one.names))
            try:
                return one, find_lack_of_fit(nominal_fit, one, generator)
            except SolverError:
                continue
    return None, None


def _since(best: Hypothesis, tried: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Leave out what was passed over before the best."""
    return list(tried[next(k for k, one in enumerate(tried) if one is best) :])


def _from_finite_sizes(
    nominal_fit: NominalFit, nominal: Hypothesis, lack: LackOfFit, singles: list[Hypothesis], say: Progress
) -> list[Hypothesis]:
    """Fit single effects again from finite sizes and first guesses; of each, what predicts better is returned.

    A strong effect has driven the nominal fit far away, to a friction of nearly nothing, say, and no small step of
    any effect leads back from there.
    """
    settings = nominal_fit.settings
    changes = {row.names: row.change for row in lack.rows}
    again = compare_candidates(
        [one.names for one in singles[: settings.attribution.multi_start]],
        lambda names: begin_from_finite_sizes(nominal_fit.experiment, lack.fit.point, names, changes[names], settings),
        nominal,
        say,
    )
    best: dict[tuple[str, ...], Hypothesis] = {}
    for one in by_prediction([*singles, *again]):
        best.setdefault(one.names, one)
    return list(best.values())
