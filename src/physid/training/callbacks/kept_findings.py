"""Keep beside a result what looks like a mistake in the recordings behind it."""

from __future__ import annotations

from pathlib import Path
from typing import final

import lightning as L

from physid.data.batches.datamodule import RecordingsDataModule
from physid.inspection.finding import Finding, Findings, warn_of
from physid.training.training_module import TrainingModule


@final
class KeptFindings(L.Callback):
    """Write findings.json before the first epoch, and again once the fit has shown more.

    Args:
        folder: The run folder.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def on_train_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Write it, in the first process alone."""
        self._write(trainer, pl_module, ())

    def on_train_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Warn of what the fit shows, and write it as well."""
        if isinstance(pl_module, TrainingModule) and (found := pl_module.findings_of_fit()):
            self._write(trainer, pl_module, found)

    def _write(self, trainer: L.Trainer, pl_module: L.LightningModule, more: tuple[Finding, ...]) -> None:
        data = trainer.datamodule  # type: ignore[attr-defined]
        if not (isinstance(pl_module, TrainingModule) and isinstance(data, RecordingsDataModule)):
            return
        if trainer.is_global_zero:
            warn_of(more, data.recordings.folder)
            Findings(str(data.recordings.folder), (*(pl_module.findings or ()), *more)).write(self._folder)
