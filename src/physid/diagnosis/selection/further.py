"""Further effects, in all segments, beside those that contact-free ones showed."""

from __future__ import annotations

import torch

from physid.diagnosis.progress import Progress, Stage
from physid.diagnosis.reference.nominal_fit import NominalFit
from physid.diagnosis.selection.comparison import compare_candidates
from physid.diagnosis.selection.evidence import (
    all_needed,
    clearly_preferred,
    complete,
    distinguishable,
    least_gain,
    sound,
)
from physid.diagnosis.selection.search import Attribution
from physid.diagnosis.testing import Hypothesis, alike, begin_hypothesis, find_lack_of_fit
from physid.physics import SolverError


def further_effects(
    nominal_fit: NominalFit, found: Attribution, generator: torch.Generator, say: Progress
) -> Attribution:
    """Look in all segments for further effects: they may act at impacts alone, or move all that a camera sees."""
    settings, best = nominal_fit.settings, found.whole_best
    if not found.contact_free or settings.attribution.at_impacts == 0:
        return found
    while best is not None and len(best.names) < settings.candidates.most_effects:
        say(Stage.EXAMINING_IMPACTS, " + ".join(best.names))
        try:
            more = _beside(nominal_fit, found, best, generator, say)
        except SolverError:
            return found  # what cannot be simulated does not undo what contact-free segments showed
        if more is None:
            return found
        found, best = more, more.best
    return found


def _beside(
    nominal_fit: NominalFit, found: Attribution, one: Hypothesis, generator: torch.Generator, say: Progress
) -> Attribution | None:
    """Return the best of effects with one more, where all are needed in all segments; None if there is none."""
    nominal, settings = found.whole_nominal, nominal_fit.settings
    left = find_lack_of_fit(nominal_fit, one, generator)
    further = sorted(left.significant, key=lambda row: -row.deviation())[: settings.attribution.at_impacts]
    least = least_gain(nominal_fit)
    if left.p_value > settings.evidence.alpha or left.missing <= least * left.frames or not further:
        return None
    fitted = compare_candidates(
        [(*one.names, *row.names) for row in further],
        lambda names: begin_hypothesis(one.experiment, left.fit, names, settings),
        one,
        say,
    )
    fewer = [one, *(other for other in found.whole_group if other is not one)]
    needed = [
        more
        for more in fitted
        if sound(nominal, more, left)
        and clearly_preferred(more, one)
        and all_needed(more, nominal, fewer, left, least, generator)
    ]
    if not needed:
        return None
    lack, rest = find_lack_of_fit(nominal_fit, nominal, generator), find_lack_of_fit(nominal_fit, needed[0], generator)
    whole = complete(nominal, needed[0], lack, rest)
    group = [more for more in needed if more is needed[0] or not distinguishable(nominal, needed[0], more, rest, whole)]
    return Attribution(nominal, lack, [*needed, one], needed[0], rest, group, alike(lack, needed[0], needed))
