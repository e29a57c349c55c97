"""Film motions with PyBullet's software renderer, without shadows."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pybullet
from numpy.typing import NDArray
from PIL import Image

from physid.scenes import Scene
from physid.scenes.camera import Camera
from physid.scenes.rotations import between
from physid.scenes.setups.placing import UP
from physid.simulators.bullet.paint import block_atlas, block_mesh, dressed_atlas, ground_mesh, ground_tile

GROUND_HALF_WIDTH = 8.0  # [m]
# Light from above, without gloss: a face keeps its colour while the block turns about the vertical.
LIGHT = {
    "lightDirection": [0.0, 0.0, 1.0],
    "lightAmbientCoeff": 0.62,
    "lightDiffuseCoeff": 0.4,
    "lightSpecularCoeff": 0.0,
}
EVEN_LIGHT = LIGHT | {"lightAmbientCoeff": 1.0, "lightDiffuseCoeff": 0.0}  # for faces that were cut out of films
NO_BODY = -1


class Studio:
    """A PyBullet client that only draws; use it in a `with` statement.

    The ground is drawn once. Each frame draws the bodies alone and lays them over it by their segmentation, which gives
    the same pixels as drawing both (no body is ever behind the ground) in a tenth of the time.

    Args:
        scene: What to draw.
        faces: Content patches of the bodies' faces (see `dressed_atlas`), shape (N, 6, P, P, 3); None for the scene's
            own paint.

    Attributes:
        background: Image of the empty scene, shape (H, W, 3); another may be put in its place.

    Raises:
        ValueError: If the scene has no camera.
    """

    def __init__(self, scene: Scene, faces: NDArray[np.uint8] | None = None) -> None:
        if scene.camera is None:
            raise ValueError(f"scene {scene.name} has no camera; give it one to film it")
        self._camera = scene.camera
        self._light = LIGHT if faces is None else EVEN_LIGHT
        self._client = pybullet.connect(pybullet.DIRECT)
        ground = self._add(ground_mesh(GROUND_HALF_WIDTH), ground_tile())
        normal = np.array(scene.ground.normal)
        self._place(ground, scene.ground.offset * normal, between(UP, normal))
        self.background, _ = self._shoot()
        pybullet.removeBody(ground, physicsClientId=self._client)
        paint = [block_atlas(n) if faces is None else dressed_atlas(faces[n]) for n in range(len(scene.bodies))]
        self._bodies = [self._add(block_mesh(body.size), one) for body, one in zip(scene.bodies, paint, strict=True)]

    def __enter__(self) -> Studio:
        return self

    def __exit__(self, *error: object) -> None:
        pybullet.disconnect(self._client)

    def shoot(self, pose: NDArray[np.float64]) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
        """Draw the bodies at poses (N, 7).

        Returns:
            The image (H, W, 3), and which body each pixel shows (H, W), -1 for none.
        """
        for body, place in zip(self._bodies, pose, strict=True):
            self._place(body, place[:3], place[3:])
        image, number = self._shoot()
        which = np.full(number.shape, NO_BODY)
        for index, body in enumerate(self._bodies):
            which[number == body] = index
        return np.where((which == NO_BODY)[..., None], self.background, image), which

    def _add(self, mesh: dict[str, Any], texture: NDArray[np.uint8]) -> int:
        """Add a textured mesh without physics and return its number."""
        shape = pybullet.createVisualShape(pybullet.GEOM_MESH, **mesh, physicsClientId=self._client)
        body: int = pybullet.createMultiBody(0, -1, shape, physicsClientId=self._client)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "texture.png"
            Image.fromarray(texture).save(path)
            number = pybullet.loadTexture(str(path), physicsClientId=self._client)
        pybullet.changeVisualShape(body, -1, textureUniqueId=number, physicsClientId=self._client)
        return body

    def _place(self, body: int, position: NDArray[np.float64], quaternion: NDArray[np.float64]) -> None:
        pybullet.resetBasePositionAndOrientation(
            body, position.tolist(), quaternion.tolist(), physicsClientId=self._client
        )

    def _shoot(self) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
        """Return the image (H, W, 3) and PyBullet's number of the body at each pixel (H, W)."""
        view, projection = matrices(self._camera)
        width, height = self._camera.width, self._camera.height
        _, _, colour, _, number = pybullet.getCameraImage(
            width,
            height,
            view,
            projection,
            shadow=0,
            renderer=pybullet.ER_TINY_RENDERER,
            physicsClientId=self._client,
            **self._light,
        )
        image = np.asarray(colour, dtype=np.uint8).reshape(height, width, 4)[..., :3]
        return image.copy(), np.asarray(number).reshape(height, width)


def matrices(camera: Camera) -> tuple[list[float], list[float]]:
    """Return the view and the projection matrix of a camera, as PyBullet wants them."""
    distance = float(np.linalg.norm(np.subtract(camera.target, camera.position)))
    view = pybullet.computeViewMatrix(camera.position, camera.target, camera.up)
    projection = list(
        pybullet.computeProjectionMatrixFOV(camera.fov_y, camera.width / camera.height, 0.2 * distance, 4 * distance)
    )
    # The software renderer looks half a pixel beside the centre of each pixel, in both directions (measured: 0.50).
    projection[8] += 1 / camera.width
    projection[9] += 1 / camera.height
    return view, projection
