"""Where the model's prediction leaves the recordings: phase, body, degree of freedom, time, and site."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from physid.diagnosis.attribute import Attribution
from physid.diagnosis.stage import Stage
from physid.physics.effect import Site

SITES: tuple[Site, ...] = ("perception", "actuation", "dynamics", "contact")
COOL = 0.01  # share of the best gain by which an explanation must fall behind to count e times less


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

    phase: str
    body: str
    dof: str
    evidence: float
    share: float


def places(stage: Stage, names: list[str]) -> list[Place]:
    """List the cells (phase x body x degree of freedom), those with most evidence first.

    Args:
        stage: What the nominal model leaves unexplained.
        names: Names of the bodies.
    """
    total = max(stage.excess, 1e-9)
    gains = stage.cell_gain[:, stage.counted].sum(1).clamp_min(0)
    found = [
        Place(cell.phase, names[cell.body], cell.dof, float(gain.sqrt()), min(1.0, float(gain) / total))
        for cell, gain in zip(stage.cells, gains, strict=True)
        if cell.phase is not None
    ]
    return sorted(found, key=lambda place: -place.evidence)


def over_time(stage: Stage, body: int) -> tuple[Tensor, list[str]]:
    """Return the evidence over pieces of time (from the start of windows) and degrees of freedom, (dof, pieces)."""
    gains = stage.cell_gain[:, stage.counted].sum(1).clamp_min(0)
    pieces = [
        (cell, gain)
        for cell, gain in zip(stage.cells, gains, strict=True)
        if cell.piece is not None and cell.body == body
    ]
    dofs = sorted({cell.dof for cell, _ in pieces}, key=("x", "y", "z", "rx", "ry", "rz").index)
    table = torch.zeros(len(dofs), 1 + max((cell.piece or 0) for cell, _ in pieces))
    for cell, gain in pieces:
        table[dofs.index(cell.dof), cell.piece or 0] = gain.sqrt()
    return table, dofs


def sites(found: Attribution) -> dict[str, float]:
    """Weigh the sites by how well their best effects explain the gap.

    An explanation that falls d behind the best, in squared residual, weighs exp(-d / (2 T)) with a temperature T of 1 %
    of the best gain and at least 2, so that near ties share.
    """
    kinds = {kind.name: kind.site for kind in found.nominal.experiment.predictor.candidates}
    base = float(found.nominal.held_out.sum())
    explained = {row.names: row.gain for row in found.stage.rows}
    explained |= {one.names: base - float(one.held_out.sum()) for one in found.tried}
    best = max(explained.values(), default=0.0)
    weights = dict.fromkeys(SITES, 0.0)
    for names, gain in explained.items():
        weight = torch.tensor((gain - best) / (2 * max(2.0, COOL * best))).exp()
        for name in names:
            weights[kinds[name]] += float(weight) / len(names)
    total = sum(weights.values())
    return {site: round(weight / total, 4) if total else 0.0 for site, weight in weights.items()}
