"""Films as they would look in steady light: drifting exposure and shadows are taken out of the frames."""

from __future__ import annotations

from typing import final

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from physid.data.importers.video.shadows import Mixture, extremes, shaded, smoothed
from physid.data.importers.video.sights import gain_of, silhouettes
from physid.training.tracking.films import FirstSight, Footage, Image

FEWEST_SHADED = 0.03
"""Area of shadows around the bodies of a first frame, relative to theirs, from which on a film has shadows."""
NEAR = 12  # pixels around a mask that its shadow is looked for in, beside as far as it is wide
UNLIT = 3
"""Pixels by which a shadow is taken out beyond what is clearly one: its edges are soft."""


@final
class SteadyLight(Footage):
    """Films whose frames have the brightness of their background, and no shadows unless these are kept.

    The gain of a frame is the median ratio to the background, which bodies do not move. Pixels that show the background
    with less light in all colours are given its colours, where the first frame has such pixels beside the bodies, and
    pixels that are partly body the light that their other part misses (see `Mixture`).

    Args:
        footage: The films.
        keep_shadows: Whether only the gain is taken out.
    """

    def __init__(self, footage: Footage, *, keep_shadows: bool = False) -> None:
        self._footage, self._keep_shadows = footage, keep_shadows
        self._known: dict[int, tuple[Image, NDArray[np.float32], int, bool]] = {}

    def first(self, index: int) -> FirstSight:
        """Return first frame, masks and background."""
        frame, mask, background = self._footage.first(index)
        return self._lit(index, frame), mask, background

    def with_shadows(self) -> SteadyLight:
        """Return the films with their shadows."""
        return SteadyLight(self._footage, keep_shadows=True)

    def frames(self, index: int, start: int, stop: int) -> Image:
        """Return some frames."""
        return np.stack([self._lit(index, frame) for frame in self._footage.frames(index, start, stop)])

    def _lit(self, index: int, frame: Image) -> Image:
        if index not in self._known:
            first, mask, background = self._footage.first(index)
            shadows = not self._keep_shadows and has_shadows(first, mask, background)
            self._known[index] = background, smoothed(background), len(mask), shadows
        background, behind, bodies, shadows = self._known[index]
        even: NDArray[np.floating] = frame / gain_of(frame, background)
        if shadows:
            even = relit(even, background, behind, bodies)
        return np.asarray(even.round().clip(0, 255), dtype=np.uint8)


def relit(
    even: NDArray[np.floating], background: Image, behind: NDArray[np.float32], bodies: int
) -> NDArray[np.floating]:
    """Take the shadows out of an image (H, W, 3): pixels on the edge of a body get the light that they miss."""
    seen = smoothed(even)
    shadow = ndimage.binary_opening(shaded(seen, behind), iterations=2)
    dark = ndimage.binary_dilation(shadow, iterations=UNLIT) & shaded_softly(seen, behind)
    try:
        mixture = Mixture(even, background, np.asarray(silhouettes(even, background, seen, behind, bodies).any(0)))
    except ValueError:
        return np.where(dark[..., None], background, even)
    lit = even + mixture.missing[..., None] * background
    return np.where(mixture.edge[..., None], lit, np.where((dark & (mixture.body == 0))[..., None], background, even))


def shaded_softly(seen: NDArray[np.float32], behind: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Find what may be the soft edge of a shadow, (H, W): nearly the background, alike in all colours."""
    low, high = extremes((seen + 1) / (behind + 1))
    return np.asarray((high < 1.03) & (high - low < 0.1))


def has_shadows(first: Image, mask: NDArray[np.bool_], background: Image) -> bool:
    """Judge by a first frame whether the bodies have shadows."""
    bodies = np.asarray(mask.any(0))
    reach = NEAR + int(np.sqrt(bodies.sum()))
    around = ndimage.binary_dilation(bodies, iterations=reach) & ~ndimage.binary_dilation(bodies, iterations=2)
    dark = shaded(smoothed(first / gain_of(first, background)), smoothed(background)) & around
    return bool(ndimage.binary_opening(dark, iterations=2).sum() > FEWEST_SHADED * bodies.sum())
