"""Keep beside a result what looks like a mistake in the recordings behind it."""

from __future__ import annotations

from pathlib import Path
from typing import final

import lightning as L

from physid.data.batches.datamodule import RecordingsDataModule
from physid.inspection.finding import Findings
from physid.training.training_module import TrainingModule


@final
class KeptFindings(L.Callback):
    """Write findings.json before the first epoch.

    Args:
        folder: The run folder.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def on_train_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Write it, in the first process alone."""
        data = trainer.datamodule  # type: ignore[attr-defined]
        if not (isinstance(pl_module, TrainingModule) and isinstance(data, RecordingsDataModule)):
            return
        if trainer.is_global_zero:
            Findings(str(data.recordings.folder), pl_module.findings or ()).write(self._folder)
