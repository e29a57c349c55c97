"""What bodies and ground look like: textures drawn in code, so that every face and its heading can be told apart."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Colour = tuple[int, int, int]
Image = NDArray[np.uint8]
CELL = 48  # [pixel] texture of one face of a block
TILE = 64  # [pixel] texture of one square of the ground
SQUARE = 0.5  # [m] edge of one square of the ground
CREAM: Colour = (248, 238, 214)
GROUND: tuple[Colour, Colour] = ((196, 202, 204), (186, 193, 196))
# Per body: the colours of the faces +x, -x, +y, -y, +z, -z; the upper face carries the strongest.
PALETTES: tuple[tuple[Colour, ...], ...] = (
    ((233, 148, 58), (150, 52, 40), (206, 105, 48), (176, 78, 44), (216, 84, 46), (118, 62, 92)),
    ((92, 186, 196), (28, 70, 118), (58, 140, 178), (40, 104, 150), (36, 118, 172), (70, 66, 130)),
)
# Corners of the six faces of the unit cube, counter-clockwise seen from outside, in the order of the palettes.
FACES = (
    ((1, -1, -1), (1, 1, -1), (1, 1, 1), (1, -1, 1)),
    ((-1, 1, -1), (-1, -1, -1), (-1, -1, 1), (-1, 1, 1)),
    ((1, 1, -1), (-1, 1, -1), (-1, 1, 1), (1, 1, 1)),
    ((-1, -1, -1), (1, -1, -1), (1, -1, 1), (-1, -1, 1)),
    ((-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1)),
    ((-1, 1, -1), (1, 1, -1), (1, -1, -1), (-1, -1, -1)),
)


def block_atlas(body: int) -> Image:
    """Draw the six faces of a body side by side, shape (CELL, 6 CELL, 3); a cream arrow shows each face's heading."""
    row, column = (np.indices((CELL, CELL)) + 0.5) / CELL
    head = (np.abs(row - 0.5) < 0.75 * (0.88 - column)) & (column > 0.5)
    tail = (np.abs(row - 0.5) < 0.1) & (column > 0.14) & (column <= 0.5)
    border = np.minimum.reduce([row, column, 1 - row, 1 - column]) < 0.05
    faces = []
    for colour in PALETTES[body % len(PALETTES)]:
        face = np.broadcast_to(np.array(colour, dtype=float), (CELL, CELL, 3)).copy()
        face[border] *= 0.75
        face[head | tail] = CREAM
        faces.append(face)
    return np.concatenate(faces, 1).astype(np.uint8)


def dressed_atlas(patches: NDArray[np.uint8]) -> Image:
    """Lay six content patches out as `block_atlas` does, shape (P, 6 P, 3).

    Args:
        patches: Faces -x, +x, -y, +y, -z, +z; of each the columns along the first and the rows along the second of the
            other two axes, in cyclic order; shape (6, P, P, 3).
    """
    count = patches.shape[1]
    across = (np.arange(count) + 0.5) / count
    faces = []
    for square in FACES:
        origin, right, _, up = np.array(square, dtype=float)
        # A texture counts its rows from below.
        point = origin + across[None, :, None] * (right - origin) + across[::-1, None, None] * (up - origin)
        axis = int(np.ptp(np.array(square), axis=0).argmin())
        column, row = (((point[..., (axis + k) % 3] + 1) * count // 2).astype(int) for k in (1, 2))
        faces.append(patches[2 * axis + (origin[axis] > 0), row, column])
    return np.concatenate(faces, 1)


def ground_tile() -> Image:
    """Draw one period of the ground's faint chequer, shape (2 TILE, 2 TILE, 3)."""
    row, column = np.indices((2 * TILE, 2 * TILE)) // TILE
    return np.asarray(np.array(GROUND, dtype=np.uint8)[(row + column) % 2])


def block_mesh(size: Sequence[float]) -> dict[str, list[list[float]] | list[int]]:
    """Return vertices [m], triangles, texture coordinates and normals of a box whose faces show the atlas."""
    half = 0.5 * np.asarray(size)
    corners, texture, normals, triangles = [], [], [], []
    for face, square in enumerate(FACES):
        normal = np.mean(square, axis=0)
        for corner, (u, v) in zip(square, ((0, 0), (1, 0), (1, 1), (0, 1)), strict=True):
            corners.append((half * corner).tolist())
            texture.append([(face + 0.01 + 0.98 * u) / 6, 0.01 + 0.98 * v])
            normals.append(normal.tolist())
        triangles += [4 * face + vertex for vertex in (0, 1, 2, 0, 2, 3)]
    return {"vertices": corners, "indices": triangles, "uvs": texture, "normals": normals}


def ground_mesh(half_width: float) -> dict[str, list[list[float]] | list[int]]:
    """Return a square sheet in the plane z = 0, `half_width` [m] to each side, chequered by `SQUARE`."""
    corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
    return {
        "vertices": [[half_width * x, half_width * y, 0.0] for x, y in corners],
        "indices": [0, 1, 2, 0, 2, 3],
        "uvs": [[half_width * x / (2 * SQUARE), half_width * y / (2 * SQUARE)] for x, y in corners],
        "normals": [[0.0, 0.0, 1.0]] * 4,
    }
