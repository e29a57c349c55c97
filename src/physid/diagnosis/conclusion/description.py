"""The content of diagnosis.json, but for the probabilities of causes, which follow from it."""

from __future__ import annotations

import torch

from physid.diagnosis.conclusion.closings import describe_gap, describe_impacts, describe_shrink
from physid.diagnosis.conclusion.decomposition import decompose
from physid.diagnosis.conclusion.estimates import estimate
from physid.diagnosis.conclusion.judgement import Judgement
from physid.diagnosis.conclusion.power import detectable_sizes
from physid.diagnosis.conclusion.where import locate, nowhere
from physid.diagnosis.document.document import FORMAT, VERSION, Diagnosis, Ranked
from physid.diagnosis.residual_law import ResidualLaws, find_residual_laws


def describe(judged: Judgement, next_experiment: str | None, generator: torch.Generator) -> Diagnosis:
    """Say what was judged: the sizes with their intervals, where the gap lies, and how far it closes.

    Args:
        judged: The verdict, and what it rests on.
        next_experiment: What would distinguish the members of a group.
        generator: Randomness of the bootstrap.

    Returns:
        The document, with no confidence yet.
    """
    nominal_fit, found, closings, shown = judged.nominal_fit, judged.found, judged.closings, judged.shown
    settings, left, terms = nominal_fit.settings, found.left or found.lack, found.nominal.experiment.predictor.terms
    parts = {} if shown is None else decompose(nominal_fit, found, closings.seen, closings.kinds, generator)
    effects, parameters = estimate(judged, generator)
    laws = _residual_laws(judged)
    return Diagnosis(
        format=FORMAT,
        version=VERSION,
        verdict=judged.verdict,
        effects=effects,
        group=_group(judged),
        confidence=0.0,
        ranking=_ranking(judged)[: settings.verdict.most_ranks],
        where=nowhere() if judged.verdict == "none" else locate(nominal_fit, found, shown, laws.gains),
        gap=describe_gap(closings, judged.allowed, nominal_fit.noise, describe_impacts(nominal_fit, shown)),
        shrink=describe_shrink(closings, parts),
        parameters=parameters,
        next_experiment=next_experiment,
        minor=judged.minor,
        detectable=tuple(detectable_sizes(left, terms, nominal_fit.noise, judged.allowed, settings)),
        settings=settings.to_mapping(),
        residual=laws.described,
        excess=found.lack.missing,
        null_simulations=len(found.lack.null_best),
    )


def _residual_laws(judged: Judgement) -> ResidualLaws:
    """Describe what is left: by effects that are blamed for a part, or by the model if none is."""
    found = judged.found
    if judged.verdict == "partial" and found.best is not None and found.left is not None:
        return find_residual_laws(judged.nominal_fit, found.best, found.left)
    if judged.verdict == "unknown":
        return find_residual_laws(judged.nominal_fit, found.nominal, found.lack)
    return ResidualLaws()


def _group(judged: Judgement) -> tuple[str, ...]:
    """Name every effect of the hypotheses that cannot be distinguished from the chosen one, its own first."""
    found, chosen = judged.found, judged.chosen
    if chosen is None:
        return ()
    tied = [name for one in (chosen, *found.group) for name in one.names]
    return tuple(dict.fromkeys([*tied, *found.alike]))


def _ranking(judged: Judgement) -> tuple[Ranked, ...]:
    """List hypotheses with the squared residual that they explain: fitted ones by prediction, others by the score test.

    The best fitted one comes first, for it may be a pair whose p-value is that of its gain among null simulations.
    """
    found = judged.found
    base = float(found.nominal.held_out.sum())
    rows = {row.names: row.gain for row in found.lack.rows}
    rows |= {one.names: base - float(one.held_out.sum()) for one in found.tried}
    ranked = sorted(rows.items(), key=lambda row: -row[1])
    return tuple(Ranked(names, gain, found.lack.chance(names, gain)) for names, gain in ranked)
