"""Diagnoses with each verdict, as documents."""

from __future__ import annotations

import copy
from typing import Any

from physid.diagnosis.document.document import Diagnosis, check_diagnosis

NAMED: dict[str, Any] = {
    "format": "physid-diagnosis",
    "version": 2,
    "verdict": "named",
    "effects": [
        {
            "name": "viscous_drag",
            "site": "dynamics",
            "parameters": {"coefficient": {"value": 0.21, "low": 0.19, "high": 0.23, "unit": "N s/m"}},
        }
    ],
    "group": ["viscous_drag"],
    "confidence": 0.97,
    "ranking": [
        {"effects": ["viscous_drag"], "score": 412.3, "p_value": 0.005},
        {"effects": ["quadratic_drag"], "score": 301.0, "p_value": 0.005},
    ],
    "where": {
        "site": {"perception": 0.0, "actuation": 0.02, "dynamics": 0.96, "contact": 0.02},
        "cells": [
            {"phase": "coast", "body": "block", "dof": "x", "evidence": 11.2},
            {"phase": "slide_fast", "body": "block", "dof": "rz", "evidence": 0.4},
        ],
        "phase": {"coast": 0.9, "slide_fast": 0.1},
    },
    "gap": {
        "unit": "m",
        "floor": 0.0014,
        "tolerance": {"position": 0.0004, "rotation": 0.002},
        "same": {"before": 0.021, "after": 0.0016},
        "transfer": {"before": 0.018, "after": 0.0019},
    },
    "shrink": {
        "same": {"value": 0.99, "low": 0.97, "high": 1.0},
        "transfer": {"value": 0.97, "low": 0.93, "high": 0.99},
        "parts": {"same": {"viscous_drag": 0.99}, "transfer": {"viscous_drag": 0.97}},
    },
    "parameters": {
        "block.mass": {"nominal": 1.11, "with_effect": {"value": 1.002, "low": 0.995, "high": 1.009, "unit": "kg"}}
    },
    "next_experiment": None,
    "minor": [],
    "detectable": [
        {"effect": "quadratic_drag", "parameter": "coefficient", "size": 0.05, "typical": 0.3, "unit": "kg/m"},
        {"effect": "tether", "parameter": "stiffness", "size": None, "typical": 1.0, "unit": "N/m"},
    ],
    "settings": {"lack_of_fit": {"margin": 1.25}},
}

LAWS: list[dict[str, Any]] = [
    {
        "kind": "force",
        "direction": "across the velocity",
        "variable": "speed",
        "variable_unit": "m/s",
        "region": "everywhere",
        "at": [0.1, 0.5, 1.0],
        "size": [0.04, 0.2, 0.41],
        "low": [-0.01, 0.18, 0.37],
        "high": [0.09, 0.22, 0.45],
        "unit": "N",
        "moves": 0.0018,
        "explains": 0.83,
        "gain": 1000.0,
    },
    {
        "kind": "shift",
        "direction": "along x",
        "variable": "time",
        "variable_unit": "s",
        "region": "everywhere",
        "at": [0.0, 0.5],
        "size": [0.001, -0.001],
        "low": [0.0, -0.002],
        "high": [0.002, 0.0],
        "unit": "m",
        "moves": 0.0007,
        "explains": 0.95,
        "gain": 90.0,
    },
]
"""What is missing where the cause is unknown."""


def diagnosis(verdict: str = "named", *, transfer: bool = True) -> dict[str, Any]:
    """Return a valid document with this verdict, with or without a transfer split."""
    made = copy.deepcopy(NAMED)
    made["verdict"] = verdict
    if verdict in ("none", "unknown"):
        made |= {"effects": [], "group": []}
        made["shrink"] = {"same": None, "transfer": None, "parts": {}}
        made["parameters"]["block.mass"]["with_effect"] = None
        for split in ("same", "transfer"):
            made["gap"][split] = {
                "before": 0.0015 if verdict == "none" else made["gap"][split]["before"],
                "after": None,
            }
    if verdict == "unknown":
        made["residual"] = copy.deepcopy(LAWS)
    if verdict == "group":
        made["group"] = ["viscous_drag", "quadratic_drag"]
        made["next_experiment"] = "push at speeds from 0.2 to 2 m/s"
    if not transfer:
        made["gap"]["transfer"] = made["shrink"]["transfer"] = None
        made["shrink"]["parts"].pop("transfer", None)
    return made


def said(verdict: str = "named", *, transfer: bool = True) -> Diagnosis:
    """Return the same as a typed model."""
    return check_diagnosis(diagnosis(verdict, transfer=transfer))
