"""Stop when the physical parameters have settled."""

from __future__ import annotations

from typing import final

import lightning as L
import torch
from torch import Tensor

from physid.training.parameters.physical_parameters import PhysicalParameters


@final
class Converged(L.Callback):
    """End training once an epoch has changed no physical parameter by more than a tolerance.

    A module that chooses the steps of its engine (`settled`) may ask for more: they must have been chosen there.

    Args:
        tolerance: Largest relative change.
    """

    def __init__(self, tolerance: float = 1e-5) -> None:
        if tolerance <= 0:
            raise ValueError(f"tolerance must be positive, got {tolerance}")
        self.tolerance = tolerance
        self._before: Tensor | None = None

    def on_train_epoch_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Remember the parameters."""
        self._before = PhysicalParameters.of(pl_module).logarithm.detach().clone()

    def on_train_epoch_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Compare, and stop."""
        now = PhysicalParameters.of(pl_module).logarithm.detach()
        still = self._before is not None and bool(torch.all((now - self._before).abs() <= self.tolerance))
        if still and (not hasattr(pl_module, "settled") or pl_module.settled()):  # type: ignore[operator]
            trainer.should_stop = True
