"""A first look at films: how many frames, how far apart, and some of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from physid.data.importers.video.films import NAMED, Film, open_film
from physid.data.importers.video.lens import METRES, Lens
from physid.data.importers.video.pictures import Image, read_picture
from physid.data.importers.video.sights import background_of, find_bodies
from physid.data.observations.stamps import rhythm_of
from physid.scenes import Scene
from physid.scenes.camera import Camera, corners

EVEN = 0.02
"""Share of a frame's time by which stamps may stray and still count as even."""
RATE_DIFFERS = 0.02
"""Share by which rates may differ that mean the same."""
RESOLUTION = 1e-3
"""[s] To which many films round their stamps."""
MOST_DOUBLED = 0.02
"""Share of the frames whose stamps may be mended: more of them are no slip of the recorder."""
MOST_UNSTAMPED = 16
"""Frames at the end whose stamps are zero: those that OpenCV's decoder has kept back to put frames into order."""
FEWEST_FRAMES = 4
FEWEST, MOST = 0.4, 1.7
"""Pixels of a body over those that it should cover at least and at most: shadows add some, and what it hides behind."""
GHOST = 5.0
"""Times the most that it should cover that a body covers at most, together with itself at another place."""


@final
@dataclass(frozen=True)
class Survey:
    """What a first look at a film shows.

    Attributes:
        film: The film.
        count: Frames.
        step: Time between frames [s].
        time: Stamps [s] where they are not even, else None.
        kept: Some frames, as the ideal camera sees them.
        notes: What was taken for granted.
    """

    film: Film
    count: int
    step: float
    time: NDArray[np.float64] | None
    kept: list[Image]
    notes: tuple[str, ...]


def survey(path: Path, lens: Lens, straighten: Callable[[Image], Image], rate: float | None, most: int) -> Survey:
    """Look at a film once: how many frames, how far apart; keep at most so many of them, evenly."""
    film = open_film(path)
    _require_size(film, lens, film.size)
    stamps: list[float | None] = []
    kept: list[Image] = []
    every = 1
    for position, (stamp, image) in enumerate(film.frames()):
        _require_size(film, lens, (image.shape[1], image.shape[0]))
        stamps.append(stamp)
        if most and position % every == 0:
            if len(kept) == most:
                kept, every = kept[::2], 2 * every
            if position % every == 0:
                kept.append(straighten(image))
    if len(stamps) < FEWEST_FRAMES:
        raise ValueError(f"{film.path}: expected a film of {FEWEST_FRAMES} frames or more, found {len(stamps)}")
    step, time, notes = _clock(film, stamps, rate)
    return Survey(film, len(stamps), step, time, kept, tuple(notes))


def _require_size(film: Film, lens: Lens, size: tuple[int, int]) -> None:
    """Refuse images of another size than the camera's."""
    if size != (lens.width, lens.height):
        raise ValueError(
            f"{film.path}: expected images of {lens.width} x {lens.height} as the camera file says, found "
            f"{size[0]} x {size[1]}; calibrate at the size of the film"
        )


def _clock(
    film: Film, stamps: list[float | None], rate: float | None
) -> tuple[float, NDArray[np.float64] | None, list[str]]:
    """Return the time between frames, stamps where they are not even, and notes."""
    known = None if stamps[0] is None else np.array(stamps, dtype=float)
    says = f"the header of {film.path.name} says {film.rate or 0:g}"
    if rate is not None:
        differs = film.rate is not None and abs(film.rate / rate - 1) > RATE_DIFFERS
        notes = [f"rate: {rate:g} frames per second, as the mapping says; {says}"] * differs
        time, more = _at_rate(film, known, rate)
        return 1 / rate, time, notes + more
    if known is None or not np.ptp(known):
        if film.rate is None or known is None:
            raise ValueError(
                f"{film.path}: expected the time between images, found none; give rate (frames per second)"
            )
        return 1 / film.rate, None, []
    rounded = film.rate is not None and not (np.diff(known) > 0).all() and _is_even(known - known[0], 1 / film.rate)
    if film.rate is not None and rounded:
        return 1 / film.rate, None, []
    known, notes = _increasing(film, known)
    step = _period(film, known)
    if film.rate is not None and abs(film.rate * step - 1) > RATE_DIFFERS:
        notes = [*notes, f"rate: {1 / step:.4g} frames per second, as the stamps show; {says}"]
    elif film.rate is not None:
        step = 1 / film.rate
    return step, None if _is_even(known, step) else known, notes


def _at_rate(
    film: Film, stamps: NDArray[np.float64] | None, rate: float
) -> tuple[NDArray[np.float64] | None, list[str]]:
    """Return stamps at a rate that the user gives where frames do not come evenly, else None, and notes.

    Stamps that increase are kept, scaled so that their rhythm has the rate: frames across a gap are not joined.
    """
    if film.numbers is not None:
        return film.numbers / rate, [film.missing()]
    if stamps is None or not np.ptp(stamps):
        return None, []
    try:
        stamps, notes = _increasing(film, stamps)
    except ValueError:  # such stamps say nothing, and a rate is what is asked for then
        return None, [f"{film.path}: stamps that do not increase; frames are taken to come evenly, as rate says"]
    if _is_even(stamps, stamps[-1] / (len(stamps) - 1)):
        return None, []
    scale = 1 / (rate * _period(film, stamps))
    gaps = scale * np.diff(stamps)
    return scale * stamps, [
        *notes,
        f"{film.path}: frames do not come evenly (frame {gaps.argmax()} is followed by none for {gaps.max():.4g} s); "
        f"their stamps are scaled so that {rate:g} frames come per second where none is missing",
    ]


def _is_even(stamps: NDArray[np.float64], step: float) -> bool:
    """Return whether stamps, from zero on, are those of even frames, within what they are rounded to."""
    return bool((np.abs(stamps - step * np.arange(len(stamps))) < EVEN * step + RESOLUTION).all())


def _increasing(film: Film, stamps: NDArray[np.float64]) -> tuple[NDArray[np.float64], list[str]]:
    """Return stamps from zero on, mended where a few do not follow those before them, and say so.

    Between others, such frames are put midway; at the end, where a few have no stamp or one is doubled, they go on as
    those before them.

    Raises:
        ValueError: If there are more of them than a recorder doubles now and then, or a decoder leaves without stamps.
    """
    before = np.maximum.accumulate(stamps)
    wrong = np.r_[False, stamps[1:] <= before[:-1]]
    places, right = np.flatnonzero(wrong), np.flatnonzero(~wrong)
    last = int(right[-1])
    rest = stamps[last + 1 :]
    unstamped = 0 if rest.any() else len(rest)
    doubled = len(places) - unstamped
    few = unstamped <= min(MOST_UNSTAMPED, len(stamps) // 2) and doubled <= max(1, MOST_DOUBLED * len(stamps))
    if not few or len(right) < 2 or (rest.any() and (stamps[last] - rest).max() > RESOLUTION):
        raise ValueError(
            f"{film.path}: expected stamps that increase, found {len(places)} that do not, the first in frame "
            f"{places[0]} at {stamps[places[0]]:.4g} s; if frames come evenly, give rate (frames per second), else "
            "write the film anew (ffmpeg -i IN -fps_mode passthrough OUT.mp4)"
        )
    mended = np.interp(np.arange(len(stamps)), right, stamps[right])
    steps = np.diff(mended[: last + 1])[-MOST_UNSTAMPED:]
    usual = np.quantile(steps, 0.5, method="lower")
    step = float(steps[abs(steps - usual) < EVEN * usual + RESOLUTION].mean())  # more exact than what stamps round to
    mended[last + 1 :] = mended[last] + step * np.arange(1, len(rest) + 1)
    inside, after = places[places < last], places[places > last]
    notes = []
    if len(inside):
        some = ", ".join(map(str, inside[:NAMED])) + ", ..." * (len(inside) > NAMED)
        notes.append(
            f"{film.path}: frame {some}: stamps that do not follow those before them; the frames are taken to be "
            "midway between their neighbours"
        )
    if len(after):
        notes.append(
            f"{film.path}: the last frames ({len(after)} of {len(stamps)}) have no stamps of their own; they are taken "
            f"to follow at {1 / step:.4g} frames per second, as those before them"
        )
    return mended - mended[0], notes


def _period(film: Film, stamps: NDArray[np.float64]) -> float:
    """Return the time between frames by their stamps (see `rhythm_of`)."""
    try:
        return rhythm_of(stamps).period
    except ValueError as error:
        raise ValueError(f"{film.path}: {error}") from None


def straightener(lens: Lens) -> Callable[[Image], Image]:
    """Return what turns an image of the real camera into one of the ideal camera.

    Where pixels lie is worked out with the first image: its size has been compared with the camera's by then.
    """
    if lens.ideal:
        return lambda image: image
    from physid.data.importers.video.opencv import cv2

    maps = cache(lens.maps)

    def straighten(image: Image) -> Image:
        return np.asarray(cv2.remap(image, *maps(), cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE))

    return straighten


def empty_scene(path: Path, lens: Lens, straighten: Callable[[Image], Image]) -> Image:
    """Read an image of the empty scene.

    Raises:
        FileNotFoundError: If there is none.
        ValueError: If it is no image, or has another size than the films.
    """
    if not path.is_file():
        raise FileNotFoundError(f"{path}: expected an image of the empty scene (background), found no such file")
    return straighten(read_picture(path, (lens.width, lens.height), "as the camera file says"))


def common_background(surveys: Sequence[Survey], count: int) -> Image:
    """Return the empty scene of films of one camera (see `background_of`)."""
    return background_of([image for each in surveys for image in each.kept], count)


def first_masks(film: Film, straighten: Callable[[Image], Image], background: Image, count: int) -> NDArray[np.bool_]:
    """Find the bodies in the first frame of a film, (N, H, W) (see `find_bodies`)."""
    return find_bodies(straighten(next(iter(film.frames()))[1]), background, count)


def unlike_outlines(masks: NDArray[np.bool_], scene: Scene) -> list[str]:
    """Say which bodies cover more or fewer pixels than they can where they lie on the ground, and why that may be.

    Args:
        masks: Of the bodies in one image, shape (N, H, W).
        scene: Gives camera, ground and sizes.
    """
    remarks, camera = [], scene.camera
    assert camera is not None
    normal, eye = np.array(scene.ground.normal), np.array(camera.position)
    for body, mask in zip(scene.bodies, masks, strict=True):
        row, column = np.argwhere(mask).mean(0) + 0.5
        focal = 0.5 * camera.height / np.tan(np.radians(camera.fov_y) / 2)
        right, upward, backward = camera.axes()
        ray = (column - camera.width / 2) / focal * right - (row - camera.height / 2) / focal * upward - backward
        away = (scene.ground.offset - normal @ eye) / (normal @ ray)
        if away <= 0 or normal @ eye <= scene.ground.offset:
            remarks.append(f"{body.name}: the camera does not see the ground there; {METRES}, and does its z point up?")
            continue
        areas = [_area_of(camera, eye + away * ray, normal, np.roll(body.size, axis)) for axis in range(3)]
        low, high, found = min(map(min, areas)), max(map(max, areas)), int(mask.sum())
        if FEWEST * low <= found <= MOST * high:
            continue
        ghost = "does the background show the body, too (background=FILE names an image of the empty scene); "
        remarks.append(
            f"{body.name} covers {found} pixels in the first frame, where a body of its size on the ground covers "
            f"{low:.0f} to {high:.0f}: {ghost * (high < found < GHOST * high)}{METRES}?"
        )
    return remarks


def _area_of(
    camera: Camera, place: NDArray[np.float64], normal: NDArray[np.float64], size: NDArray[np.float64]
) -> list[float]:
    """Return the pixels that a box covers at some headings, which stands on the ground with its last edge upright."""
    from physid.data.importers.video.opencv import cv2

    across = np.cross(normal, np.eye(3)[int(np.abs(normal).argmin())])
    across = across / np.linalg.norm(across)
    areas = []
    for angle in np.radians(np.arange(0, 180, 30)):
        along = np.cos(angle) * across + np.sin(angle) * np.cross(normal, across)
        turned = Rotation.from_matrix(np.stack([along, np.cross(normal, along), normal], 1)).as_quat()
        pose = np.concatenate([place + size[2] / 2 * normal, turned])
        seen = camera.project(corners(pose[None], size[None])[0])
        areas.append(float(cv2.contourArea(cv2.convexHull(seen[:, :2].astype(np.float32)))))
    return areas
