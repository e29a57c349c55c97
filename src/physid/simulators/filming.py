"""What films motions, behind functions that load it when they are first asked."""

from __future__ import annotations

from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from physid.scenes import Scene


class Studio(Protocol):
    """Draws the bodies of a scene; use it in a `with` statement.

    Attributes:
        background: Image of the empty scene, shape (H, W, 3); another may be put in its place.
    """

    background: NDArray[np.uint8]

    def __enter__(self) -> Self: ...

    def __exit__(self, *error: object) -> None: ...

    def shoot(self, pose: NDArray[np.float64]) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
        """Draw the bodies at poses (N, 7); return the image (H, W, 3) and which body each pixel shows, -1 for none."""
        ...


def open_studio(scene: Scene, faces: NDArray[np.uint8] | None = None) -> Studio:
    """Open a studio for a scene.

    Args:
        scene: What to draw.
        faces: Content patches of the bodies' faces, shape (N, 6, P, P, 3); None for the scene's own paint.

    Raises:
        ValueError: If the scene has no camera.
    """
    from physid.simulators.bullet.camera import Studio as Drawing

    return Drawing(scene, faces)


def film(scene: Scene, pose: NDArray[np.float64]) -> dict[str, NDArray[Any]]:
    """Film poses (T, N, 7).

    Returns:
        `frames` (T, H, W, 3), `mask` of the bodies in the first frame (N, H, W), and `background` (H, W, 3).

    Raises:
        ValueError: If the scene has no camera.
    """
    with open_studio(scene) as studio:
        shots = [studio.shoot(place) for place in pose]
        first = shots[0][1]
        return {
            "frames": np.stack([image for image, _ in shots]),
            "mask": np.stack([first == index for index in range(len(scene.bodies))]),
            "background": studio.background,
        }
