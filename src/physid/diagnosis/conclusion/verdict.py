"""The verdict, and how sure it is."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

from physid.diagnosis.conclusion.gap import Closing, Interval
from physid.diagnosis.conclusion.localisation import Place
from physid.diagnosis.conclusion.materiality import Tolerance
from physid.diagnosis.selection.attribution import Attribution, unexplained
from physid.diagnosis.selection.evidence import complete, explained
from physid.diagnosis.settings.conclusion import VerdictSettings
from physid.diagnosis.settings.settings import Settings

Name = Literal["none", "named", "group", "partial", "unknown"]


@dataclass(frozen=True)
class Estimate:
    """A parameter with its 90 % interval."""

    value: float
    low: float
    high: float
    unit: str


@dataclass(frozen=True)
class Found:
    """An effect with its parameters."""

    name: str
    site: str
    parameters: dict[str, Estimate]


@dataclass(frozen=True)
class Diagnosis:
    """What a diagnosis says; `to_mapping` gives the content of diagnosis.json.

    Attributes:
        verdict: none, named, group, partial or unknown.
        effects: What is named.
        group: Effects that the recordings cannot tell apart, the named ones included.
        confidence: Calibrated probability that the verdict is right.
        ranking: (effects, score, p-value), best first.
        sites: Weight of each site.
        places: Cells of the map.
        floor: [m].
        same: Closing on the same protocol.
        transfer: Closing on another protocol, None where there is none.
        parameters: Nominal estimate, and with the effect (None without one), of each unknown parameter.
        next_experiment: What would tell a group apart.
        tolerance: How far a model may leave the recordings before anything is blamed.
        minor: What was significant and is not blamed, because the gap is not material: effects, p-value, and the share
            of the excess over the floor that they close.
        settings: What decided.
    """

    verdict: Name
    effects: list[Found]
    group: list[str]
    confidence: float
    ranking: list[tuple[tuple[str, ...], float, float]]
    sites: dict[str, float]
    places: list[Place]
    floor: float
    same: Closing | None
    transfer: Closing | None
    parameters: dict[str, tuple[float, Estimate | None]]
    next_experiment: str | None
    tolerance: Tolerance
    minor: list[tuple[tuple[str, ...], float, float]]
    settings: Settings

    def to_mapping(self) -> dict[str, Any]:
        """Return the content of diagnosis.json."""
        return {
            "format": "physid-diagnosis",
            "version": 2,
            "verdict": self.verdict,
            "effects": [
                {
                    "name": one.name,
                    "site": one.site,
                    "parameters": {name: _estimate(value) for name, value in one.parameters.items()},
                }
                for one in self.effects
            ],
            "group": self.group,
            "confidence": _round(self.confidence),
            "ranking": [
                {"effects": list(names), "score": _round(score), "p_value": _round(p)}
                for names, score, p in self.ranking[: self.settings.verdict.most_ranks]
            ],
            "where": {
                "site": {name: _round(weight) for name, weight in self.sites.items()},
                "cells": [
                    {"phase": one.phase, "body": one.body, "dof": one.dof, "evidence": _round(one.evidence)}
                    for one in self.places[: self.settings.verdict.most_cells]
                ],
            },
            "gap": {
                "unit": "m",
                "floor": _round(self.floor),
                "tolerance": {"position": _round(self.tolerance.position), "rotation": _round(self.tolerance.rotation)},
                "same": _closing(self.same),
                "transfer": _closing(self.transfer),
            },
            "shrink": {"same": _shrink(self.same), "transfer": _shrink(self.transfer)},
            "parameters": {
                name: {"nominal": _round(before), "with_effect": None if after is None else _estimate(after)}
                for name, (before, after) in self.parameters.items()
            },
            "next_experiment": self.next_experiment,
            "minor": [
                {"effects": list(names), "p_value": _round(p), "closes": _round(share)}
                for names, p, share in self.minor
            ],
            "settings": self.settings.to_mapping(),
        }


def judge(found: Attribution, transfer: Closing | None, *, before: bool, after: bool) -> Name:
    """Turn what the search found into a verdict.

    Args:
        found: What the search found.
        transfer: How far the gap closes on another protocol.
        before: Whether the nominal model leaves the recordings by more than the tolerance.
        after: Whether the best hypothesis still does.
    """
    if not before:
        return "none"
    if found.best is None or found.left is None:
        return "unknown" if unexplained(found) else "none"
    settings = found.nominal.settings.verdict
    whole = not after or complete(found.nominal, found.best, found.lack, found.left)
    open_share = found.left.missing / explained(found.nominal, found.best, found.lack)
    if not _carries(transfer, settings) or (not whole and open_share > settings.partly):
        return "unknown"
    if not whole:
        return "partial" if transfer is None or _open(transfer, settings) <= settings.partly else "unknown"
    return "group" if len(found.group) > 1 or found.alike else "named"


def _carries(transfer: Closing | None, settings: VerdictSettings) -> bool:
    """Return whether another protocol contradicts what was found: a gap is left there, and less than a half closes."""
    if transfer is None or _open(transfer, settings) == 0:
        return True
    return transfer.shrink is not None and transfer.shrink.high > settings.carries


def _open(closing: Closing, settings: VerdictSettings) -> float:
    """Return the share of a gap that is left, 0 if there is none or little."""
    if closing.shrink is None or closing.after is None or closing.after < settings.nearly * closing.floor:
        return 0.0
    return 1 - closing.shrink.value


def _estimate(one: Estimate) -> dict[str, Any]:
    return {"value": _round(one.value), "low": _round(one.low), "high": _round(one.high), "unit": one.unit}


def _closing(one: Closing | None) -> dict[str, float | None] | None:
    if one is None:
        return None
    return {"before": _round(one.before), "after": None if one.after is None else _round(one.after)}


def _shrink(one: Closing | None) -> dict[str, float] | None:
    interval: Interval | None = None if one is None else one.shrink
    if interval is None:
        return None
    return {"value": _round(interval.value), "low": _round(interval.low), "high": _round(interval.high)}


def _round(value: float) -> float:
    """Keep five digits."""
    return float(f"{value:.5g}") if math.isfinite(value) else value
