"""From what the search found to the content of diagnosis.json."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from physid.diagnosis.conclusion.decomposition import Closings, Kinds, closings_of, decompose
from physid.diagnosis.conclusion.gap import POSITION, ROTATION, Closing, clearer, floor_of
from physid.diagnosis.conclusion.next_experiment import NextExperiment, next_experiment
from physid.diagnosis.conclusion.power import detectable_sizes
from physid.diagnosis.conclusion.verdict import BLAMING, in_all_frames, indistinguishable_from_zero, judge, reconsider
from physid.diagnosis.conclusion.where import locate, nowhere
from physid.diagnosis.document.document import (
    FORMAT,
    VERSION,
    Allowed,
    Diagnosis,
    Errors,
    Estimate,
    FoundEffect,
    Gap,
    Minor,
    Ranked,
    Refitted,
    Rotations,
    Share,
    Shrink,
    Verdict,
)
from physid.diagnosis.document.rounding import rounded
from physid.diagnosis.posterior.evidence import with_probabilities
from physid.diagnosis.reference.nominal_fit import NominalFit
from physid.diagnosis.residual_law import ResidualLaws, find_residual_laws
from physid.diagnosis.selection.comparison import gain
from physid.diagnosis.selection.materiality import excess_left, is_material, share_closed, tolerance_of
from physid.diagnosis.selection.search import Attribution
from physid.diagnosis.testing import Hypothesis, bootstrap_spread


@dataclass(frozen=True)
class Conclusion:
    """A diagnosis, and the hypotheses behind it.

    Attributes:
        diagnosis: What is said.
        chosen: The hypothesis that is blamed; None where nothing or nobody is.
        shown: The same, fitted to all frames.
        further: The experiment that would tell the members of a group apart; None where there is no group.
    """

    diagnosis: Diagnosis
    chosen: Hypothesis | None
    shown: Hypothesis | None
    further: NextExperiment | None = None


def draw_conclusion(nominal_fit: NominalFit, found: Attribution, generator: torch.Generator) -> Conclusion:
    """Judge what the search found: the verdict, the sizes with their intervals, and how far the gap closes.

    Args:
        nominal_fit: The recordings and the fitted nominal model.
        found: What the search found.
        generator: Randomness of the bootstrap.
    """
    settings, terms = nominal_fit.settings, found.nominal.experiment.predictor.terms
    allowed, best, covariance = tolerance_of(nominal_fit), found.best, None
    made = _compare(nominal_fit, found.nominal, best, generator)
    kinds = {split: clearer(one, made[ROTATION][split], allowed) for split, one in made[POSITION].items()}
    seen: Closings = {split: made[kind][split] for split, kind in kinds.items()}
    before = is_material(nominal_fit, found.nominal, found.lack)
    after = is_material(nominal_fit, best or found.nominal, found.left)
    verdict = judge(found, seen["transfer"], before=before, after=after)
    minor = []
    if best is not None and not before:
        closes = share_closed(*(excess_left(nominal_fit, one) for one in (found.nominal, best)))
        minor = [Minor(best.names, found.lack.chance(best.names, gain(found.nominal, best)), closes)]
    if verdict in BLAMING and best is not None:
        covariance = best.covariance() + bootstrap_spread(best, generator)
        if settings.verdict.reconsidered and indistinguishable_from_zero(best, covariance, seen.values()):
            verdict = reconsider(verdict, found.nominal, best)
    shown = found.reported(nominal_fit) if verdict in BLAMING else None
    if found.contact_free:
        made = _compare(nominal_fit, found.whole_nominal, shown, generator)
        seen = {split: made[kind][split] for split, kind in kinds.items()}
    verdict = in_all_frames(verdict, seen.values(), settings.verdict)
    shown = shown if verdict in BLAMING else None
    chosen = None if shown is None else best
    closings = made[POSITION]
    if chosen is None:
        kinds = dict.fromkeys(kinds, POSITION)
        seen = closings = {name: _unclosed(one) for name, one in closings.items()}
    parts_closed = {} if shown is None else decompose(nominal_fit, found, seen, kinds, generator)
    wide = covariance if shown is chosen or shown is None else shown.covariance() + bootstrap_spread(shown, generator)
    further = None if chosen is None else next_experiment(nominal_fit, found)
    laws = _residual_laws(nominal_fit, found, verdict)
    diagnosis = Diagnosis(
        format=FORMAT,
        version=VERSION,
        verdict=verdict,
        effects=() if shown is None or wide is None else _effects(shown, wide),
        group=() if chosen is None else _group(found, chosen),
        confidence=0.0,
        ranking=_ranking(found)[: settings.verdict.most_ranks],
        where=nowhere() if verdict == "none" else locate(nominal_fit, found, shown, laws.gains),
        gap=_gap(nominal_fit, closings, seen, kinds),
        shrink=Shrink(_share(seen["same"]), _share(seen["transfer"]), parts_closed),
        parameters=_parameters(found.whole_nominal, shown, wide),
        next_experiment=further.sentence if further else None,
        minor=tuple(minor),
        detectable=tuple(detectable_sizes(found.left or found.lack, terms, nominal_fit.noise, allowed, settings)),
        settings=settings.to_mapping(),
        residual=laws.described,
        excess=found.lack.missing,
        null_simulations=len(found.lack.null_best),
    )
    return Conclusion(
        rounded(with_probabilities(diagnosis, nominal_fit.observations, settings)), chosen, shown, further
    )


def _residual_laws(nominal_fit: NominalFit, found: Attribution, verdict: Verdict) -> ResidualLaws:
    """Describe what is left: by effects that are blamed for a part, or by the model if none is."""
    if verdict == "partial" and found.best is not None and found.left is not None:
        return find_residual_laws(nominal_fit, found.best, found.left)
    return find_residual_laws(nominal_fit, found.nominal, found.lack) if verdict == "unknown" else ResidualLaws()


def _unclosed(one: Closing | None) -> Closing | None:
    return None if one is None else replace(one, after=None, shrink=None)


def _compare(
    nominal_fit: NominalFit, nominal: Hypothesis, best: Hypothesis | None, generator: torch.Generator
) -> dict[int, Closings]:
    """Compare errors before and after, of positions and of rotations."""
    same_draws = torch.Generator().set_state(generator.get_state())
    return {
        POSITION: closings_of(nominal_fit, nominal, best, generator),
        ROTATION: closings_of(nominal_fit, nominal, best, same_draws, ROTATION),
    }


def _gap(nominal_fit: NominalFit, closings: Closings, seen: Closings, kinds: Kinds) -> Gap:
    """Give the errors before and after on each split; of rotations as well where these show the gap more clearly."""
    allowed, (same, transfer) = tolerance_of(nominal_fit), _errors(closings)
    assert same is not None
    turned = _errors({split: one if kinds[split] == ROTATION else None for split, one in seen.items()})
    rotations = Rotations(floor_of(nominal_fit.noise, ROTATION), *turned) if any(turned) else None
    return Gap("m", floor_of(nominal_fit.noise), Allowed(allowed.position, allowed.rotation), same, transfer, rotations)


def _errors(closings: Closings) -> list[Errors | None]:
    return [None if one is None else Errors(one.before, one.after) for one in closings.values()]


def _share(one: Closing | None) -> Share | None:
    return None if one is None or one.shrink is None else Share(one.shrink.value, one.shrink.low, one.shrink.high)


def _group(found: Attribution, chosen: Hypothesis) -> tuple[str, ...]:
    """Name every effect of the hypotheses that cannot be told from the chosen one, its own first."""
    tied = [name for one in (chosen, *found.group) for name in one.names]
    return tuple(dict.fromkeys([*tied, *found.alike]))


def _ranking(found: Attribution) -> tuple[Ranked, ...]:
    """List hypotheses with the squared residual that they explain: fitted ones by prediction, others by the score test.

    The best fitted one comes first, for it may be a pair whose p-value is that of its gain among null simulations.
    """
    base = float(found.nominal.held_out.sum())
    rows = {row.names: row.gain for row in found.lack.rows}
    rows |= {one.names: base - float(one.held_out.sum()) for one in found.tried}
    ranked = sorted(rows.items(), key=lambda row: -row[1])
    return tuple(Ranked(names, gain, found.lack.chance(names, gain)) for names, gain in ranked)


def _effects(chosen: Hypothesis, covariance: Tensor) -> tuple[FoundEffect, ...]:
    """Give the fitted effects with the 90 % intervals of their parameters."""
    predictor, first = chosen.experiment.predictor, chosen.fit.point.nominal.shape[1] + 1
    reach = chosen.reach(covariance)[first:].tolist()
    made = []
    for name in chosen.names:
        kind = next(kind for kind in predictor.candidates if kind.name == name)
        parameters = {}
        for place, column in enumerate(chosen.columns.tolist()):
            term = predictor.terms[column]
            if term.effect is kind:
                known = term.quantity
                value = float(chosen.fit.point.effects[0, column])
                low, high = value - reach[place], value + reach[place]
                parameters[term.name] = Estimate(value, max(low, known.low), min(high, known.high), known.unit)
        made.append(FoundEffect(name, kind.site, parameters))
    return tuple(made)


def _parameters(nominal: Hypothesis, chosen: Hypothesis | None, covariance: Tensor | None) -> dict[str, Refitted]:
    """Give the unknown parameters, refitted without and with the effects."""
    model = nominal.experiment.predictor.model
    before = model.to_values(nominal.fit.point.nominal[0]).tolist()
    after: Sequence[Estimate | None] = [None] * len(before)
    if chosen is not None and covariance is not None:
        after = _values(chosen, covariance)
    return {name: Refitted(*each) for name, *each in zip(model.unknown, before, after, strict=True)}


def _values(hypothesis: Hypothesis, covariance: Tensor) -> list[Estimate]:
    """Give the unknown parameters of a hypothesis with 90 % intervals, made in the coordinates of the fit."""
    model, point = hypothesis.experiment.predictor.model, hypothesis.fit.point.nominal[0]
    reach = hypothesis.reach(covariance)[: len(point)]
    values = (model.to_values(each).tolist() for each in (point, point - reach, point + reach))
    units = [one.unit or "-" for one in model.coordinates.unknowns]
    return [Estimate(*each) for each in zip(*values, units, strict=True)]
