"""The bar that a terminal shows while a run goes on."""

from __future__ import annotations

import time
from datetime import timedelta
from typing import Any, final

import lightning as L
from lightning.pytorch.callbacks import RichProgressBar
from lightning.pytorch.callbacks.progress.rich_progress import RichProgressBarTheme

clock = time.monotonic
"""Tells the time [s] by which what is left is reckoned."""


@final
class Progress(RichProgressBar):
    """Lightning's bar with losses in three significant digits (they fall over decades), and without a version.

    Its own columns of time are those of an epoch, which may be a single batch. So the time that all epochs still take
    stands beside them, after the second one: as many of the mean length since the first, in which first values and
    initial states are found, which happens once. A run that settles ends before.
    """

    def __init__(self) -> None:
        super().__init__(theme=RichProgressBarTheme(metrics_format=".3g"))
        self._began: tuple[float, int] | None = None

    def on_train_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Forget the epochs of an earlier call."""
        super().on_train_start(trainer, pl_module)
        self._began = None

    def on_train_epoch_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Note when the first epoch of this call has ended."""
        super().on_train_epoch_end(trainer, pl_module)
        if self._began is None:
            self._began = clock(), trainer.current_epoch + 1

    def left(self, trainer: L.Trainer) -> float | None:
        """Compute how long [s] the epochs that are allowed still take: t (E - e) / e.

        t is the time since the end of the first epoch of this call, e the epochs since, of E; None before one.
        """
        if self._began is None or not trainer.training or trainer.max_epochs in (None, -1):
            return None
        start, first = self._began
        batches: Any = trainer.fit_loop.epoch_loop.batch_progress.current
        done = trainer.current_epoch - first + batches.processed / max(float(trainer.num_training_batches), 1.0)
        allowed = (trainer.max_epochs or 0) - first
        return (clock() - start) * (allowed - done) / done if done >= 1 else None

    def get_metrics(self, trainer: L.Trainer, pl_module: L.LightningModule) -> dict[str, Any]:
        """Return what stands beside the bar; `left` holds for all epochs, and is the most, since a run may settle."""
        metrics = {name: value for name, value in super().get_metrics(trainer, pl_module).items() if name != "v_num"}
        left = self.left(trainer)
        return metrics if left is None else {"left": f"≤{timedelta(seconds=round(left))}", **metrics}
