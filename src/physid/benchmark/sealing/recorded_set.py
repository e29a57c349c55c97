"""Make one set of a bank: drawn, recorded, and its label kept."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

from physid.benchmark.bank import SEALED, SETS
from physid.benchmark.films import leave_out_poses
from physid.benchmark.labels import Label
from physid.benchmark.plan import Plan, Task
from physid.benchmark.sealing.invent import inventions
from physid.data.files import write_text
from physid.data.generation.generate import OutOfViewError, generate
from physid.typed_files import read_json_as


def make(folder: Path, plan: Plan, task: Task) -> tuple[str, Label]:
    """Make one set, or return its label where it is there."""
    kept = folder / SEALED / "parts" / f"{task.name}.json"
    if kept.is_file():
        return task.name, read_json_as(Label, kept)
    place, truth = folder / SETS / task.name, folder / SEALED / "truth" / f"{task.name}.yaml"
    for config, effects, label in inventions(plan, task):
        whole = replace(config, truth_file=str(truth))
        try:
            generate(whole, place, effects=effects, quiet=True)
        except OutOfViewError:  # with these effects, in some trajectory
            shutil.rmtree(place, ignore_errors=True)  # of the first trajectory nothing is written
            truth.unlink(missing_ok=True)
            continue
        if task.film:
            leave_out_poses(place)
        write_text(kept, json.dumps(label.to_mapping()) + "\n")
        return task.name, label
    raise ValueError(f"no effect for the role {task.role} shows in set {task.name} as it should; take another seed")
