"""Films of a pushed block that physid has not drawn: light, shadow, a textured table, noise, drifting exposure, H.264.

The motion follows from Coulomb's law in small exact steps (as in examples/write_logs.py). PyBullet's TinyRenderer draws
it with a textured table and a light, twice as fine as the film; a soft shadow, noise of 3 grey levels and a gain that
drifts are added; it is encoded as H.264 with 640 x 480 pixels, 30 frames a second. `physid import mp4`, `track` and
`fit` then do what they do with any film, and what they find is compared with the truth. With `--calibrate` the lens
distorts, and `physid calibrate` measures it from the film of a checkerboard and from points of the table.

    python benchmarks/filmed_block.py --out runs/films --films 3
    python benchmarks/filmed_block.py --out runs/films_60 --rate 60 --calibrate
"""

from __future__ import annotations

import argparse
import csv
import json
import tempfile
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pybullet
from PIL import Image

MASS, FRICTION, GRAVITY = 0.5, 0.21, 9.81
EDGES = (0.12, 0.08, 0.06)
FINE = 3000  # steps [1/s] that frames and forces divide
FORCE_RATE = 500
FINER = 2  # pixels of the drawing along each side of a pixel of the film
WIDTH, HEIGHT, FOV = 640, 480, 40.0
EYE, TARGET, UP = (0.15, -0.9, 1.0), (0.1, 0.05, 0.0), (0.0, 0.0, 1.0)
COLOURS = {
    "blue on wood": ((40, 70, 160), (1.0, 0.8, 0.6)),
    "yellow on slate": ((200, 170, 50), (0.55, 0.6, 0.7)),
    "grey on cloth": ((120, 120, 115), (0.5, 0.8, 0.55)),
}
"""Of the block (red, green, blue), and of the table (shares of its brightness)."""
LENS = (-0.22, 0.08, 0.001, -0.0008, 0.0)
BOARD, SQUARE = (9, 6), 0.03  # inner corners of the checkerboard, side of a square [m]
DARK, SOFT = 0.45, 1.5  # share of the light that a shadow takes; width of its edges [px]
LIGHT = {
    "lightDirection": [3.0, -1.0, 3.0],
    "lightDistance": 10.0,
    "lightAmbientCoeff": 0.5,
    "lightDiffuseCoeff": 0.6,
    "lightSpecularCoeff": 0.1,
}


@dataclass(frozen=True)
class Look:
    """What makes a film hard: noise [grey levels], gain from first to last frame, quality of H.264 (0 best to 51)."""

    noise: float = 3.0
    drift: float = 0.1
    quality: int = 23
    shadow: bool = True
    texture: bool = True
    rate: int = 30
    colours: str = "blue on wood"
    distortion: tuple[float, ...] = ()
    """Of OpenCV: k1, k2, p1, p2, k3."""


def push(generator: np.random.Generator, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """Return forces (n, 2) at the rate of the sensor, and positions (m, 2) at the fine rate, from rest, in a loop."""
    count = int(seconds / 0.25)
    strong = 2.0 * FRICTION * MASS * GRAVITY
    pieces = (
        generator.uniform(0.3, 1.0, count)[:, None]
        * np.array([[1, 0.3], [-1, 0.2], [-0.4, -1], [0.8, 0.7]])[np.arange(count) // 2 % 4]
    )
    force = np.repeat(strong * pieces, FORCE_RATE // 4, axis=0)
    place, speed, path = np.zeros(2), np.zeros(2), []
    for number in range(int(seconds * FINE)):
        path.append(place)
        free = speed + force[number * FORCE_RATE // FINE] / MASS / FINE
        size = float(np.hypot(*free))
        after = free * max(0.0, 1 - FRICTION * GRAVITY / FINE / size) if size else free
        place, speed = place + (speed + after) / 2 / FINE, after
    return force, np.array(path)


def wood(size: int, generator: np.random.Generator, hue: tuple[float, float, float]) -> np.ndarray:
    """Draw a table: stripes, spots and grain."""
    y, x = np.mgrid[:size, :size] / size
    coarse = cv2.resize(generator.standard_normal((24, 24)), (size, size), interpolation=cv2.INTER_CUBIC)
    fine = generator.standard_normal((size, size))
    grey = 0.55 + 0.10 * np.sin(60 * (x + 0.05 * coarse)) + 0.06 * coarse + 0.05 * fine + 0.05 * np.sin(9 * y)
    return (255 * np.clip(grey[..., None] * hue, 0, 1)).astype(np.uint8)


def sticker(generator: np.random.Generator, colour: tuple[int, int, int]) -> np.ndarray:
    """Draw what is on the block."""
    image = np.full((256, 256, 3), colour, np.uint8)
    for _ in range(14):
        a, b = generator.integers(0, 256, 2)
        w, h = generator.integers(20, 90, 2)
        cv2.rectangle(image, (int(a), int(b)), (int(a + w), int(b + h)), generator.integers(20, 240, 3).tolist(), -1)
    return image


class Studio:
    """PyBullet's TinyRenderer with a table and a block."""

    def __init__(self, look: Look, generator: np.random.Generator) -> None:
        self._look, self._client = look, pybullet.connect(pybullet.DIRECT)
        half, (block, table) = [edge / 2 for edge in EDGES], COLOURS[look.colours]
        self._table = self._box([1.5, 1.5, 0.02], [0, 0, -0.02], wood(1024, generator, table) if look.texture else None)
        self._block = self._box(half, [9, 9, 9], sticker(generator, block))

    def _box(self, half: list[float], place: list[float], texture: np.ndarray | None) -> int:
        shape = pybullet.createVisualShape(
            pybullet.GEOM_BOX, halfExtents=half, rgbaColor=[1, 1, 1, 1], physicsClientId=self._client
        )
        body = pybullet.createMultiBody(0, -1, shape, place, physicsClientId=self._client)
        if texture is not None:
            with tempfile.TemporaryDirectory() as folder:
                Image.fromarray(texture).save(f"{folder}/texture.png")
                number = pybullet.loadTexture(f"{folder}/texture.png", physicsClientId=self._client)
            pybullet.changeVisualShape(body, -1, textureUniqueId=number, physicsClientId=self._client)
        return body

    def shoot(self, place: np.ndarray, yaw: float) -> np.ndarray:
        """Draw the block at (x, y), turned, as floats (FINER H, FINER W, 3)."""
        turn = pybullet.getQuaternionFromEuler([0, 0, yaw])
        pybullet.resetBasePositionAndOrientation(
            self._block, [*place, EDGES[2] / 2], turn, physicsClientId=self._client
        )
        width, height = FINER * WIDTH, FINER * HEIGHT
        view = pybullet.computeViewMatrix(EYE, TARGET, UP)
        lens = list(pybullet.computeProjectionMatrixFOV(FOV, WIDTH / HEIGHT, 0.2, 5.0))
        lens[8] += 1 / width  # TinyRenderer takes the upper left corner of a pixel for its centre
        lens[9] += 1 / height
        shot = pybullet.getCameraImage(
            width,
            height,
            view,
            lens,
            shadow=0,
            renderer=pybullet.ER_TINY_RENDERER,
            physicsClientId=self._client,
            **LIGHT,
        )
        image = np.asarray(shot[2], dtype=np.uint8).reshape(height, width, 4)[..., :3].astype(np.float32)
        if self._look.shadow:
            table = np.asarray(shot[4]).reshape(height, width) != self._block
            image *= np.where(table, 1 - DARK * self._shade(place, yaw), 1)[..., None]
        return image

    @staticmethod
    def _shade(place: np.ndarray, yaw: float) -> np.ndarray:
        """Return how dark the shadow on the table is, from 0 to 1 (FINER H, FINER W), soft at its edges."""
        signs = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (0, 1)]) * EDGES
        c, s = np.cos(yaw), np.sin(yaw)
        corners = signs @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + [*place, 0]
        light = np.array(LIGHT["lightDirection"])
        ground = corners - corners[:, 2:] / light[2] * light
        hull = cv2.convexHull(project(ground, FINER).astype(np.float32))[:, 0]
        drawn = np.zeros((FINER * HEIGHT, FINER * WIDTH), np.float32)
        cv2.fillConvexPoly(drawn, (16 * hull).round().astype(np.int32), 1.0, shift=4)
        return cv2.GaussianBlur(drawn, (0, 0), SOFT * FINER)


def project(points: np.ndarray, scale: float = 1.0) -> np.ndarray:
    """Return where points (n, 3) fall in the image [px], by OpenCV's convention."""
    eye, target = np.array(EYE), np.array(TARGET)
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, UP)
    right /= np.linalg.norm(right)
    seen = (points - eye) @ np.stack([right, np.cross(forward, right), forward]).T
    image = seen @ intrinsics(scale).T
    return image[:, :2] / image[:, 2:]


def intrinsics(scale: float = 1.0) -> np.ndarray:
    """Return OpenCV's camera matrix, whose pixel centres are whole numbers."""
    focal = scale * HEIGHT / 2 / np.tan(np.radians(FOV) / 2)
    return np.array([[focal, 0, scale * WIDTH / 2 - 0.5], [0, focal, scale * HEIGHT / 2 - 0.5], [0, 0, 1]])


def film(
    path: Path, places: np.ndarray, yaw: float, look: Look, studio: Studio, generator: np.random.Generator
) -> None:
    """Draw, disturb and encode a film."""
    warp = warping(look.distortion) if look.distortion else None
    images = []
    for number, place in enumerate(places):
        fine = studio.shoot(place, yaw)
        image = fine.reshape(HEIGHT, FINER, WIDTH, FINER, 3).mean((1, 3))
        if warp is not None:
            image = cv2.remap(image, warp[..., 0], warp[..., 1], cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        gain = 1 + look.drift * (number / max(len(places) - 1, 1) - 0.5)
        noisy = gain * image + look.noise * generator.standard_normal(image.shape)
        images.append(noisy.round().clip(0, 255).astype(np.uint8))
    encode(path, images, look)


def warping(distortion: tuple[float, ...]) -> np.ndarray:
    """Return where each pixel of the distorted film looks in the drawing, shape (H, W, 2) [px]."""
    v, u = np.mgrid[:HEIGHT, :WIDTH].astype(np.float32)
    seen = np.stack([u, v], -1).reshape(-1, 1, 2)
    points = cv2.undistortPoints(seen, intrinsics(), np.array(distortion), P=intrinsics())
    return points.reshape(HEIGHT, WIDTH, 2).astype(np.float32)


def film_board(path: Path, look: Look, generator: np.random.Generator, views: int = 40) -> None:
    """Film a checkerboard that is turned about in front of the camera, and moved into all corners of the image."""
    columns, rows = BOARD[0] + 3, BOARD[1] + 3
    squares = (np.add.outer(np.arange(rows), np.arange(columns)) % 2 * 200 + 30).astype(np.uint8)
    squares[[0, -1]], squares[:, [0, -1]] = 230, 230
    fine = np.kron(squares, np.ones((40, 40), np.uint8))
    sides = SQUARE * np.array([columns, rows])
    corners = (np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) - 0.5) * sides
    drawn = np.array([[0, 0], [columns, 0], [columns, rows], [0, rows]], np.float32) * 40 - 0.5
    warp, images = warping(look.distortion), []
    for view in range(views):
        where = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [0, 0]])[view % 5] * [0.13, 0.09]
        turn, _ = cv2.Rodrigues(generator.uniform(-0.5, 0.5, 3))
        points = np.column_stack([corners, np.zeros(4)]) @ turn.T + [*where, generator.uniform(0.5, 0.75)]
        seen = points @ intrinsics(FINER).T
        sharp = cv2.getPerspectiveTransform(drawn, (seen[:, :2] / seen[:, 2:]).astype(np.float32))
        size = (FINER * WIDTH, FINER * HEIGHT)
        image = cv2.warpPerspective(fine, sharp, size, flags=cv2.INTER_AREA, borderValue=120).astype(np.float32)
        image = image.reshape(HEIGHT, FINER, WIDTH, FINER).mean((1, 3))
        image = cv2.remap(image, warp[..., 0], warp[..., 1], cv2.INTER_CUBIC, borderValue=120)[..., None]
        noisy = image + look.noise * generator.standard_normal((HEIGHT, WIDTH, 3))
        images += [noisy.round().clip(0, 255).astype(np.uint8)] * 3
    encode(path, images, look)


def table_points(look: Look) -> list[list[float]]:
    """Return points of the table as someone clicks them, to half a pixel: column, row [px], x, y [m].

    Pixel centres are whole numbers, as in image viewers and in OpenCV.
    """
    places = np.array([[x, y, 0.0] for x in (-0.2, 0.1, 0.4) for y in (-0.2, 0.05, 0.35)])
    ideal = project(places).reshape(-1, 1, 2)
    rays = np.concatenate([cv2.undistortPoints(ideal, intrinsics(), np.zeros(5))[:, 0], np.ones((len(places), 1))], 1)
    seen, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), intrinsics(), np.array(look.distortion))
    return [[*(np.round(2 * uv) / 2).tolist(), x, y] for uv, (x, y, _) in zip(seen[:, 0], places, strict=True)]


def encode(path: Path, images: list[np.ndarray], look: Look) -> None:
    """Encode a film as H.264."""
    import imageio_ffmpeg

    writer = imageio_ffmpeg.write_frames(
        str(path),
        (images[0].shape[1], images[0].shape[0]),
        fps=look.rate,
        codec="libx264",
        macro_block_size=1,
        output_params=["-crf", str(look.quality), "-pix_fmt", "yuv420p", "-loglevel", "error"],
    )
    writer.send(None)
    for image in images:
        writer.send(np.ascontiguousarray(image))
    writer.close()


def make(folder: Path, films: int, look: Look, seconds: float = 3.0, seed: int = 0) -> None:
    """Write films, logs of forces, the camera and the truth."""
    folder.mkdir(parents=True, exist_ok=True)
    studio = Studio(look, np.random.default_rng(99))
    truth = {}
    for number in range(films):
        generator = np.random.default_rng([seed, number])
        force, path = push(generator, seconds)
        path = path - path.mean(0) + [0.1, 0.02]
        yaw = float(generator.uniform(-0.6, 0.6))
        frames = np.arange(int(seconds * look.rate)) * FINE // look.rate
        film(folder / f"film_{number}.mp4", path[frames], yaw, look, studio, generator)
        with (folder / f"film_{number}_forces.csv").open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(["t", "fx", "fy", "fz"])
            writer.writerows(
                [f"{i / FORCE_RATE:.4f}", f"{fx:.6f}", f"{fy:.6f}", "0"] for i, (fx, fy) in enumerate(force)
            )
        truth[f"film_{number}"] = {"place": path[frames].tolist(), "yaw": yaw}
    camera = {"width": WIDTH, "height": HEIGHT, "position": EYE, "target": TARGET, "up": UP, "fov_y": FOV}
    (folder / "camera.yaml").write_text(
        "".join(f"{key}: {list(value) if isinstance(value, tuple) else value}\n" for key, value in camera.items())
    )
    (folder / "truth.json").write_text(json.dumps(truth))
    if look.distortion:
        film_board(folder / "board.mp4", look, np.random.default_rng([seed, 1000]))
        (folder / "points.json").write_text(json.dumps(table_points(look)))
    pybullet.disconnect(studio._client)


def run(folder: Path) -> dict[str, float]:
    """Import, track and fit the films by the command line; return errors in pixels, and the friction."""
    from physid.cli import main
    from physid.data import RecordingSet

    films, read, fitted = folder / "set", folder / "read", folder / "fit"
    commands, camera = [], folder / "camera.yaml"
    if (folder / "board.mp4").exists():
        camera, ground = folder / "calibrated.yaml", (folder / "points.json").read_text()
        board = ["calibrate", str(folder / "board.mp4"), f"--square={SQUARE}", f"--ground={ground}", f"--out={camera}"]
        commands.append([*board, f"--corners={BOARD[0]}x{BOARD[1]}"])
    shot = [str(path) for path in sorted(folder.glob("film_*.mp4"))]
    words = [f"camera={camera}", f"size={list(EDGES)}", f"mass={MASS}", "force=[fx,fy,fz]"]
    words += ["forces.file={stem}_forces.csv", "forces.time=t", f"--out={films}"]
    commands += [["import", "mp4", *shot, *words], ["track", str(films), f"--out={read}", "--quiet"],
                 ["fit", str(read), f"--run-dir={fitted}"]]  # fmt: skip
    for command in commands:
        if main(command) != 0:
            raise SystemExit(f"physid {' '.join(command)} failed")
    truth = json.loads((folder / "truth.json").read_text())
    apart, turned = [], []
    for one, known in zip(RecordingSet(read), truth.values(), strict=True):
        true = np.concatenate([known["place"], np.full((len(known["place"]), 1), EDGES[2] / 2)], 1)
        apart.append(project(one.pose[:, 0, :3]) - project(true))
        yaw = 2 * np.arctan2(one.pose[:, 0, 5], one.pose[:, 0, 6]) - known["yaw"]
        turned.append(np.degrees((yaw + np.pi / 2) % np.pi - np.pi / 2))  # a box looks the same after half a turn
    figures = json.loads((fitted / "metrics.json").read_text())
    for each, turn in zip(apart, turned, strict=True):
        (column, row), (across, down) = each.mean(0), each.std(0)
        print(f"bias {column:.2f} and {row:.2f} px, deviation {across:.2f} and {down:.2f} px, "
              f"heading {turn.mean():.2f} +- {turn.std():.2f} deg")  # fmt: skip
    return {
        "bias_px": float(np.abs([each.mean(0) for each in apart]).max()),
        "rms_about_bias_px": float(np.sqrt(np.mean([each.var(0).sum() for each in apart]))),
        "friction": figures["params/block.friction/estimate"],
        "low": figures["params/block.friction/low"],
        "high": figures["params/block.friction/high"],
    }


def main() -> None:
    """Make films, find out what is filmed, and print it beside the truth."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--out", type=Path, default=Path("runs/films"))
    parser.add_argument("--films", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=2.5)
    parser.add_argument("--seed", type=int, default=0, help="of pushes, headings and noise")
    parser.add_argument("--rate", type=int, default=30, help="frames per second")
    parser.add_argument("--colours", choices=COLOURS, default="blue on wood")
    parser.add_argument("--calibrate", action="store_true", help="distort, and calibrate from a filmed checkerboard")
    parser.add_argument("--lamp", type=float, nargs=3, help="direction of the light, from where it comes: x y z")
    given = parser.parse_args()
    LIGHT["lightDirection"] = given.lamp or LIGHT["lightDirection"]
    look = Look(rate=given.rate, colours=given.colours, distortion=LENS if given.calibrate else ())
    make(given.out, given.films, look, given.seconds, given.seed)
    print(json.dumps(run(given.out), indent=2), f"\ntrue friction {FRICTION}")


if __name__ == "__main__":
    main()
