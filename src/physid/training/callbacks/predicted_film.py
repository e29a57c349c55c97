"""What a model predicts of the first tested trajectories: films, and the paper's rows of frames."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, final

import lightning as L
import torch
from lightning.pytorch.loggers import WandbLogger

from physid.training.film import compare, write_film, write_rows
from physid.training.video_model import VideoModel

PAPER = (0, 30, 60, 120, 180)
"""The frames that the paper shows."""


@final
class PredictedFilm(L.Callback):
    """Write prediction_N.mp4 (recorded, predicted, difference) and frames_N.png for the first tested trajectories.

    Every frame is drawn from poses that the physics has rolled out from the first frame alone. wandb gets the same
    files.

    Args:
        count: Of how many trajectories.
    """

    def __init__(self, count: int = 2) -> None:
        self.count = count

    def on_test_batch_end(
        self,
        trainer: L.Trainer,
        pl_module: L.LightningModule,
        outputs: Any,
        batch: Mapping[str, Any],
        batch_idx: int,
        dataloader_idx: int = 0,
    ) -> None:
        """Write the files of the first batch."""
        if batch_idx or not trainer.is_global_zero:
            return
        model, folder = pl_module.model, Path(trainer.default_root_dir)
        if not isinstance(model, VideoModel):
            raise TypeError(f"PredictedFilm needs a module with a VideoModel, got {type(model).__name__}")
        with torch.no_grad():
            prediction = model.predict({name: value[: self.count] for name, value in batch.items()})
        for row, index in enumerate(batch["index"][: self.count].tolist()):
            panels, shown = compare(model, prediction.rolled, batch, row), batch["shown"][row].tolist()
            film, rows = folder / f"prediction_{index:06d}.mp4", folder / f"frames_{index:06d}.png"
            written = write_film(panels, frames_per_second(shown, model.layer.world.time_step), film)
            write_rows(panels, shown, PAPER, rows)
            for logger in trainer.loggers:
                if isinstance(logger, WandbLogger):
                    logger.log_image(f"frames/{index}", [str(rows)])
                    if written:
                        logger.log_video(f"prediction/{index}", [str(film)])


def frames_per_second(shown: list[int], time_step: float) -> float:
    """Return the rate at which a film of the frames `shown` runs as fast as what it shows [1/s]."""
    return max(len(shown) - 1, 1) / (time_step * max(shown[-1] - shown[0], 1))
