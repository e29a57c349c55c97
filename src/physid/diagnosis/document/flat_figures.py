"""A diagnosis as flat figures, for whoever compares many of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from physid.diagnosis.document.document import Diagnosis


def figures_of(diagnosis: Diagnosis) -> dict[str, float | str]:
    """Flatten a document: every number and text by its place, say gap/same/before.

    Effects stand under their names; the ranking and the cells of the map, which are tables, are left out.
    """
    plain = diagnosis.to_mapping()
    nested = {
        "verdict": diagnosis.verdict,
        "confidence": diagnosis.confidence,
        "group": ", ".join(diagnosis.group),
        "effects": {effect["name"]: effect["parameters"] for effect in plain["effects"]},
        "site": diagnosis.where.site,
        **{name: plain[name] for name in ("gap", "shrink", "parameters")},
    }
    return dict(_flat(nested, ""))


def _flat(node: Any, place: str) -> list[tuple[str, float | str]]:
    """List the leaves below a place that hold something."""
    if isinstance(node, Mapping):
        return [leaf for name, value in node.items() for leaf in _flat(value, f"{place}/{name}" if place else name)]
    return [] if node is None or node == "" else [(place, node)]
