"""Shadows: the background with less light. What is a body beside one, and what a pixel on its edge holds of each."""

from __future__ import annotations

from typing import final

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

SMOOTHING = 1.5  # [px], for telling bodies and shadows from noise
SHADE, GREYER = (0.25, 0.97), 0.08
"""A shadow leaves such a share of the light, alike in all colours: their shares differ by so much at most."""
EDGE = 1.0  # [px]: smoothing of colours on edges
STEEP = 3.0
"""How much sharper an edge is than the colours on it, which films keep for every other pixel only."""
INSIDE, OUTSIDE = 5, 2
"""Pixels inside and outside a rough silhouette from which on a pixel is all body, or all background: the silhouette may
be two pixels too wide, and films keep colours for every other pixel only."""
AROUND = 12  # pixels beside a silhouette that are inspected
STEADY = 0.01
"""Weight of the light around a pixel against the colours in it, where the body has the background's colour."""


def smoothed(image: NDArray[np.generic], width: float = SMOOTHING) -> NDArray[np.float32]:
    """Blur an image (H, W, 3) by so much that noise and patterns of compression are small beside shadows and bodies."""
    return np.asarray(ndimage.gaussian_filter(np.asarray(image, dtype=np.float32), (width, width, 0)))


def shaded(seen: NDArray[np.float32], behind: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Find shadows, (H, W): the background with less light, alike in all colours.

    Args:
        seen: The frame, its gain taken out, smoothed.
        behind: The background, smoothed.
    """
    low, high = extremes((seen + 1) / (behind + 1))
    return np.asarray((low > SHADE[0]) & (high < SHADE[1]) & (high - low < GREYER))


def extremes(colours: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the least and the greatest of three colours (H, W, 3), each (H, W); reducing the last axis is slow."""
    one, two, three = (colours[..., each] for each in range(3))
    return np.minimum(np.minimum(one, two), three), np.maximum(np.maximum(one, two), three)


@final
class Mixture:
    """What each pixel holds of a body and of the background in whatever light: I = a F + v B.

    F is the colour of the body at the nearest pixel well inside it, B the background. Three colours determine the share
    a of the body and the brightness v of the background beside it, whatever shadow lies there: a shadow moves a colour
    towards black, along B, and leaves a alone (the chromaticity distortion of Horprasert, Harwood & Davis 1999, for
    pixels of two colours). Where F is a multiple of B, v = (1 - a) s with the light s around the body decides.

    Args:
        even: Image with the gain taken out, shape (H, W, 3).
        background: The empty scene, shape (H, W, 3).
        silhouette: About the body, up to two pixels too wide, shape (H, W).

    Attributes:
        body: a where a shadow lies beside the body, elsewhere 1 in the silhouette and 0 outside, shape (H, W).
        missing: Light of the background that pixels on the edge miss by a shadow, as a share, shape (H, W).
        edge: Pixels in a shadow that may hold both, shape (H, W).
    """

    def __init__(
        self, even: NDArray[np.generic], background: NDArray[np.generic], silhouette: NDArray[np.bool_]
    ) -> None:
        self.body, self.missing = np.zeros(silhouette.shape), np.zeros(silhouette.shape)
        self.edge = np.zeros(silhouette.shape, dtype=bool)
        self._near = (slice(0), slice(0))
        if not silhouette.any():
            return
        near = self._near = surroundings(silhouette)
        image, behind, silhouette = smoothed(even[near], EDGE), smoothed(background[near], EDGE), silhouette[near]
        depth = ndimage.distance_transform_edt(silhouette)
        core = depth >= min(INSIDE, float(depth.max()) / 2)
        zone = np.asarray(ndimage.binary_dilation(silhouette, iterations=OUTSIDE))
        front = image[_nearest(core)]
        ff, bb, fb = (front**2).sum(-1), (behind**2).sum(-1), (front * behind).sum(-1)
        fi, bi = (front * image).sum(-1), (behind * image).sum(-1)
        around = (bi / np.maximum(bb, 1)).clip(0, 1)[_nearest(~zone)]
        # Least squares with one more equation, v + a s = s, of weight STEADY B^2.
        weight = STEADY * bb
        aa, av, vv = ff + weight * around**2, fb + weight * around, bb + weight
        one, two = fi + weight * around**2, bi + weight * around
        determinant = np.maximum(aa * vv - av**2, 1e-6)
        share, light = ((vv * one - av * two) / determinant).clip(0, 1), (aa * two - av * one) / determinant
        share = np.where(zone, np.where(core, 1, share), 0)
        # Colours on the edge are softer than the edge; the light beside it is that of the background's parts around.
        sharp = ((share - 0.5) * STEEP + 0.5).clip(0, 1)
        parts = [
            ndimage.gaussian_filter(part, SMOOTHING)
            for part in (np.where(zone & ~core, light, 0), np.where(zone, 1 - share, 0))
        ]
        beside = (parts[0] / np.maximum(parts[1], 1e-3)).clip(SHADE[0], 1)
        dim = zone & ~core & (beside < SHADE[1])
        self.body[near] = np.where(dim, share, silhouette)
        self.edge[near] = dim
        self.missing[near] = np.where(dim, (1 - sharp) * (1 - beside), 0)

    @property
    def mask(self) -> NDArray[np.bool_]:
        """Pixels that are more body than background, (H, W), without holes."""
        whole = np.zeros(self.body.shape, dtype=bool)
        whole[self._near] = ndimage.binary_fill_holes(ndimage.binary_opening(self.body[self._near] > 0.5))
        return whole


def surroundings(silhouette: NDArray[np.bool_]) -> tuple[slice, slice]:
    """Return the rows and columns of the pixels of a mask (H, W), and some around them."""
    found = [np.flatnonzero(silhouette.any(axis)) for axis in (1, 0)]
    rows, columns = (slice(max(0, int(each[0]) - AROUND), int(each[-1]) + AROUND + 1) for each in found)
    return rows, columns


def _nearest(pixels: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return row and column of the nearest of some pixels, each (H, W)."""
    row, column = ndimage.distance_transform_edt(~pixels, return_distances=False, return_indices=True)
    return row, column
