"""How far a run is: a bar on a terminal; where there is none, a line from time to time."""

from __future__ import annotations

import sys
import time
from datetime import timedelta
from typing import Any, final

import lightning as L
from lightning.pytorch.callbacks import RichProgressBar
from lightning.pytorch.callbacks.progress.rich_progress import RichProgressBarTheme

from physid.progress.bar import LogLines

clock = time.monotonic
"""Tells the time [s] by which what is left is reckoned."""


class _TimeLeft:
    """The time that all epochs still take, after the second one: as many of the mean length since the first.

    In the first, first values and initial states are found, which happens once. A run that settles ends before.
    """

    def __init__(self) -> None:
        self._began: tuple[float, int] | None = None

    def start(self) -> None:
        """Forget the epochs of an earlier call."""
        self._began = None

    def epoch_ends(self, epoch: int) -> None:
        """Note when the first epoch of this call has ended."""
        if self._began is None:
            self._began = clock(), epoch + 1

    def of(self, trainer: L.Trainer) -> float | None:
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


@final
class Progress(RichProgressBar):
    """Lightning's bar with losses in three significant digits (they fall over decades), and without a version.

    Its own columns of time are those of an epoch, which may be a single batch, so the time that all epochs still take
    stands beside them.
    """

    def __init__(self) -> None:
        super().__init__(theme=RichProgressBarTheme(metrics_format=".3g"))
        self._left = _TimeLeft()

    def on_train_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Forget the epochs of an earlier call."""
        super().on_train_start(trainer, pl_module)
        self._left.start()

    def on_train_epoch_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Note when the first epoch of this call has ended."""
        super().on_train_epoch_end(trainer, pl_module)
        self._left.epoch_ends(trainer.current_epoch)

    def left(self, trainer: L.Trainer) -> float | None:
        """Compute how long [s] the epochs that are allowed still take; None before two have ended."""
        return self._left.of(trainer)

    def get_metrics(self, trainer: L.Trainer, pl_module: L.LightningModule) -> dict[str, Any]:
        """Return what stands beside the bar; `left` holds for all epochs, and is the most, since a run may settle."""
        metrics = {name: value for name, value in super().get_metrics(trainer, pl_module).items() if name != "v_num"}
        left = self.left(trainer)
        return metrics if left is None else {"left": _at_most(left), **metrics}


@final
class ProgressLines(L.Callback):
    """Writes the epoch, the losses and the time left to a log, on standard error, once in a while (see `LogLines`)."""

    def __init__(self) -> None:
        self._left = _TimeLeft()
        self._lines: LogLines | None = None

    def on_train_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Forget the epochs of an earlier call; of several processes the first speaks for all."""
        self._left.start()
        self._lines = LogLines(sys.stderr) if trainer.is_global_zero and sys.stderr else None

    def on_train_epoch_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Write a line."""
        self._left.epoch_ends(trainer.current_epoch)
        if self._lines is None:
            return
        left, last = self._left.of(trainer), trainer.max_epochs
        known = [] if left is None else [f"left {_at_most(left)}"]
        metrics = [f"{name} {float(value):.3g}" for name, value in trainer.progress_bar_metrics.items()]
        of = "" if last in (None, -1) else f"/{last}"
        self._lines.write(", ".join([f"epoch {trainer.current_epoch + 1}{of}", *known, *metrics]))

    def on_train_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Write no more."""
        self._end()

    def on_exception(self, trainer: L.Trainer, pl_module: L.LightningModule, exception: BaseException) -> None:
        """Write no more."""
        self._end()

    def _end(self) -> None:
        if self._lines is not None:
            self._lines.write("")
        self._lines = None


def _at_most(left: float) -> str:
    """Return a time [s] that a run takes at most, since it may settle sooner, as hours, minutes and seconds."""
    return f"≤{timedelta(seconds=round(left))}"
