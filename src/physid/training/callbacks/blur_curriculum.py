"""Blurs images less and less while training proceeds."""

from __future__ import annotations

from typing import final

import lightning as L

from physid.networks.blur import BlurSchedule, GaussianBlur


@final
class BlurCurriculum(L.Callback):
    """Set the module's `blur` at the start of each epoch, and log it as blur/kernel and blur/sigma [px].

    The state follows from the epoch alone, so that a resumed run goes on exactly.

    Args:
        schedule: Blur as a function of the share of training that is done.
        rest: Epochs at the end of the run in which nothing changes any more.
    """

    def __init__(self, schedule: BlurSchedule, rest: int = 0) -> None:
        self.schedule, self.rest = schedule, rest

    def on_train_epoch_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Set and log the blur of this epoch."""
        blur = pl_module.blur
        if not isinstance(blur, GaussianBlur):
            raise TypeError(f"BlurCurriculum needs a module with a GaussianBlur, got {type(blur).__name__}")
        last = (trainer.max_epochs or 1) - self.rest - 1
        blur.set(*self.schedule(trainer.current_epoch / max(last, 1)))
        pl_module.log_dict({"blur/kernel": float(blur.blur.kernel), "blur/sigma": blur.blur.sigma})
