"""Which folders below a folder hold a run."""

from __future__ import annotations

import os
from pathlib import Path

HISTORY, FIGURES, CONFIG, RECORD = "metrics.csv", "metrics.json", "config.yaml", "record.json"
PARAMETERS, DIAGNOSIS, CELLS, REPORT = "parameters.csv", "diagnosis.json", "results.json", "report.html"
IDENTIFIABILITY = "identifiability.json"
LEFT_BY_A_RUN = (HISTORY, FIGURES, DIAGNOSIS, IDENTIFIABILITY, CELLS)
NOT_RUNS = ("wandb", "checkpoints", "trajectories", "sealed", "__pycache__")


def find_runs(root: Path) -> list[Path]:
    """Return every folder in `root`, itself included, that a fit, a benchmark or a diagnosis has left, sorted.

    Args:
        root: Where to look.

    Returns:
        The folders.

    Raises:
        FileNotFoundError: If there is no such folder, or no run in it.
    """
    if not root.is_dir():
        raise FileNotFoundError(f"{root}: expected a folder with runs, found none there")
    found = []
    for place, folders, files in os.walk(root):
        folders[:] = sorted(name for name in folders if name not in NOT_RUNS and not name.startswith("."))
        if set(LEFT_BY_A_RUN) & set(files):
            found.append(Path(place))
    if not found:
        raise FileNotFoundError(f"{root}: expected runs (folders with {', '.join(LEFT_BY_A_RUN)}), found none")
    return sorted(found)
