"""Camera files of OpenCV, ROS and physid: lens and place."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from physid.data.importers.video.lens import FARTHEST, Array, Lens
from physid.scenes.camera import Camera
from physid.strict import nearest, quoted, shown, whole
from physid.typed_files import check_as
from physid.yaml_files import YamlError, parse_yaml, read_text

PINHOLE = ("width", "height", "position", "target", "up", "fov_y")
MATRIX, DISTORTION = ("camera_matrix", "K", "cameraMatrix", "M"), ("distortion_coefficients", "D", "distCoeffs", "dist")
SIZES = (("image_width", "image_height"), ("width", "height"))
MODELS = ("plumb_bob", "rational_polynomial", "")
PLACE = ("rvec", "tvec", "points", "position", "target", "up")
OTHERS = (
    "distortion_model", "camera_name", "rectification_matrix", "projection_matrix", "R", "P", "reprojection_error",
    "calibration_time", "nframes", "board_width", "board_height", "square_size", "flags", "avg_reprojection_error",
    "header", "binning_x", "binning_y", "roi",
)  # fmt: skip
LONGEST_TURN = 4 * np.pi
"""[rad] Of rvec about each axis: solvers give up to one turn."""
FEWEST_POINTS = 4
FLAT = 1e-3
"""Singular value over the largest [-] below which points of the world count as on a line, or in a plane."""
POINTS_OFF = 2.0
"""[px] that a point of the world may lie off in the image before it is remarked: well read ones lie within one."""


def read_camera(path: Path) -> Lens:
    """Read a camera file.

    physid's own has the keys of `Camera`. OpenCV's and ROS's have a camera matrix, distortion coefficients and a size;
    the place of the camera is then `rvec` and `tvec` (from the world to the camera, as OpenCV's solvePnP gives them),
    `position`, `target` and `up`, or `points`: at least four of [column, row, x, y] or [column, row, x, y, z], image
    points beside points of the world [m], z = 0 where none is given.

    Raises:
        FileNotFoundError: If there is no such file.
        ValueError: If something is missing or contradicts itself.
    """
    if not path.is_file():
        raise FileNotFoundError(f"{path}: expected a camera file, found no such file; physid calibrate makes one")
    known = _keys_of(path)
    if set(known) <= set(PINHOLE) and "fov_y" in known:
        try:
            return _of_pinhole(_camera_as(path, known))
        except ValueError as error:
            raise ValueError(str(error) if str(error).startswith(str(path)) else f"{path}: {error}") from None
    _require_known(path, known)
    if str(known.get("distortion_model", "")) not in MODELS:
        raise ValueError(
            f"{path}: distortion_model: expected plumb_bob or rational_polynomial, got {known['distortion_model']!r}; "
            "calibrate with OpenCV's usual model"
        )
    matrix = _numbers(path, known, MATRIX, (9,)).reshape(3, 3)
    distortion = _numbers(path, known, DISTORTION, (0, 4, 5, 8, 12, 14), optional=True)
    size = next((pair for pair in SIZES if set(pair) <= set(known)), None)
    if size is None:
        raise ValueError(f"{path}: expected image_width and image_height, found neither")
    width, height = (whole(known[name], f"{path}: {name}", low=1) for name in size)
    try:  # first by itself: nothing is worked out with a lens that is none
        lens = Lens(width, height, matrix, distortion, np.eye(3), np.zeros(3))
        rotation, translation, off = _place(path, known, matrix, distortion)
        return replace(lens, rotation=rotation, translation=translation, points_error=off)
    except ValueError as error:
        raise ValueError(str(error) if str(error).startswith(str(path)) else f"{path}: {error}") from None


def place_of(path: Path) -> dict[str, Any]:
    """Return what a camera file says of the place of the camera and the size of its image; nothing if there is no file.

    Raises:
        OSError: If it cannot be read.
        ValueError: If it is no camera file.
    """
    if not path.exists():
        return {}
    known = _keys_of(path)
    _require_known(path, known, PINHOLE)
    sizes = [name for pair in SIZES for name in pair]
    return {name: value for name, value in known.items() if name in (*PLACE, *sizes) and value is not None}


def _keys_of(path: Path) -> dict[str, Any]:
    """Read the keys of a camera file, whatever they are."""
    try:
        values = parse_yaml(_plain(read_text(path)), str(path))
    except (YamlError, UnicodeDecodeError) as error:
        raise ValueError(str(error) if isinstance(error, YamlError) else f"{path}: expected text, found none") from None
    if not isinstance(values, dict):
        raise ValueError(f"{path}: expected the keys of a camera file, found {type(values).__name__}")
    return {str(key): value for key, value in values.items()}


def _require_known(path: Path, known: dict[str, Any], more: tuple[str, ...] = ()) -> None:
    """Refuse keys that no camera file has."""
    allowed = (*MATRIX, *DISTORTION, *(name for pair in SIZES for name in pair), *PLACE, *OTHERS, *more)
    for name in known:
        if name not in allowed:
            raise ValueError(f"{path}: unknown key {quoted(name)}{nearest(name, allowed)}")


def _plain(text: str) -> str:
    """Return YAML for what OpenCV calls so: a directive that is none, and tags of its own."""
    return re.sub(r"\A%YAML[: ]\S*\s*\n", "", text).replace("!!opencv-matrix", "")


def _numbers(
    path: Path, known: dict[str, Any], names: tuple[str, ...], counts: tuple[int, ...], optional: bool = False
) -> Array:
    """Return a matrix as plain numbers, however it is written: a list, rows of lists, or {rows, cols, data}."""
    name = next((one for one in names if known.get(one) is not None), None)
    if name is None:
        if optional:
            return np.zeros(0)
        raise ValueError(f"{path}: expected {names[0]} (nine numbers, row by row), found none")
    value = known[name]
    value = value.get("data") if isinstance(value, dict) else value
    try:
        found = np.asarray(value, dtype=float).ravel()
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{path}: {name}: expected numbers, got {str(value)[:60]}") from None
    if len(found) not in counts or not np.isfinite(found).all():
        raise ValueError(f"{path}: {name}: expected {' or '.join(map(str, counts))} finite numbers, got {len(found)}")
    return found


def _place(path: Path, known: dict[str, Any], matrix: Array, distortion: Array) -> tuple[Array, Array, float | None]:
    """Return rotation and translation from the world to the camera, and by how much given points are off [px]."""
    if "rvec" in known and "tvec" in known:
        from physid.data.importers.video.opencv import cv2

        turn, shift = (_numbers(path, known, (name,), (3,)) for name in ("rvec", "tvec"))
        if not np.abs(turn).max() <= LONGEST_TURN:
            raise ValueError(f"{path}: rvec: expected radians within {LONGEST_TURN:g}, got {turn.tolist()}")
        return np.asarray(cv2.Rodrigues(turn)[0], dtype=float), shift, None
    if "points" in known:
        return solve_place(known["points"], matrix, distortion, str(path))
    if {"position", "target", "up"} <= set(known):
        values = {name: known[name] for name in ("position", "target", "up")}
        camera = _camera_as(path, values | {"width": 1, "height": 1, "fov_y": 1.0})
        return *_axes(camera), None
    raise ValueError(
        f"{path}: expected the place of the camera, found none: rvec and tvec, or position, target and up, or points: "
        "four or more of [column, row, x, y], image points beside points of the plane [m]"
    )


def _camera_as(path: Path, values: dict[str, Any]) -> Camera:
    """Check values as those of a camera whose place is within reach."""
    for name in ("position", "target", "up"):
        given = values.get(name)
        for one in given if isinstance(given, list) else []:
            if isinstance(one, int | float) and not abs(one) <= FARTHEST:
                raise ValueError(f"{path}: {name}: expected numbers within {FARTHEST:g} [m], got {shown(given)}")
    return check_as(Camera, values, str(path))


def solve_place(points: Any, matrix: Array, distortion: Array, where: str) -> tuple[Array, Array, float]:
    """Find the camera that sees points of the world at points of the image.

    Args:
        points: Rows of column, row [px], whole numbers at pixel centres, x, y and, where it is not zero, z [m].
        matrix: Camera matrix.
        distortion: Coefficients.
        where: Names the points in messages.

    Returns:
        Rotation and translation from the world to the camera, and the largest distance [px] of a point of the image
        from where that camera sees its point of the world.

    Raises:
        ValueError: If there are too few, they lie in a line, no place explains them, or only one below their plane.
    """
    from physid.data.importers.video.opencv import cv2

    rows = rows_of(points, where)
    base = np.array([0, 0, rows[:, 4].mean()])  # OpenCV's solver for planes is exact at the height zero only
    image, world = rows[:, :2].copy(), rows[:, 2:] - base

    def error(turn: Any, shift: Any) -> float:
        again = cv2.projectPoints(world, turn, shift, matrix, distortion)[0].reshape(-1, 2)
        return float(np.linalg.norm(again - image, axis=1).max())

    flat = np.ptp(world[:, 2]) == 0
    method = cv2.SOLVEPNP_IPPE if flat else cv2.SOLVEPNP_SQPNP
    solved, turn, shift = cv2.solvePnP(world, image, matrix, distortion, flags=method)
    if not solved or error(turn, shift) > 0.02 * float(np.ptp(image)):
        found = f"some that are {error(turn, shift):.1f} px off" if solved else "some that no camera sees so"
        raise ValueError(
            f"{where}: points: expected points that a camera can see so, got {found}; check their order and units"
        )
    turn, shift = cv2.solvePnPRefineLM(world, image, matrix, distortion, turn, shift)
    rotation, translation = np.asarray(cv2.Rodrigues(turn)[0], dtype=float), np.asarray(shift, dtype=float).ravel()
    off, above = error(turn, shift), _height_above(world, -rotation.T @ translation)
    if above <= 0:
        raise ValueError(
            f"{where}: points: expected points of the ground that a camera above it sees, got some that only a camera "
            f"{-above:.3g} m below it sees so: they are mirrored; z points up, so that seen from above y is a quarter "
            "turn counterclockwise from x: exchange x and y, or negate y"
        )
    return rotation, translation - rotation @ base, off


def rows_of(points: Any, where: str) -> Array:
    """Return given points as rows of column, row, x, y, z.

    Raises:
        ValueError: If they determine no place.
    """
    try:
        rows = np.array([[*row, 0.0] if len(row) == 4 else [*row] for row in points], dtype=float)
        sound = rows.ndim == 2 and rows.shape[1] == 5 and bool(np.isfinite(rows).all())
    except (TypeError, ValueError, OverflowError):
        sound = False
    if not sound or len(rows) < FEWEST_POINTS:
        message = (
            f"{where}: points: expected {FEWEST_POINTS} or more rows [column, row, x, y] or with z, got {points!r}"
        )
        raise ValueError(message[:300])
    spread = np.linalg.svd(rows[:, 2:] - rows[:, 2:].mean(0), compute_uv=False)
    if spread[1] < FLAT * spread[0]:
        raise ValueError(f"{where}: points: expected points that span a plane, got some on a line")
    return rows


def _height_above(world: Array, position: Array) -> float:
    """Return how far a position is above the plane that points (N, 3) lie in [m]; infinity if in none, or upright."""
    middle = world.mean(0)
    _, spread, axes = np.linalg.svd(world - middle)
    normal = axes[2] if axes[2, 2] >= 0 else -axes[2]
    if (len(spread) > 2 and spread[2] > FLAT * spread[0]) or normal[2] < FLAT:
        return np.inf
    return float(normal @ (position - middle))


def _axes(camera: Camera) -> tuple[Array, Array]:
    """Return rotation and translation of a camera that is given by position, target and up."""
    right, upward, backward = camera.axes()
    rotation = np.stack([right, -upward, -backward])
    return rotation, -rotation @ np.array(camera.position)


def _of_pinhole(camera: Camera) -> Lens:
    """Return an ideal camera as a lens."""
    focal = camera.height / 2 / np.tan(np.radians(camera.fov_y) / 2)
    matrix = np.array([[focal, 0, camera.width / 2 - 0.5], [0, focal, camera.height / 2 - 0.5], [0, 0, 1.0]])
    return Lens(camera.width, camera.height, matrix, np.zeros(0), *_axes(camera))
