"""Outlines of boxes drawn over frames of a film."""

from __future__ import annotations

import io
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageChops, ImageDraw, ImageFilter

Pixels = NDArray[np.uint8]
Points = NDArray[np.float64]
Colour = tuple[int, int, int]
SIDE = 384  # [pixel] of a panel
FINER = 2  # outlines are drawn so much larger, and made smaller again: their edges are smooth then
MARGIN, LEAST_SHOWN = 8.0, 32.0  # [pixel of the camera] around what is shown, and the least edge of what is shown
EDGE = (93, 102, 117)  # colour of the frame of a panel
FACES = ((0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5))  # of eight corners


def view_of(points: Points, width: int, height: int) -> tuple[float, float, float]:
    """Find the square of an image that shows some points (..., 2): left and upper end, and length [pixel]."""
    flat = points.reshape(-1, 2)
    low, high = flat.min(0) - MARGIN, flat.max(0) + MARGIN
    length = min(max(float((high - low).max()), LEAST_SHOWN), width, height)
    left, top = np.clip((low + high - length) / 2, 0, np.array([width, height]) - length)
    return float(left), float(top), length


def draw_panel(
    frame: Pixels, view: tuple[float, float, float], outlines: Sequence[tuple[Points, Colour, int]]
) -> Pixels:
    """Draw outlines over a part of a frame.

    Args:
        frame: Image, shape (H, W, 3).
        view: Which part, see `view_of`.
        outlines: Corners of boxes in the image (N, 8, 2) [pixel], colour and width [pixel of the panel] of each.

    Returns:
        Shape (SIDE, SIDE, 3).
    """
    left, top, length = view
    box = (left, top, left + length, top + length)
    panel = Image.fromarray(frame).resize((SIDE, SIDE), Image.Resampling.BICUBIC, box)
    for corners, colour, width in outlines:
        for body in corners:
            line, place = _outline((body - (left, top)) * (SIDE / length), width)
            panel.paste(Image.new("RGB", line.size, colour), place, line)
    pixels = np.array(panel)
    pixels[:, [0, -1]] = pixels[[0, -1]] = EDGE
    return pixels


def _outline(corners: Points, width: int) -> tuple[Image.Image, tuple[int, int]]:
    """Draw the outline of a box with corners (8, 2) as a mask; returns it and where it belongs."""
    low = np.floor(corners.min(0)).astype(int) - width
    extent = np.ceil(corners.max(0)).astype(int) + width - low
    columns, rows = (min(int(each), 4 * SIDE) for each in extent)
    shape = Image.new("L", (FINER * columns, FINER * rows))
    pen = ImageDraw.Draw(shape)
    for face in FACES:
        pen.polygon([tuple(point) for point in (FINER * (corners[list(face)] - low)).tolist()], fill=255)
    line = ImageChops.difference(shape.filter(ImageFilter.MaxFilter(FINER * width // 2 * 2 + 1)), shape)
    return line.resize((columns, rows), Image.Resampling.BOX), (int(low[0]), int(low[1]))


def to_webp(panel: Pixels) -> bytes:
    """Compress a picture."""
    file = io.BytesIO()
    Image.fromarray(panel).save(file, "WEBP", quality=80, method=4)
    return file.getvalue()
