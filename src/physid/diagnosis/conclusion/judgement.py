"""The verdict, reached step by step: in the segments that decide, then in all frames; and whom it blames."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from physid.diagnosis.conclusion.closings import Closings, compare
from physid.diagnosis.conclusion.verdict import BLAMING, in_all_frames, indistinguishable_from_zero, judge, reconsider
from physid.diagnosis.document.document import Minor, Verdict
from physid.diagnosis.reference.nominal_fit import NominalFit
from physid.diagnosis.selection.comparison import gain
from physid.diagnosis.selection.materiality import (
    Tolerance,
    excess_left,
    fails_at_impacts,
    is_material,
    regained,
    share_closed,
    tolerance_of,
    unexplained_size,
)
from physid.diagnosis.selection.search import Attribution
from physid.diagnosis.testing import Hypothesis, bootstrap_spread


@dataclass(frozen=True)
class Judgement:
    """The verdict, and what it rests on.

    Attributes:
        nominal_fit: The recordings and the fitted nominal model.
        found: What the search found.
        allowed: Below it nothing is blamed.
        verdict: What is said of the gap.
        chosen: The hypothesis that is blamed; None where nothing or nobody is.
        covariance: Of its shared parameters, shape (P, P); None where nothing was to be blamed.
        shown: The same hypothesis, fitted to all frames.
        closings: How far the gap closes with it, in all frames.
        minor: What was significant and is not blamed.
    """

    nominal_fit: NominalFit
    found: Attribution
    allowed: Tolerance
    verdict: Verdict
    chosen: Hypothesis | None
    covariance: Tensor | None
    shown: Hypothesis | None
    closings: Closings
    minor: tuple[Minor, ...]


def judgement_of(nominal_fit: NominalFit, found: Attribution, generator: torch.Generator) -> Judgement:
    """Judge what the search found.

    Args:
        nominal_fit: The recordings and the fitted nominal model.
        found: What the search found.
        generator: Randomness of the bootstrap.
    """
    settings, best, covariance = nominal_fit.settings.verdict, found.best, None
    nominal, closed = regained(nominal_fit, found.nominal, best)
    closings = compare(nominal_fit, nominal, closed, generator)
    before = is_material(nominal_fit, nominal, found.lack)
    after = is_material(nominal_fit, closed or nominal, found.left)
    verdict = judge(found, closings.seen["transfer"], before=before, after=after)
    if verdict in BLAMING and best is not None:
        covariance = best.covariance() + bootstrap_spread(best, generator)
        if settings.reconsidered and indistinguishable_from_zero(best, covariance, closings.seen.values()):
            verdict = reconsider(verdict, found.nominal, best)
    shown = found.reported(nominal_fit) if verdict in BLAMING else None
    if found.contact_free:
        closings = compare(nominal_fit, *regained(nominal_fit, found.whole_nominal, shown), generator, closings.kinds)
    verdict = in_all_frames(verdict, closings.seen.values(), settings)
    if verdict == "none" and fails_at_impacts(nominal_fit):
        verdict = "unknown"
    shown = shown if verdict in BLAMING else None
    chosen = None if shown is None else best
    return Judgement(
        nominal_fit=nominal_fit,
        found=found,
        allowed=tolerance_of(nominal_fit),
        verdict=verdict,
        chosen=chosen,
        covariance=covariance,
        shown=shown,
        closings=closings.unclosed() if chosen is None else closings,
        minor=minor_effects(nominal_fit, found, chosen) if before else _immaterial(nominal_fit, found),
    )


def _immaterial(nominal_fit: NominalFit, found: Attribution) -> tuple[Minor, ...]:
    """Say what the best hypothesis explains of a gap that is not material."""
    best = found.best
    if best is None:
        return ()
    closes = share_closed(*(excess_left(nominal_fit, one) for one in (found.nominal, best)))
    return (Minor(best.names, found.lack.chance(best.names, gain(found.nominal, best)), closes),)


def minor_effects(nominal_fit: NominalFit, found: Attribution, chosen: Hypothesis | None) -> tuple[Minor, ...]:
    """Say which effect is significant beside those blamed, where it moves predictions by less than the tolerance."""
    left = found.left
    if chosen is None or left is None or not left.significant:
        return ()
    if unexplained_size(left, nominal_fit.noise) > tolerance_of(nominal_fit).position:
        return ()
    row = left.significant[0]
    return (Minor(row.names, row.p_value, row.gain / (row.gain + max(gain(found.nominal, chosen), 0.0))),)
