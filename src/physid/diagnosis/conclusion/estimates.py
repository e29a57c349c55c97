"""Sizes of the effects that are blamed, and unknown parameters without and with them, with 90 % intervals."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from physid.diagnosis.conclusion.judgement import Judgement
from physid.diagnosis.document.document import Estimate, FoundEffect, Refitted
from physid.diagnosis.testing import Hypothesis, bootstrap_spread


def estimate(judged: Judgement, generator: torch.Generator) -> tuple[tuple[FoundEffect, ...], dict[str, Refitted]]:
    """Return the effects that are blamed, and the unknown parameters by name.

    Args:
        judged: The verdict, and what it rests on.
        generator: Randomness of the bootstrap.
    """
    nominal, shown, covariance = judged.found.whole_nominal, judged.shown, judged.covariance
    if shown is None or covariance is None:
        return (), _parameters(nominal, None, None)
    if shown is not judged.chosen:
        covariance = shown.covariance() + bootstrap_spread(shown, generator)
    return _effects(shown, covariance), _parameters(nominal, shown, covariance)


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
