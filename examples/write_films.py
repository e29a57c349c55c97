"""Write films of a block that is pushed about on a table, the log of the force, and the camera file.

Nothing of physid is in them: the motion follows from Coulomb's law in small exact steps (as in write_logs.py), OpenCV
fills the faces of the block, its shadow and a textured table, noise of 3 grey levels is added, and FFmpeg encodes the
frames as H.264, 30 a second.

    python examples/write_films.py films
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

import cv2
import imageio_ffmpeg
import numpy as np

MASS, FRICTION, GRAVITY = 0.5, 0.21, 9.81  # [kg], [-], [m/s^2]
EDGES = np.array([0.12, 0.08, 0.06])  # [m]
SECONDS, RATE, FORCES, FINE, FILMS = 2.0, 30, 500, 3000, 3  # rates [1/s]
WIDTH, HEIGHT, FOV, FINER = 480, 360, 40.0, 3  # [px], of the height [deg], pixels drawn for one of the film
EYE, TARGET, UP = np.array([0.13, -0.62, 0.72]), np.array([0.0, 0.02, 0.0]), np.array([0.0, 0.0, 1.0])
LIGHT = np.array([0.6, -0.3, 1.0])  # towards the lamp
NOISE = 3.0  # [grey levels]
FACES = {
    (0, 0, 1): (190, 60, 40), (1, 0, 0): (40, 150, 60), (-1, 0, 0): (170, 160, 30), (0, 1, 0): (40, 120, 160),
    (0, -1, 0): (50, 50, 190),
}  # fmt: skip


def push(generator: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return forces (n, 2) at the rate of the sensor, and positions (m, 2) at the fine rate, from rest."""
    ways = np.array([[1, 0.3], [-1, 0.2], [-0.4, -1], [0.8, 0.7]])[np.arange(int(4 * SECONDS)) // 2 % 4]
    size = 2 * FRICTION * MASS * GRAVITY * generator.uniform(0.6, 1.0, len(ways))
    force = np.repeat(size[:, None] * ways, FORCES // 4, axis=0)
    place, speed, path = np.zeros(2), np.zeros(2), []
    for number in range(int(SECONDS * FINE)):
        path.append(place)
        free = speed + force[number * FORCES // FINE] / MASS / FINE
        fast = float(np.hypot(*free))
        after = free * max(0.0, 1 - FRICTION * GRAVITY / FINE / fast) if fast else free
        place, speed = place + (speed + after) / 2 / FINE, after
    return force, np.array(path)


def project(points: np.ndarray) -> np.ndarray:
    """Return where points (n, 3) fall in the drawing [px], counted from its upper left corner."""
    forward = (TARGET - EYE) / np.linalg.norm(TARGET - EYE)
    right = np.cross(forward, UP) / np.linalg.norm(np.cross(forward, UP))
    x, y, depth = ((points - EYE) @ np.stack([right, np.cross(forward, right), forward]).T).T
    focal = HEIGHT / 2 / np.tan(np.radians(FOV) / 2)
    return FINER * np.stack([WIDTH / 2 + focal * x / depth, HEIGHT / 2 + focal * y / depth], -1)


def fill(image: np.ndarray, points: np.ndarray, colour: tuple[float, ...]) -> None:
    """Fill a convex polygon of the drawing."""
    corners = cv2.convexHull((project(points) - 0.5).astype(np.float32))[:, 0]
    cv2.fillConvexPoly(image, (64 * corners).round().astype(np.int32), colour, shift=6)


def draw(place: np.ndarray, yaw: float, table: np.ndarray) -> np.ndarray:
    """Draw the block at (x, y), turned about the vertical, with its shadow."""
    c, s = np.cos(yaw), np.sin(yaw)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    signs = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    corners = signs * EDGES @ turn.T + [*place, EDGES[2] / 2]
    light = np.ones(table.shape[:2], np.float32)
    fill(light, corners - corners[:, 2:] / LIGHT[2] * LIGHT, (0.6,))
    image = table * cv2.GaussianBlur(light, (0, 0), FINER)[..., None]
    for normal, colour in FACES.items():
        face = corners[signs @ normal > 0.4]
        if (turn @ normal) @ (EYE - face.mean(0)) > 0:
            fill(image, face, colour)
    return image.reshape(HEIGHT, FINER, WIDTH, FINER, 3).mean((1, 3))


def write_csv(path: Path, force: np.ndarray) -> None:
    """Write the log of the force."""
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["t", "fx", "fy", "fz"])
        writer.writerows([f"{row / FORCES:.4f}", f"{x:.6f}", f"{y:.6f}", "0"] for row, (x, y) in enumerate(force))


def main(folder: Path) -> None:
    """Write all films."""
    folder.mkdir(parents=True, exist_ok=True)
    rough = cv2.resize(np.random.default_rng(9).uniform(90, 190, (36, 48)), (FINER * WIDTH, FINER * HEIGHT))
    table = (rough[..., None] * [1.0, 0.9, 0.75]).astype(np.float32)
    for number in range(FILMS):
        generator = np.random.default_rng(number)
        force, path = push(generator)
        frames = path[np.arange(int(SECONDS * RATE)) * FINE // RATE] - path.mean(0)
        yaw = float(generator.uniform(-0.6, 0.6))
        writer = imageio_ffmpeg.write_frames(
            str(folder / f"film_{number}.mp4"), (WIDTH, HEIGHT), fps=RATE, codec="libx264", macro_block_size=1,
            output_params=["-crf", "20", "-pix_fmt", "yuv420p", "-loglevel", "error"],
        )  # fmt: skip
        writer.send(None)
        for place in frames:
            image = draw(place, yaw, table) + NOISE * generator.standard_normal((HEIGHT, WIDTH, 3))
            writer.send(np.ascontiguousarray(image.round().clip(0, 255).astype(np.uint8)))
        writer.close()
        write_csv(folder / f"film_{number}_forces.csv", force)
    lens = {"width": WIDTH, "height": HEIGHT, "fov_y": FOV}
    place = {"position": EYE.tolist(), "target": TARGET.tolist(), "up": UP.tolist()}
    (folder / "camera.yaml").write_text("".join(f"{key}: {value}\n" for key, value in (lens | place).items()))
    print(f"{folder}: {FILMS} films of {int(SECONDS * RATE)} frames; true friction {FRICTION}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", nargs="?", type=Path, default=Path("films"))
    main(parser.parse_args().folder)
