"""What contact-free segments found, fitted to all frames; and who of a group is first there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from physid.diagnosis.progress import Progress, Stage
from physid.diagnosis.reference.nominal_fit import NominalFit
from physid.diagnosis.selection.comparison import by_prediction
from physid.diagnosis.selection.contact_free import refit_all_segments
from physid.diagnosis.selection.evidence import preferred
from physid.diagnosis.selection.search import Attribution, InAllSegments
from physid.diagnosis.testing import Hypothesis, conclude, refitted_from_new_states
from physid.physics import SolverError


def fit_all_frames(nominal_fit: NominalFit, found: Attribution, say: Progress) -> Attribution:
    """Fit what contact-free segments showed to all frames; where that cannot be simulated, it stays as it is.

    Of the first of a group, that hypothesis is the best which trajectories prefer in all frames: impacts distinguish
    what flights do not. None is dropped for it; what the best leaves (`Attribution.left`) is still that of the first,
    which predicts the same in contact-free segments.
    """
    say(Stage.FITTING_ALL_FRAMES)
    fitted: list[tuple[Hypothesis, Hypothesis]] = []
    for one in found.group[: max(1, nominal_fit.settings.comparison.most_refitted)]:
        try:
            fitted.append((one, refit_all_segments(nominal_fit, one)))
        except SolverError:
            if one is found.best:
                return found
    nominal = conclude(nominal_fit.experiment, nominal_fit.fit, (), nominal_fit.settings)
    if not fitted:
        return replace(found, everywhere=InAllSegments(nominal, []))
    fitted = [(one, _from_states_of(again, fitted)) for one, again in fitted]
    best, whole = fitted[0]
    for one, again in fitted[1:]:
        if preferred(again, whole):
            best, whole = one, again
    group = [best, *(one for one in found.group if one is not best)]
    everywhere = InAllSegments(nominal, [whole, *(again for _, again in fitted if again is not whole)])
    return replace(found, best=best, group=group, everywhere=everywhere)


def _from_states_of(one: Hypothesis, fitted: Sequence[tuple[Hypothesis, Hypothesis]]) -> Hypothesis:
    """Fit a hypothesis to all frames again, from initial states of the best of the others where these explain more."""
    others = [again for _, again in fitted if again is not one]
    try:
        return refitted_from_new_states(one, by_prediction(others)[0]) if others else one
    except SolverError:
        return one
