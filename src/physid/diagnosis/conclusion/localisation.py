"""Where the model's prediction leaves the recordings: phase, body, degree of freedom, time, and site."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import cast

import torch
from torch import Tensor

from physid.diagnosis.document.document import SITES, Dof, Phase
from physid.diagnosis.selection.search import Attribution
from physid.diagnosis.testing import LackOfFit
from physid.physics import Site


@dataclass(frozen=True)
class Place:
    """One cell of the map.

    Attributes:
        phase: What the body does.
        body: Name of the body.
        dof: x, y, z, rx, ry or rz, in the axes of the ground.
        evidence: How many standard deviations the gap stands out there.
        share: Part of the gap that a residual wrench in this cell alone explains.
    """

    phase: Phase
    body: str
    dof: Dof
    evidence: float
    share: float


def places(lack: LackOfFit, names: list[str], rounding: float) -> list[Place]:
    """List the cells (phase x body x degree of freedom), those with most evidence first.

    Args:
        lack: What the nominal model leaves unexplained.
        names: Names of the bodies.
        rounding: Gain that is nothing.
    """
    total = max(lack.excess, 1e-9)
    evidence = _shown(lack.cell_gain[:, lack.counted].sum(1), rounding)
    found = [
        Place(
            cast(Phase, cell.phase),
            names[cell.body],
            cast(Dof, cell.dof),
            float(gain.sqrt()),
            min(1.0, float(gain) / total),
        )
        for cell, gain in zip(lack.cells, evidence, strict=True)
        if cell.phase is not None
    ]
    return sorted(found, key=lambda place: -place.evidence)


def over_time(lack: LackOfFit, body: int, rounding: float) -> tuple[Tensor, list[str]]:
    """Return the evidence over pieces of time (from the start of segments) and degrees of freedom, (dof, pieces)."""
    evidence = _shown(lack.cell_gain[:, lack.counted].sum(1), rounding)
    pieces = [
        (cell, gain)
        for cell, gain in zip(lack.cells, evidence, strict=True)
        if cell.piece is not None and cell.body == body
    ]
    dofs = sorted({cell.dof for cell, _ in pieces}, key=("x", "y", "z", "rx", "ry", "rz").index)
    table = torch.zeros(len(dofs), 1 + max((cell.piece or 0) for cell, _ in pieces))
    for cell, gain in pieces:
        table[dofs.index(cell.dof), cell.piece or 0] = gain.sqrt()
    return table, dofs


def _shown(gains: Tensor, rounding: float) -> Tensor:
    """Let gains that are nothing but rounding be zero."""
    return torch.where(gains > rounding, gains, torch.zeros_like(gains))


def sites(found: Attribution, named: bool, laws: Mapping[Site, float]) -> dict[Site, float]:
    """Weigh the sites by how well they explain the gap.

    Where effects are named, a site stands for its best one; where none is, for its best residual law. An explanation
    that falls d behind the best, in squared residual, weighs exp(-d / (2 T)) with a temperature T of 1 % of the best
    gain (10 % where nothing is named) and at least 2, so that near ties share.

    Args:
        found: What the search found.
        named: Whether effects are named.
        laws: By how much the best residual law of each site predicts better.
    """
    settings = found.nominal.settings.localisation
    explained = _hypotheses(found) if named else [([site], gain) for site, gain in laws.items()]
    share = settings.named if named else settings.unnamed
    best = max((gain for _, gain in explained), default=0.0)
    weights = dict.fromkeys(SITES, 0.0)
    for where, gain in explained:
        weight = torch.tensor((gain - best) / (2 * max(settings.least, share * best))).exp()
        for site in where:
            weights[site] += float(weight) / len(where)
    total = sum(weights.values())
    return {site: round(weight / total, 4) if total else 0.0 for site, weight in weights.items()}


def _kinds(found: Attribution) -> dict[str, Site]:
    return {kind.name: kind.site for kind in found.nominal.experiment.predictor.candidates}


def _hypotheses(found: Attribution) -> list[tuple[list[Site], float]]:
    """List hypotheses: the sites of their effects, and what they explain."""
    kinds, base = _kinds(found), float(found.nominal.held_out.sum())
    explained = {row.names: row.gain for row in found.lack.rows}
    explained |= {one.names: base - float(one.held_out.sum()) for one in found.tried}
    return [([kinds[name] for name in names], gain) for names, gain in explained.items()]
