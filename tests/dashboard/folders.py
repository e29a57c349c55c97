"""A folder with one run of each kind, as the commands leave them."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from physid.data.mp4 import write_mp4

CONFIG = """\
name: {name}
model: {{class_path: physid.training.learners.sysid.SysID, init_args: {{segment: {segment}}}}}
data: {{class_path: physid.data.batches.datamodule.RecordingsDataModule, init_args: {{folder: data/push}}}}
"""
DIAGNOSIS: dict[str, Any] = {
    "format": "physid-diagnosis",
    "version": 2,
    "verdict": "group",
    "effects": [
        {
            "name": "viscous_drag",
            "site": "dynamics",
            "parameters": {"coefficient": {"value": 0.2103, "low": 0.1905, "high": 0.2302, "unit": "N s/m"}},
        }
    ],
    "group": ["viscous_drag", "quadratic_drag"],
    "confidence": 0.97,
    "ranking": [{"effects": ["viscous_drag"], "score": 412.3, "p_value": 0.005}],
    "where": {
        "site": {"perception": 0.0, "actuation": 0.02, "dynamics": 0.96, "contact": 0.02},
        "cells": [{"phase": "coast", "body": "block", "dof": "x", "evidence": 11.2}],
    },
    "gap": {
        "unit": "m",
        "floor": 0.0014,
        "tolerance": {"position": 0.0004, "rotation": 0.002},
        "same": {"before": 0.021, "after": 0.0016},
        "transfer": None,
    },
    "shrink": {"same": {"value": 0.99, "low": 0.97, "high": 1.0}, "transfer": None},
    "parameters": {
        "block.mass": {"nominal": 1.11, "with_effect": {"value": 1.0, "low": 0.9, "high": 1.1, "unit": "kg"}}
    },
    "next_experiment": None,
    "minor": [],
    "settings": {"lack_of_fit": {"margin": 1.25}},
}
IDENTIFIABILITY = {
    "config": {"scene": "push", "protocol": "paper"},
    "verdicts": {
        "block.mass": {"kind": "identified", "deviation": 0.02, "alone": 0.001, "combination": None, "combined": None},
        "block.friction": {
            "kind": "combination",
            "deviation": 0.06,
            "alone": 0.004,
            "combination": "block.mass * block.friction^0.38",
            "combined": 0.0015,
        },
    },
}
CELLS = [
    {"cell": "push", "metric": "relative error", "value": 1e-5, "unit": "-", "paper": 0.02, "target": 1e-3},
    {"cell": "collide", "metric": "relative error", "value": 0.02, "unit": "-", "paper": None, "target": 0.01},
]
SCORE = {
    "bank": {"purpose": "score", "sets": 150, "seal": "5c2f" * 16},
    "figures": [
        {"name": "false alarms on effect-free sets", "value": 3.3, "unit": "%", "count": 30, "low": 0.6, "high": 16.7}
        | {"good": "<= 5", "wanted": "<= 1"},
        {"name": "coverage of 90 % intervals, effects", "value": 91.0, "unit": "%", "count": 80, "low": 82, "high": 96}
        | {"good": "80 to 97", "wanted": "87 to 93"},
        {"name": "exact accuracy, medium and up", "value": 71.0, "unit": "%", "count": 60, "low": 58.0, "high": 81.0}
        | {"good": ">= 85", "wanted": ">= 93"},
        {"name": "most work for a diagnosis", "value": None, "unit": "s", "count": 0, "low": None, "high": None}
        | {"good": "", "wanted": ""},
    ],
    "tables": {"By role": [["role", "sets", "flagged"], ["free", "30", "3 %"]], "Empty": [["hidden", "scene"]]},
    "sets": [],
}


def write_fit(folder: Path, estimate: float, seconds: float, segment: int = 30, epochs: int = 8) -> None:
    """Write what a fit leaves: the estimate halves its distance from 0.24 in each epoch."""
    folder.mkdir(parents=True)
    rows = ["epoch,step,train/loss,blur/sigma,lr-Adam,params/block.friction/estimate,params/block.friction/true"]
    for epoch in range(epochs):
        value = estimate + (0.24 - estimate) * 0.5**epoch
        rows += [
            f"{epoch},{epoch},{math.exp(-epoch)},,,,",
            f"{epoch},{epoch},,{8 * 0.9**epoch},0.001,{value},0.12",
        ]
    (folder / "metrics.csv").write_text("\n".join(rows) + "\n")
    (folder / "config.yaml").write_text(CONFIG.format(name=folder.name, segment=segment))
    figures = {
        "params/block.friction/estimate": estimate,
        "params/block.friction/true": 0.12,
        "params/block.friction/low": estimate - 0.001,
        "params/block.friction/high": estimate + 0.001,
        "test/position_error": abs(estimate - 0.12),
        "test/rotation_error": 0.2,
        "seconds": seconds,
        "evaluations": 8.0,
    }
    (folder / "metrics.json").write_text(json.dumps(figures))


def write_film(path: Path) -> None:
    """Write a film of a square that moves to the right."""
    frames = np.full((12, 64, 64, 3), 220, np.uint8)
    for index, frame in enumerate(frames):
        frame[20:40, 4 + 3 * index : 24 + 3 * index] = (230, 90, 40)
    assert write_mp4(path, list(frames), 12)


def write_runs(root: Path) -> Path:
    """Write two fits, one with films, runs of each other kind, and one whose files are damaged; returns `root`."""
    write_fit(root / "push_good", 0.1201, 3.0)
    write_film(root / "push_good" / "prediction_000000.mp4")
    write_fit(root / "push_bad", 0.18, 40.0, segment=60)
    again = [row | {"value": 0.005} for row in CELLS]
    none = DIAGNOSIS | {"verdict": "none", "effects": [], "group": [], "ranking": []}
    for name, file, content in (
        ("reproduce", "results.json", CELLS),
        ("reproduce_again", "results.json", again),
        ("score", "results.json", SCORE),
        ("diagnosis", "diagnosis.json", DIAGNOSIS),
        ("diagnosis_free", "diagnosis.json", none),
        ("identifiability", "identifiability.json", IDENTIFIABILITY),
    ):
        (root / name).mkdir()
        (root / name / file).write_text(json.dumps(content))
    style = "<style>:root { color-scheme: light dark; } body { background: light-dark(#fff, #000); }</style>"
    report = f"{style}<h1>The report</h1>"
    (root / "diagnosis" / "report.html").write_text(report)
    (root / "damaged").mkdir()
    (root / "damaged" / "metrics.json").write_text('{"seconds": 1')
    return root
