"""The callbacks of every run of a fit, whatever its configuration names beside them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import lightning as L

from physid.one_writer import CHECKPOINT as CHECKPOINT
from physid.training.callbacks.kept_findings import KeptFindings
from physid.training.callbacks.learning_rates import LearningRates
from physid.training.callbacks.run_state import RunState
from physid.training.runs.checkpoints import LastCheckpoint


def callbacks_of(folder: Path, config: Mapping[str, Any]) -> tuple[RunState, list[L.Callback]]:
    """Return what keeps the state of a run, and all callbacks, this one among them.

    Args:
        folder: Run folder; gets checkpoints after every epoch, and findings.json.
        config: Resolved configuration.
    """
    state = RunState(repr(sorted(config.items())))
    return state, [LastCheckpoint(folder / CHECKPOINT), state, LearningRates(), KeptFindings(folder)]
