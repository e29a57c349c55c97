"""Bodies where a model sees them, projected into the picture; differences enlarged until they can be seen."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from physid.diagnosis.report.outlines import Points
from physid.estimation.measurement import moved
from physid.scenes import Scene
from physid.scenes.camera import corners

SMOOTH = 9  # frames over which differences are averaged: the noise of the poses is not the model's
VISIBLE = 0.3  # share of a body's size in the picture that the largest differences shall take up
LARGER = (1, 2, 5, 10, 20)


def smooth(value: Tensor) -> Tensor:
    """Average (T, N, 6) over some frames."""
    flat = value.flatten(1).T[None]
    reach = min(SMOOTH, len(value) - 1 + len(value) % 2)
    mean = torch.nn.functional.avg_pool1d(flat, reach, 1, reach // 2, count_include_pad=False)
    return mean[0].T.reshape(value.shape)


def enlargement(scene: Scene, pose: Tensor, away: Tensor) -> int:
    """Choose how many times as large differences (T, N, 6) are drawn, so that the largest can be seen."""
    own, other = (corners_of(scene, pose, change) for change in (0 * away, -away))
    size = np.ptp(own, axis=-2).max()
    largest = float(np.quantile(np.linalg.norm(other - own, axis=-1), 0.98))
    return max((each for each in LARGER if each * largest <= VISIBLE * size), default=1)


def corners_of(scene: Scene, pose: Tensor, change: Tensor) -> Points:
    """Project the corners of bodies at poses (T, N, 7), moved by changes (T, N, 6); shape (T, N, 8, 2) [pixel]."""
    assert scene.camera is not None
    return scene.camera.project(corners(moved(pose, change).numpy(), scene.sizes))[..., :2]
