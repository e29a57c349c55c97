"""The learning rates over the epochs."""

from __future__ import annotations

from typing import final

import lightning as L


@final
class LearningRates(L.Callback):
    """Log lr/NAME for each group of parameters after every epoch; a group without a rate (Gauss-Newton) has none."""

    def on_train_epoch_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Log the rates of the epoch that ends."""
        for optimizer in trainer.optimizers:
            for number, group in enumerate(optimizer.param_groups):
                if "lr" in group:
                    pl_module.log(f"lr/{group.get('name', number)}", float(group["lr"]))
