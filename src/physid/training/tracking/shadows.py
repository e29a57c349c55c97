"""The lamp of films: where it stands is learned from the shadows beside bodies whose poses are about known."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import final

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import ndimage, optimize
from torch import Tensor

from physid.data.importers.video.shadows import SMOOTHING, smoothed
from physid.networks import PinholeCamera
from physid.scenes import Ground, Scene
from physid.training.tracking.films import FirstSight
from physid.training.tracking.light import NEAR, has_shadows
from physid.training.vision import CastShadow, camera_of, ground_points

FILMS = 4
"""First frames that the lamp is learned from; each has thousands of pixels in shadow for four unknowns."""
DIRECTIONS, LENGTHS = 24, (0.3, 0.6, 1.0, 1.6, 2.5)
"""Slopes of light that a fit starts from: so many directions, and lengths along the ground per height."""
SPARSE = 4
"""Every so many pixels along each side are looked at to choose a start."""
SOFT = 2.0
"""Softness of edges that a fit starts from [px]."""
EXPLAINED = 0.9
"""Share of the squared light that is missed from which on a shadow is that of one lamp: it explains 0.94 to 0.99 of it
in films on textured tables with noise and compression, and 0.5 to 0.85 in the frame that shows a second lamp best."""
APART = 4
"""Pixels around a mask that are no clear ground: a body's edges, as wide as compression makes them."""


def cast_shadow_of(scene: Scene, sights: Sequence[FirstSight], pose: Tensor) -> CastShadow | None:
    """Learn which shadow the bodies cast.

    What the ground misses of its light, 1 - I . B / B . B for a frame I and background B, is fitted by darkness times
    shade by least squares. A shadow is one lamp's if it explains most of that in every frame.

    Args:
        scene: Gives camera, ground and sizes.
        sights: Some first frames in steady light, their shadows kept, with masks and backgrounds.
        pose: About the poses of the bodies in them, and in others after them, shape (R, N, 7).

    Returns:
        The shadow; None where there is none, or one lamp does not explain it.
    """
    if not any(has_shadows(*sight) for sight in sights):
        return None
    camera, size = camera_of(scene), torch.from_numpy(scene.sizes).float()
    pixel = scene.camera.pixel if scene.camera is not None else 0.0
    missing = [_Missing(camera, scene.ground, size, sight, one) for sight, one in zip(sights, pose, strict=False)]
    shadow = _fit(missing[:FILMS], scene.ground, SOFT * pixel)
    if shadow is None or min(each.explained_by(shadow) for each in missing) < EXPLAINED:
        return None
    return shadow


def _fit(missing: Sequence[_Missing], ground: Ground, softness: float) -> CastShadow | None:
    """Fit slope and softness, and the darkness that is best with them; None where darker ground is brighter."""

    def shade(numbers: NDArray[np.float64], step: int = 1) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
        shadow = CastShadow(ground, (float(numbers[0]), float(numbers[1])), 1.0, math.exp(numbers[2]))
        parts = [each.beside(shadow, step) for each in missing]
        drawn, seen = (np.concatenate([part[place] for part in parts]) for place in (0, 1))
        return drawn, seen, float(np.clip(drawn @ seen / max(drawn @ drawn, 1e-9), 0, 1))

    def left(numbers: NDArray[np.float64], step: int = 1) -> NDArray[np.float64]:
        drawn, seen, darkness = shade(numbers, step)
        return seen - darkness * drawn

    turns = 2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    starts = [
        np.array([long * np.cos(turn), long * np.sin(turn), np.log(softness)]) for turn in turns for long in LENGTHS
    ]
    start = min(starts, key=lambda numbers: float(np.square(left(numbers, SPARSE)).sum()))
    within = ([-np.inf, -np.inf, np.log(softness / 100)], [np.inf, np.inf, np.log(softness * 100)])
    best = optimize.least_squares(left, start, bounds=within, diff_step=[1e-3] * len(start)).x
    darkness = shade(best)[2]
    if darkness == 0:
        return None
    return CastShadow(ground, (float(best[0]), float(best[1])), darkness, math.exp(best[2]))


@final
class _Missing:
    """Light that the ground misses beside the bodies of a frame, as a share of what it has in the background."""

    def __init__(self, camera: PinholeCamera, ground: Ground, size: Tensor, sight: FirstSight, pose: Tensor) -> None:
        frame, mask, background = sight
        self._size, self._pose = size, pose.float()[None, None]
        bodies = np.asarray(mask.any(0))
        reach = NEAR + 2 * int(np.sqrt(bodies.sum()))
        self._clear = ndimage.binary_dilation(bodies, iterations=reach)
        self._clear &= ~ndimage.binary_dilation(bodies, iterations=APART)
        self._point = ground_points(camera, ground, bodies.shape).view(1, *bodies.shape, 2)
        self._lost, self._smooth = _lost(frame, background), _lost(smoothed(frame), smoothed(background))

    def beside(self, shadow: CastShadow, step: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return how deep in shade pixels lie that show the ground, and which share of its light they miss."""
        clear, lost = self._clear[::step, ::step], self._lost[::step, ::step]
        point = self._point[:, ::step, ::step][:, torch.from_numpy(clear)]
        return shadow.shade(point, self._pose, self._size)[0, 0].double().numpy(), lost[clear]

    def explained_by(self, shadow: CastShadow) -> float:
        """Return which share of the squared light that is missed a shadow explains, noise and texture smoothed."""
        shade = shadow.shade(self._point.flatten(1, 2), self._pose, self._size)[0, 0].view(self._lost.shape)
        drawn = ndimage.gaussian_filter(shadow.darkness * shade.double().numpy(), SMOOTHING)[self._clear]
        lost = self._smooth[self._clear]
        return 1 - float(((lost - drawn) ** 2).sum() / max((lost**2).sum(), 1e-12))


def _lost(frame: NDArray[np.generic], background: NDArray[np.generic]) -> NDArray[np.float64]:
    """Return 1 - I . B / B . B of each pixel, (H, W)."""
    image, behind = (np.asarray(each, dtype=np.float64) for each in (frame, background))
    return np.asarray(1 - (image * behind).sum(-1) / np.maximum((behind**2).sum(-1), 1))
