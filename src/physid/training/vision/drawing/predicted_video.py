"""Predicted video, beside the recorded one where there is one, as pictures and as a film."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from physid.data.files import write_picture
from physid.data.mp4 import write_mp4
from physid.networks import as_image
from physid.training.vision.model import VideoModel
from physid.training.vision.shown_frames import at_frames

Pixels = NDArray[np.uint8]
SCALE = 2
"""Pixels of a film for one of the recording."""
ROWS = {3: ("recorded", "predicted", "difference"), 1: ("predicted",)}
"""What panels are called, by their number."""


@torch.no_grad()
def compare(model: VideoModel, pose: Tensor, batch: Mapping[str, Any], row: int) -> Pixels:
    """Draw the predicted frames of one trajectory beside the recorded ones.

    Args:
        model: Gives the decoder.
        pose: Rolled-out poses of the batch, shape (B, T, N, 7).
        batch: A batch of the data module, with f frames.
        row: Which trajectory of the batch.

    Returns:
        Recorded, predicted, and the middle grey plus half of predicted less recorded; shape (f, 3, H, W, 3).
    """
    drawn, recorded = _drawn(model, pose, batch, row, batch["shown"][row]), as_image(batch["frames"][row])
    return _pixels(torch.stack([recorded, drawn, (1 + drawn - recorded) / 2], 1))


@torch.no_grad()
def foresee(model: VideoModel, pose: Tensor, batch: Mapping[str, Any], row: int, shown: Sequence[int]) -> Pixels:
    """Draw some frames of one trajectory that nobody has recorded (see `compare`); shape (f, 1, H, W, 3)."""
    return _pixels(_drawn(model, pose, batch, row, torch.tensor(shown))[:, None])


def _drawn(model: VideoModel, pose: Tensor, batch: Mapping[str, Any], row: int, shown: Tensor) -> Tensor:
    """Draw the frames `shown` (f,) of one trajectory of poses (B, T, N, 7): (f, 3, H, W)."""
    only = slice(row, row + 1)
    background = as_image(batch["background"][only])
    drawn: Tensor = model.decoder(at_frames(pose[only].to(background.device), shown[None]), background)[0]
    return drawn


def _pixels(panels: Tensor) -> Pixels:
    """Turn images (..., 3, H, W) in [0, 1] into pixels (..., H, W, 3)."""
    pixels: Pixels = (255 * panels.clamp(0, 1)).round().to(torch.uint8).movedim(-3, -1).cpu().numpy()
    return pixels


def write_film(panels: Pixels, frames_per_second: float, path: Path) -> bool:
    """Write panels (f, n, H, W, 3) side by side as an mp4 film (see `write_mp4`); whether it was written."""
    return write_mp4(path, [enlarge(np.concatenate(list(frame), 1)) for frame in panels], frames_per_second)


def write_rows(panels: Pixels, shown: Sequence[int], wanted: Sequence[int], path: Path) -> None:
    """Draw one row of frames for each panel, as the paper does.

    Args:
        panels: Shape (f, n, H, W, 3), see `ROWS`.
        shown: Which frames of the trajectory they are.
        wanted: Which of them to draw; the nearest that is shown.
        path: The image to write.
    """
    from matplotlib.figure import Figure

    nearest = sorted({int(np.abs(np.asarray(shown) - frame).argmin()) for frame in wanted if frame <= shown[-1]})
    count = panels.shape[1]
    figure = Figure(figsize=(1.6 * len(nearest), 1.7 * count), layout="constrained")
    grid = figure.subplots(count, len(nearest), squeeze=False)
    for column, place in enumerate(nearest):
        for line, axes in enumerate(grid[:, column]):
            axes.imshow(enlarge(panels[place, line]))
            axes.set(xticks=[], yticks=[])
        grid[0, column].set_title(f"frame {shown[place]}", fontsize=8)
    for line, name in enumerate(ROWS[count]):
        grid[line, 0].set_ylabel(name, fontsize=8)
    write_picture(path, figure)


def enlarge(image: Pixels) -> Pixels:
    """Repeat every pixel of an image (H, W, 3) along both sides."""
    return image.repeat(SCALE, 0).repeat(SCALE, 1)
