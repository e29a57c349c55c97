"""Compare what a fit leaves of the recordings with their noise."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol, final

import lightning as L
import torch
from torch import Tensor

from physid.estimation.measurement import TrackingError, pose_difference
from physid.estimation.measurement.misfit import SHARE_OF_NOISE, SHARE_OF_SIZE, Misfit
from physid.scenes import Scene
from physid.training.initial_states.tracker_noise import noise_of_tracker
from physid.training.parameters import Trajectories
from physid.training.training_module import ends_with_epoch

SIGNIFICANT = 3.09
"""Standard normal: noise alone goes beyond it once in a thousand fits."""

HEADING = 0.2
"""Of a pixel, at the ends of the largest edge, by which a turn that is read from films is off in whole stretches."""


class Fitted(Protocol):
    """A module that can tell how its predictions fit."""

    scene: Scene

    def fitted(self) -> tuple[Tensor, Trajectories]:
        """Return the poses predicted last (B, T, N, 7), and the trajectories or segments that they are fitted to."""


@final
class Unexplained(L.Callback):
    """After the last epoch, log how far fitted trajectories leave the recordings beyond noise, and how much that is.

    For position [m] and rotation [rad]: fit/KIND_noise, of one axis; fit/KIND_unexplained, root mean square without the
    noise; fit/KIND_share, relative to the root mean square motion since the first frame; fit/KIND_explained, 1 where
    that is within noise, or too small to matter, else 0. Where poses were read from films, a turn is too small that
    moves the ends of a body by less than a fifth of a pixel.
    """

    def on_train_epoch_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Compare, if this was the last epoch."""
        if not ends_with_epoch(trainer):
            return
        module: Fitted = pl_module  # type: ignore[assignment]
        predicted, cut = module.fitted()
        tracked: Sequence[tuple[float, float] | None] = (None, None)
        if cut.again is not None:
            tracked = left_by_tracking(predicted, cut)
        elif (noise := noise_of_tracker(predicted, cut, module.scene)) is not None:
            tracked = noise.left_by_fit(3.0 * float(cut.real.sum()) * cut.pose.shape[2])
        size = float(module.scene.sizes.max())
        pixel = module.scene.camera.pixel if cut.again is not None and module.scene.camera is not None else 0.0
        apart, moved = pose_difference(predicted, cut.pose), pose_difference(cut.pose, cut.pose[:, :1])
        figures: dict[str, float] = {}
        turn = 2 * max(SHARE_OF_SIZE, HEADING * pixel / size)  # that moves the ends of the largest edge so far
        kinds = (("rotation", 0, turn), ("position", 3, SHARE_OF_SIZE * size))
        for (kind, first, tolerated), left in zip(kinds, tracked, strict=True):
            misfit = Misfit.of(apart[..., first : first + 3], cut.real, left)
            motion = math.sqrt(float(moved[..., first : first + 3][cut.real].square().sum(-1).mean()))
            explained = misfit.score < SIGNIFICANT or misfit.size < max(SHARE_OF_NOISE * misfit.noise, tolerated)
            figures |= {f"{kind}_noise": misfit.noise, f"{kind}_unexplained": misfit.size}
            figures[f"{kind}_explained"] = float(explained)
            if motion > 0:
                figures[f"{kind}_share"] = misfit.size / motion
        for name, value in figures.items():
            pl_module.log(f"fit/{name}", torch.tensor(value, dtype=torch.float64))


def left_by_tracking(predicted: Tensor, cut: Trajectories) -> list[tuple[float, float]]:
    """Return what the error of poses that were read from films leaves of a perfect model (see `Misfit.of`).

    Args:
        predicted: Poses that a fit predicts, shape (B, T, N, 7).
        cut: What they are fitted to, read once and read again.
    """
    assert cut.again is not None and cut.stretch is not None
    real = cut.real.to(cut.pose)
    error = TrackingError.between(cut.pose, cut.again, cut.stretch)
    error = error.sized(pose_difference(cut.pose, predicted), real[..., None].expand(cut.pose.shape[:3]))
    mean, unsure = error.left_by_fit(real)
    return list(zip(mean.tolist(), unsure.tolist(), strict=True))
