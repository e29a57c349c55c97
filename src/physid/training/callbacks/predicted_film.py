"""What a model predicts, drawn: films, and the paper's rows of frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, final

import lightning as L
import torch
from lightning.pytorch.loggers import WandbLogger
from torch import Tensor

from physid.training.vision import Pixels, VideoModel, compare, foresee, predict, write_film, write_rows

PAPER = (0, 30, 60, 120, 180)
"""The frames that the paper shows."""
FILMS = "films"
"""Folder of the films of what was predicted."""


@final
class PredictedFilm(L.Callback):
    """Write prediction_N.mp4 (recorded, predicted, difference) of trajectories N.

    Every frame is drawn from poses that the physics has rolled out from the first frame alone. Testing shows the first
    trajectories, with the paper's rows of frames in frames_N.png, and wandb gets the same files. Predicting shows all
    of them in films/; under planned forces there are predicted frames alone.

    Args:
        count: How many trajectories testing shows.
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
        model, folder = _model_of(pl_module), Path(trainer.default_root_dir)
        with torch.no_grad():
            prediction = predict(model, {name: value[: self.count] for name, value in batch.items()})
        for row, index in enumerate(batch["index"][: self.count].tolist()):
            panels, shown = _panels(model, prediction.rolled, batch, row)
            film, rows = folder / f"prediction_{index:06d}.mp4", folder / f"frames_{index:06d}.png"
            written = write_film(panels, frames_per_second(shown, model.layer.world.time_step), film)
            write_rows(panels, shown, PAPER, rows)
            for logger in trainer.loggers:
                if isinstance(logger, WandbLogger):
                    logger.log_image(f"frames/{index}", [str(rows)])
                    if written:
                        logger.log_video(f"prediction/{index}", [str(film)])

    def on_predict_batch_end(
        self,
        trainer: L.Trainer,
        pl_module: L.LightningModule,
        outputs: Any,
        batch: Mapping[str, Any],
        batch_idx: int,
        dataloader_idx: int = 0,
    ) -> None:
        """Write the films of every trajectory."""
        model, folder = _model_of(pl_module), Path(trainer.default_root_dir) / FILMS
        for row, index in enumerate(batch["index"].tolist()):
            panels, shown = _panels(model, outputs.pose, batch, row)
            rate = frames_per_second(shown, model.layer.world.time_step)
            write_film(panels, rate, folder / f"prediction_{index:06d}.mp4")


def _model_of(module: L.LightningModule) -> VideoModel:
    """Return the model of a module."""
    model = getattr(module, "model", None)
    if not isinstance(model, VideoModel):
        raise TypeError(f"PredictedFilm needs a module with a VideoModel, got {type(model).__name__}")
    return model


def _panels(model: VideoModel, pose: Tensor, batch: Mapping[str, Any], row: int) -> tuple[Pixels, list[int]]:
    """Draw one trajectory of poses (B, T, N, 7), beside the recorded frames where it follows them; and say which."""
    shown = [frame for frame in batch["shown"][row].tolist() if frame < int(batch["length"][row])]
    if "future" in batch:
        apart = shown[-1] - shown[-2] if len(shown) > 1 else 1
        shown = list(range(0, pose.shape[1], apart))
        return foresee(model, pose, batch, row, shown), shown
    return compare(model, pose, batch, row)[: len(shown)], shown


def frames_per_second(shown: Sequence[int], time_step: float) -> float:
    """Return the rate at which a film of the frames `shown` runs as fast as what it shows [1/s]."""
    return max(len(shown) - 1, 1) / (time_step * max(shown[-1] - shown[0], 1))
