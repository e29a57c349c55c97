"""Blurs images less and less while training proceeds."""

from __future__ import annotations

from typing import final

import lightning as L

from physid.networks import BlurSchedule, GaussianBlur


@final
class BlurCurriculum(L.Callback):
    """Set the module's `blur` at the start of each epoch, and log it as blur/kernel and blur/sigma [px].

    The blur goes in those epochs alone in which images are compared, all the way from its beginning to its end; one
    such epoch alone has the end. It follows from the epoch, so that a resumed run goes on exactly.

    Args:
        schedule: Blur as a function of the share of these epochs that is done.
        before: Epochs at the beginning of the run in which no images are compared.
        after: Epochs at the end of the run in which none are.
    """

    def __init__(self, schedule: BlurSchedule, before: int = 0, after: int = 0) -> None:
        self.schedule, self.before, self.after = schedule, before, after

    def on_train_epoch_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Set the blur of this epoch, and log it if images are compared."""
        blur = pl_module.blur
        if not isinstance(blur, GaussianBlur):
            raise TypeError(f"BlurCurriculum needs a module with a GaussianBlur, got {type(blur).__name__}")
        done, last = trainer.current_epoch - self.before, (trainer.max_epochs or 1) - self.before - self.after - 1
        blur.set(*self.schedule(done / last if last > 0 else 1.0))
        if 0 <= done <= last:
            pl_module.log_dict({"blur/kernel": float(blur.blur.kernel), "blur/sigma": blur.blur.sigma})
