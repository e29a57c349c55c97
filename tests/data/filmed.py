"""Small films of a box on a table, drawn by OpenCV's polygons."""

from __future__ import annotations

import csv
from pathlib import Path

import cv2
import imageio_ffmpeg
import numpy as np
from numpy.typing import NDArray

from physid.scenes.camera import Camera

CAMERA = Camera(192, 144, (0.1, -0.6, 0.7), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 40.0)
EDGES = np.array([0.14, 0.1, 0.06])
FACES = {  # corners by their signs, and a colour
    (0, 0, 1): (200, 40, 40), (0, 0, -1): (9, 9, 9), (1, 0, 0): (40, 160, 40), (-1, 0, 0): (160, 160, 20),
    (0, 1, 0): (30, 120, 160), (0, -1, 0): (40, 40, 200),
}  # fmt: skip
RATE = 30


def table(seed: int = 0) -> NDArray[np.float64]:
    """Return a table with some texture, (H, W, 3)."""
    coarse = np.random.default_rng(seed).uniform(90, 190, (18, 24, 1))
    grey = cv2.resize(coarse, (CAMERA.width, CAMERA.height), interpolation=cv2.INTER_CUBIC)[..., None]
    return np.asarray(grey * [1.0, 0.9, 0.75])


def draw(place: NDArray[np.float64], yaw: float, behind: NDArray[np.float64]) -> NDArray[np.float64]:
    """Draw the box at (x, y) with polygons whose edges are smooth."""
    image, fine = np.array(behind), 4
    c, s = np.cos(yaw), np.sin(yaw)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    middle = np.array([*place, EDGES[2] / 2])
    for normal, colour in FACES.items():
        axis = int(np.flatnonzero(normal)[0])
        others = [each for each in range(3) if each != axis]
        corners = np.zeros((4, 3))
        corners[:, axis] = normal[axis] / 2
        corners[:, others] = [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]
        world = corners * EDGES @ turn.T + middle
        if (turn @ normal) @ (np.array(CAMERA.position) - world.mean(0)) <= 0:
            continue
        cover = np.zeros((fine * CAMERA.height, fine * CAMERA.width), np.float32)
        pixels = fine * CAMERA.project(world)[:, :2] - 0.5
        cv2.fillConvexPoly(cover, (64 * pixels).round().astype(np.int32), 1.0, shift=6)
        share = cover.reshape(CAMERA.height, fine, CAMERA.width, fine).mean((1, 3))[..., None]
        image = image * (1 - share) + share * np.array(colour)
    return image


def path_of(frames: int) -> NDArray[np.float64]:
    """Return where the box is in each frame: once around."""
    angle = np.linspace(0, 1.6 * np.pi, frames)
    return 0.15 * np.stack([np.cos(angle), np.sin(angle)], -1)


def images(frames: int = 24, noise: float = 2.0, drift: float = 0.0) -> list[NDArray[np.uint8]]:
    """Draw a film."""
    generator, behind, drawn = np.random.default_rng(1), table(), []
    for number, place in enumerate(path_of(frames)):
        gain = 1 + drift * (number / frames - 0.5)
        image = gain * draw(place, 0.4, behind) + noise * generator.standard_normal(behind.shape)
        drawn.append(image.round().clip(0, 255).astype(np.uint8))
    return drawn


def write_film(path: Path, frames: list[NDArray[np.uint8]], rate: float = RATE) -> Path:
    """Encode a film as H.264."""
    writer = imageio_ffmpeg.write_frames(
        str(path), (frames[0].shape[1], frames[0].shape[0]), fps=rate, codec="libx264", macro_block_size=1,
        output_params=["-crf", "18", "-pix_fmt", "yuv420p", "-loglevel", "error"],
    )  # fmt: skip
    writer.send(None)
    for image in frames:
        writer.send(np.ascontiguousarray(image))
    writer.close()
    return path


def write_camera(path: Path) -> Path:
    """Write the camera as physid has it."""
    names = ("width", "height", "position", "target", "up", "fov_y")
    values = {name: getattr(CAMERA, name) for name in names}
    path.write_text("".join(f"{name}: {list(v) if isinstance(v, tuple) else v}\n" for name, v in values.items()))
    return path


def write_forces(path: Path, seconds: float) -> Path:
    """Write a log of forces, 100 times a second."""
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["t", "fx", "fy", "fz"])
        writer.writerows([f"{number / 100:.2f}", "1.0", "0", "0"] for number in range(int(100 * seconds)))
    return path


MAPPING = {
    "camera": "camera.yaml", "size": EDGES.tolist(), "mass": 0.5, "force": ["fx", "fy", "fz"],
    "forces": {"file": "{stem}_forces.csv", "time": "t"},
}  # fmt: skip
