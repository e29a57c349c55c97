"""What a film shows before anything is tracked: its background, its noise, and which pixels of a frame are bodies."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from physid.data.importers.video.pictures import Image
from physid.data.importers.video.shadows import OUTSIDE, SMOOTHING, Mixture, extremes, shaded, smoothed, surroundings

MEDIAN = 1.4826  # deviation of a normal variable over its median magnitude
CLEAR = 6.0
"""Standard deviations of the noise, after smoothing, that make a pixel differ from the background."""
LEAST_CLEAR = 6.0
"""Grey levels that it has to differ by in any case: compression leaves patterns that no noise level knows."""
FINE, REACH = 0.7, 4  # [px]: smoothing for the edges of bodies, and how far these reach
CLOSED = 3  # [px]: half as wide as the gaps within a body that are closed
LEAST_AREA = 30  # pixels of a body
AGAIN, AROUND = 2, 20
"""How often the background is found anew without the bodies, and the pixels around them that are left out, for their
shadows."""


def background_of(images: list[Image], count: int) -> Image:
    """Return the empty scene: the median of images that show it behind bodies which move.

    A body that stays in one region for most of the time shines through the median. So the bodies are found in each
    image by what differs from it, and the median is taken again over what is not a body.

    Args:
        images: Of one size, their exposure may drift.
        count: Number of bodies.
    """
    reference = images[0].astype(np.float32)
    even = [np.asarray(image / gain_of(image, reference), dtype=np.float32) for image in images]
    background = median_of(even, [np.zeros(reference.shape[:2], dtype=bool)] * len(even))
    for _ in range(AGAIN):
        behind = smoothed(background)
        hidden = [_covered(image, background, behind, count) for image in images]
        free = median_of(even, hidden)
        background = np.where(np.isfinite(free), free, background)
    return np.asarray(background.round().clip(0, 255), dtype=np.uint8)


def _covered(
    image: Image, background: NDArray[np.float32], behind: NDArray[np.float32], count: int
) -> NDArray[np.bool_]:
    """Return which pixels bodies and their surroundings take, (H, W); all where the bodies cannot be found."""
    try:
        bodies = find_bodies(image, background, count, behind).any(0)
    except ValueError:
        return np.ones(image.shape[:2], dtype=bool)
    return grown(np.asarray(bodies), AROUND)


def grown(mask: NDArray[np.bool_], pixels: int) -> NDArray[np.bool_]:
    """Return what is within so many steps, along rows and columns, of a mask (H, W): its dilation by a cross."""
    if not mask.any():
        return np.zeros_like(mask)
    return np.asarray(ndimage.distance_transform_cdt(np.asarray(~mask), "taxicab") <= pixels)


def median_of(images: list[NDArray[np.float32]], hidden: list[NDArray[np.bool_]]) -> NDArray[np.float32]:
    """Return the median over images (H, W, 3) of what is not hidden (H, W), some rows at a time; NaN where all is."""
    rows = max(1, 2**26 // (len(images) * images[0][0].size * 4))
    parts = []
    for top in range(0, len(images[0]), rows):
        stack = np.stack([np.where(mask[top : top + rows, :, None], np.nan, image[top : top + rows])
                          for image, mask in zip(images, hidden, strict=True)])  # fmt: skip
        stack.sort(0)  # what is hidden comes last
        shown = np.isfinite(stack).sum(0)
        low, high = (
            np.take_along_axis(stack, np.maximum(place, 0)[None], 0)[0] for place in ((shown - 1) // 2, shown // 2)
        )
        parts.append((low + high) / 2)
    return np.concatenate(parts)


def gain_of(image: NDArray[np.generic], background: NDArray[np.generic]) -> float:
    """Return how much brighter an image is than the background: the median ratio, which bodies do not move."""
    behind = extremes(np.asarray(background, dtype=np.float32))[1]
    bright = behind > max(float(np.median(behind)) / 2, 1.0)
    return float(np.median(extremes(np.asarray(image, dtype=np.float32))[1][bright] / behind[bright])) or 1.0


def find_bodies(
    image: Image, background: NDArray[np.generic], count: int, behind: NDArray[np.float32] | None = None
) -> NDArray[np.bool_]:
    """Find the bodies of an image by their difference from the background; shadows are left out.

    Args:
        image: The frame, shape (H, W, 3).
        background: The empty scene, shape (H, W, 3).
        count: How many bodies there are.
        behind: The background, smoothed, if it is known already, which saves time over many frames.

    Returns:
        Masks (N, H, W), the largest body first.

    Raises:
        ValueError: If fewer are found.
    """
    even = image / gain_of(image, background)
    found = silhouettes(even, background, smoothed(even), smoothed(background) if behind is None else behind, count)
    mask = Mixture(even, background, np.asarray(found.any(0))).mask
    bodies = np.zeros_like(found)
    for body, one in zip(bodies, found, strict=True):
        near = surroundings(one)
        body[near] = mask[near] & ndimage.binary_dilation(one[near], iterations=OUTSIDE)
    return bodies


def silhouettes(
    even: NDArray[np.generic],
    background: NDArray[np.generic],
    seen: NDArray[np.float32],
    behind: NDArray[np.float32],
    count: int,
) -> NDArray[np.bool_]:
    """Find about where the bodies are: beside a shadow, up to two pixels too wide.

    The silhouette of a box is convex, so that a part which looks like the background is filled in.

    Args:
        even: The frame, its gain taken out, shape (H, W, 3).
        background: The empty scene, shape (H, W, 3).
        seen: The frame, smoothed (see `smoothed`).
        behind: The background, smoothed.
        count: How many bodies there are.

    Returns:
        Masks (N, H, W), the largest body first.

    Raises:
        ValueError: If fewer are found.
    """
    # White noise that is smoothed so keeps this share of its deviation.
    noise = (
        MEDIAN
        * float(np.median(np.abs(np.asarray(even, dtype=np.float32) - np.asarray(background, dtype=np.float32))))
        / (2 * np.sqrt(np.pi) * SMOOTHING)
    )
    apart = extremes(np.abs(seen - behind))[1] > max(CLEAR * noise, LEAST_CLEAR)
    body = ndimage.binary_opening(apart & ~shaded(seen, behind), iterations=2)
    # Room beyond the border: what is closed without it loses as many pixels where the image cuts a body.
    closed = ndimage.binary_closing(np.pad(body, CLOSED), iterations=CLOSED)[CLOSED:-CLOSED, CLOSED:-CLOSED]
    labels, found = ndimage.label(closed)
    areas = ndimage.sum_labels(np.ones_like(labels), labels, np.arange(1, found + 1)) if found else np.zeros(0)
    order = np.argsort(-np.asarray(areas))[:count]
    if len(order) < count or areas[order[-1]] < LEAST_AREA:
        raise ValueError(
            f"expected {count} bod{'y' if count == 1 else 'ies'} that differ from the background, found "
            f"{int((np.asarray(areas) >= LEAST_AREA).sum())}; begin the film with every body in view and apart, and "
            "name an image of the empty scene (background=empty.png) where a body rests for most of the film"
        )
    chosen = np.isin(labels, order + 1)
    near = surroundings(chosen)
    chosen[near] &= _edged(even[near], background[near])
    return np.stack([_hull((labels == label + 1) & chosen) for label in order])


def _edged(even: NDArray[np.generic], background: NDArray[np.generic]) -> NDArray[np.bool_]:
    """Return which pixels differ by more than half of what their neighbours do, (H, W): edges are where they are.

    A fixed threshold of blurred differences would make bodies of high contrast two pixels wider than they are.
    """
    seen, behind = smoothed(even, FINE), smoothed(background, FINE)
    apart = np.where(shaded(seen, behind), 0, extremes(np.abs(seen - behind))[1])
    return np.asarray(apart > ndimage.maximum_filter(apart, 2 * REACH + 1) / 2)


def _hull(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Fill the convex hull of a mask (H, W)."""
    from physid.data.importers.video.opencv import cv2

    points = np.argwhere(mask)[:, ::-1].astype(np.int32)
    filled = np.zeros(mask.shape, np.uint8)
    cv2.fillConvexPoly(filled, cv2.convexHull(points), 1)
    return filled.astype(bool)
