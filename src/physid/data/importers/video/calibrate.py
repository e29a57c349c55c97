"""The lens of a camera, from a film of a checkerboard, by OpenCV (Zhang 2000)."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, final

import numpy as np
import yaml
from numpy.typing import NDArray

from physid.data.files import write_text
from physid.data.importers.video.cameras import PLACE, SIZES, place_of, rows_of, solve_place
from physid.data.importers.video.films import open_film
from physid.strict import number, shown
from physid.yaml_files import YamlError, parse_yaml, read_text

MOST_BOARDS, LOOKED_AT = 40, 200
FEWEST_BOARDS = 8
MOST_CORNERS = 100
"""Of a board along a side; with more, none is as wide as the pixels that it takes to find it."""
SQUARE = (1e-4, 10.0)
"""[m] Least and largest side of a square: below a microscope's, and above any board's."""
LEAST_TILT = 0.2
"""Ratio of singular values of the boards' normals: boards that are all parallel tell no focal length."""
KEY = re.compile(r"([A-Za-z_]\w*)\s*:(?:\s|$)")
WORST = 1.0  # [px] of a calibration that can be used


@final
@dataclass(frozen=True)
class Calibrated:
    """A lens as it was measured.

    Attributes:
        width: Columns [px].
        height: Rows [px].
        matrix: OpenCV's camera matrix, shape (3, 3).
        distortion: k1, k2, p1, p2, k3.
        error: Root mean square distance of corners from where they should be [px].
        boards: How many boards it was measured from.
        place: What a camera file says of the place of the camera; nothing where that is not known.
        ground_error: The largest distance of points of the ground from where the camera sees them [px].
    """

    width: int
    height: int
    matrix: NDArray[np.float64]
    distortion: NDArray[np.float64]
    error: float
    boards: int
    place: Mapping[str, Any] = field(default_factory=dict)
    ground_error: float = 0.0

    def write(self, path: Path) -> None:
        """Write a camera file; comments of an earlier one, and its lines of the place, stay as they are."""
        lens = [f"image_width: {self.width}", f"image_height: {self.height}", "distortion_model: plumb_bob",
                f"camera_matrix: {{rows: 3, cols: 3, data: {_plain(self.matrix)}}}",
                f"distortion_coefficients: {{rows: 1, cols: {len(self.distortion)}, data: {_plain(self.distortion)}}}",
                f"reprojection_error: {self.error:.4g}"]  # fmt: skip
        place: dict[str, list[str]] = {}
        for name, value in self.place.items():
            if name == "points":
                place[name] = ["points:  # column, row [px], x, y, z [m]", *(f"  - {list(row)}" for row in value)]
            else:
                place[name] = [yaml.safe_dump({name: value}, default_flow_style=True, width=1000).strip()[1:-1]]
        whole = "\n".join([*lens, *(line for lines in place.values() for line in lines)]) + "\n"
        kept = _laid_over(read_text(path), lens, place) if path.is_file() else whole
        write_text(path, kept if _same(kept, whole) else whole)


def _laid_over(text: str, lens: Sequence[str], place: Mapping[str, Sequence[str]]) -> str:
    """Return a camera file of keys below each other in which the lens is another one, with its comments and place."""
    kept, start, missing, stays = list[str](), None, dict(place), False
    for line in text.splitlines():
        if key := KEY.match(line):
            stays = missing.pop(key[1], None) is not None
            start = len(kept) if start is None and not stays else start
        if stays or not line.strip() or line.startswith("#"):
            kept.append(line)
    start = len(kept) if start is None else start
    added = [line for lines in missing.values() for line in lines]
    return "\n".join([*kept[:start], *lens, *kept[start:], *added]) + "\n"


def _same(text: str, other: str) -> bool:
    """Return whether two texts are the same in YAML."""
    try:
        return bool(parse_yaml(text, "") == parse_yaml(other, ""))
    except YamlError:
        return False


def corners_of(text: str, square: float) -> tuple[int, int]:
    """Read how many inner corners a board has along its sides, say 9x6, and check the side of a square [m].

    Raises:
        ValueError: If no board is like that.
    """
    sides = re.fullmatch(r"(\d{1,3})[xX*,](\d{1,3})", text, re.ASCII)
    if sides is None or not all(3 <= int(side) <= MOST_CORNERS for side in sides.groups()):
        raise ValueError(
            f"calibrate: corners: expected two numbers from 3 to {MOST_CORNERS} such as 9x6, got {shown(text)}"
        )
    number(square, "calibrate: square", low=SQUARE[0], high=SQUARE[1])
    return int(sides[1]), int(sides[2])


def place_to_write(out: Path, ground: str) -> Mapping[str, Any]:
    """Return the place that a new camera file gets: the points that are given, or what the earlier file says.

    Args:
        out: The camera file; may be there already.
        ground: Points of the ground, in YAML; may be empty.

    Raises:
        OSError: If the earlier file cannot be read.
        ValueError: If the points determine no place, the earlier file is no camera file, or there are two places.
    """
    before = {name: value for name, value in place_of(out).items() if name in PLACE}
    if not ground:
        if "points" in before:
            rows_of(before["points"], str(out))
        return before
    place = {"points": parse_yaml(ground, "--ground")}
    rows_of(place["points"], "--ground")
    if before and before != place:
        raise ValueError(
            f"{out} holds another place of the camera ({', '.join(before)}), which would be lost; leave --ground out "
            f"to keep it while the lens is measured anew, delete {out.name} to replace it, or choose another --out"
        )
    return place


def calibrate(film: Path, corners: tuple[int, int], square: float, out: Path, ground: str = "") -> Calibrated:
    """Measure a lens from a film, or a folder of images, of a checkerboard, and write its camera file.

    The board is turned about in front of the camera. What an earlier camera file says of the place stays in it.

    Args:
        film: The film, or a folder of images.
        corners: Inner corners of the board along its sides.
        square: Side of a square [m].
        out: The camera file.
        ground: Points of the ground for the camera file, in YAML; they are checked against the lens.

    Raises:
        ValueError: If too few boards are found, they are not tilted, the fit is bad, or the earlier file holds anything
            but a camera, or the place of one with images of another size.
    """
    place = place_to_write(out, ground)
    said = place_of(out)
    found = _measure(film, corners, square)
    size = next(((said[x], said[y]) for x, y in SIZES if x in said and y in said), None)
    if place and not ground and size not in (None, (found.width, found.height)):
        raise ValueError(
            f"{out}: expected images of {found.width} x {found.height} as those of {film}, found a place for images of "
            f"{size[0]} x {size[1]}, whose points lie elsewhere; choose another --out"
        )
    if "points" in place:
        where = "--ground" if ground else str(out)
        found = replace(found, ground_error=solve_place(place["points"], found.matrix, found.distortion, where)[2])
    found = replace(found, place=place)
    found.write(out)
    return found


def _measure(film: Path, corners: tuple[int, int], square: float) -> Calibrated:
    """Measure the lens alone (see `calibrate`)."""
    from physid.data.importers.video.opencv import cv2

    grid = np.zeros((corners[0] * corners[1], 3), np.float32)
    grid[:, :2] = square * np.mgrid[: corners[0], : corners[1]].T.reshape(-1, 2)
    found: list[NDArray[np.float32]] = []
    shape, looked, every = (0, 0), 0, 1
    for position, (_, image) in enumerate(open_film(film).frames()):
        shape = image.shape[:2]
        if position % every:
            continue
        looked += 1
        if looked % LOOKED_AT == 0:  # of a long film, fewer and fewer frames
            every *= 2
        grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
        seen, place = cv2.findChessboardCornersSB(grey, corners, flags=cv2.CALIB_CB_ACCURACY)
        if seen:
            found.append(np.asarray(place, dtype=np.float32).reshape(-1, 1, 2))
    boards = found[:: max(1, -(-len(found) // MOST_BOARDS))]
    if len(boards) < FEWEST_BOARDS:
        raise ValueError(
            f"{film}: expected {FEWEST_BOARDS} views of a board of {corners[0]} x {corners[1]} inner corners, found "
            f"{len(boards)} in {looked} frames; count inner corners, not squares; film the whole board, sharp and lit"
        )
    size = (shape[1], shape[0])
    error, matrix, distortion, turns, _ = cv2.calibrateCamera([grid] * len(boards), boards, size, None, None)
    normals = np.stack([cv2.Rodrigues(turn)[0][:, 2] for turn in turns])
    spread = np.linalg.svd(normals, compute_uv=False)
    if spread[1] < LEAST_TILT * spread[0]:
        raise ValueError(
            f"{film}: expected a board that is tilted this way and that, found one that is always parallel"
        )
    if error > WORST:
        raise ValueError(
            f"{film}: expected corners within {WORST:g} px of a camera's, found {error:.2g} px; is the board flat?"
        )
    lens = np.asarray(matrix, dtype=float), np.asarray(distortion, dtype=float).ravel()
    return Calibrated(*size, *lens, float(error), len(boards))


def _plain(values: NDArray[np.float64]) -> list[float]:
    """Return numbers as YAML writes them."""
    return [float(f"{one:.10g}") for one in values.ravel()]
