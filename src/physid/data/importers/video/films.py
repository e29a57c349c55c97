"""A film, or a folder of images, frame by frame: never more than a few frames in memory."""

from __future__ import annotations

import codecs
import os
import re
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from physid.data.importers.finding import SUFFIXES, natural
from physid.data.importers.video.pictures import IMAGES, Image, read_picture, require_modest, size_of
from physid.yaml_files import open_regular

FILMS = SUFFIXES["mp4"]
MISSING = 0.02
"""Share of the time that a header promises which may be missing: durations in headers are estimates."""
CONTAINERS = (
    "mov", "mp4", "matroska", "webm", "avi", "mpegts", "mpeg", "mpegvideo", "asf", "flv", "ogg", "mxf", "dv", "ivf",
    "nut", "gif", "h264", "hevc", "obu", "m4v", "mjpeg", "yuv4mpegpipe",
)  # fmt: skip
"""FFmpeg's names of formats in which one file holds the whole film. It knows others whatever the file is called: lists
of films, which it would read from other places."""
LISTS = (b"ffconcat", b"#extm3u")
"""What lists of other films begin with."""

NAMED = 5
"""Frames, or missing images, that a note names."""
COUNT = 0.5  # share of images whose number is the next one, and that are there, from which on numbers count images


class Film(ABC):
    """Frames in order.

    Attributes:
        path: File or folder.
        rate: Frames per second that its header says; None where it says none.
        size: Columns and rows [px], known before a frame is decoded.
        numbers: Where each frame stands among all that were taken, by the numbers of images of which some are missing;
            None where none is missing, or nothing shows it.
        lost: Numbers of the missing ones, as names write them.
    """

    path: Path
    rate: float | None
    size: tuple[int, int]
    numbers: NDArray[np.int64] | None = None
    lost: tuple[str, ...] = ()

    @abstractmethod
    def frames(self) -> Iterator[tuple[float | None, Image]]:
        """Yield the stamp [s], where there is one, and the image (H, W, 3) of each frame.

        Raises:
            ValueError: If a frame cannot be read; the message names it.
        """

    def missing(self) -> str:
        """Say which images are missing, of a film that knows it."""
        more = f" and {len(self.lost) - NAMED} more" if len(self.lost) > NAMED else ""
        return (
            f"{self.path}: images {', '.join(self.lost[:NAMED])}{more} are missing, by the numbers in names; the "
            "others keep the times of their numbers; copy the missing ones again, or number images without gaps if "
            "none was lost"
        )


@final
class FilmFile(Film):
    """A film that OpenCV decodes.

    Raises:
        ValueError: If it is none.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        capture = self._open()
        rate = float(capture.get(self._cv2.CAP_PROP_FPS))
        self.promised = max(int(capture.get(self._cv2.CAP_PROP_FRAME_COUNT)), 0)
        self.rate = rate if 0 < rate < 1e5 else None
        code = int(capture.get(self._cv2.CAP_PROP_FOURCC)).to_bytes(8, "little", signed=True)[:4].decode("latin-1")
        self.codec = code if code.isascii() and code.isprintable() else "without a name"
        self.size = int(capture.get(self._cv2.CAP_PROP_FRAME_WIDTH)), int(capture.get(self._cv2.CAP_PROP_FRAME_HEIGHT))
        capture.release()
        require_modest(path, self.size)

    def frames(self) -> Iterator[tuple[float | None, Image]]:
        """Decode frame by frame (see `Film.frames`)."""
        capture, count, last = self._open(), 0, 0.0
        try:
            while True:
                good, image = capture.read()
                if not good:
                    break
                stamp = float(capture.get(self._cv2.CAP_PROP_POS_MSEC)) / 1e3
                count, last = count + 1, max(last, stamp)
                yield stamp, np.ascontiguousarray(image[..., ::-1])
        finally:
            capture.release()
        if not count:
            raise ValueError(
                f"{self.path}: expected frames that can be decoded, found none: OpenCV here does not know the codec "
                f"({self.codec}), or the film is damaged; convert it (ffmpeg -i IN -c:v libx264 OUT.mp4), or copy it "
                "again"
            )
        if count < (1 - MISSING) * self.promised - 1 and not self._lasts(count, last):
            raise ValueError(
                f"{self.path}: expected {self.promised} frames as its header says, found {count}: the film is cut off "
                "or damaged, or was trimmed without being encoded anew; copy it again, or write what can be played of "
                "it, or the trimmed one, as a film of its own (ffmpeg -i IN OUT.mp4)"
            )

    def _lasts(self, count: int, last: float) -> bool:
        """Return whether frames last as long as the header promises, by the last stamp [s].

        What counts frames in a header without an index is the duration times the rate; where frames do not come evenly,
        as phones record them, both are right while the product is not.
        """
        if self.rate is None or last <= 0:
            return False
        return last * (1 + 1 / max(count - 1, 1)) >= (1 - MISSING) * self.promised / self.rate - 1 / self.rate

    def _open(self) -> Any:
        # FFmpeg would print what it thinks of damaged files; the message below says it once.
        os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
        os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
        from physid.data.importers.video.opencv import cv2

        self._cv2 = cv2
        with open_regular(self.path) as file:  # what the system refuses is reported in its own words
            begins = file.read(64).removeprefix(codecs.BOM_UTF8).lstrip().lower()
        if begins.startswith(LISTS):
            raise ValueError(
                f"{self.path}: expected a film, found a list of other films, which may lie anywhere; name the films"
            )
        os.environ["OPENCV_FFMPEG_CAPTURE_OPTIONS"] = f"format_whitelist;{','.join(CONTAINERS)}"
        # A path from the root is no address to FFmpeg, whatever the file is called.
        capture = cv2.VideoCapture(str(self.path.absolute()), cv2.CAP_FFMPEG)
        if not capture.isOpened():
            raise ValueError(
                f"{self.path}: expected a film, found a file that cannot be decoded; an mp4 whose end is missing lacks "
                "its index: copy it again, or convert it (ffmpeg -i IN OUT.mp4)"
            )
        return capture


@final
class ImageFolder(Film):
    """Images of one size, in the natural order of their names."""

    def __init__(self, path: Path) -> None:
        self.path, self.rate = path, None
        self._files = sorted((each for each in path.iterdir() if each.suffix.lower() in IMAGES), key=natural)
        if not self._files:
            raise FileNotFoundError(f"{path}: expected images ({', '.join(IMAGES)}), found none")
        self.size = size_of(self._files[0])
        self.numbers, self.lost = counted([each.stem for each in self._files])

    def frames(self) -> Iterator[tuple[float | None, Image]]:
        """Read image by image (see `Film.frames`)."""
        for file in self._files:
            yield None, read_picture(file, self.size, "as the others")


def counted(names: Sequence[str]) -> tuple[NDArray[np.int64] | None, tuple[str, ...]]:
    """Return where images stand in the row of all that were taken, by the last numbers in their names.

    Args:
        names: Without their endings, in order.

    Returns:
        Whole numbers from 0, with a gap where images are missing, and the numbers of these as names write them; None
        and nothing where none is missing, or where numbers do not count (stamps).
    """
    found = [one for name in names if (one := re.fullmatch(r"(.*?)(\d+)\D*", name)) is not None]
    if len(names) < 3 or len(found) < len(names) or len({one[1] for one in found}) > 1:
        return None, ()
    numbers = [int(one[2]) for one in found]
    steps = [after - before for before, after in pairwise(numbers)]
    least = min(steps)
    if least < 1 or any(step % least for step in steps) or steps.count(least) < COUNT * len(steps):
        return None, ()
    if COUNT * (numbers[-1] - numbers[0]) > least * len(names):  # more are missing than are there
        return None, ()
    lost = [
        str(one).zfill(len(found[0][2]))
        for before, after in pairwise(numbers)
        for one in range(before + least, after, least)
    ]
    places = np.array([(one - numbers[0]) // least for one in numbers], dtype=np.int64)
    return (places, tuple(lost)) if lost else (None, ())


def find_films(places: list[Path]) -> list[Path]:
    """Return films and folders of images: files as named; of a folder, its films, its folders of images, or itself.

    Raises:
        FileNotFoundError: If there are none.
    """
    found: list[Path] = []
    for place in places:
        if not place.is_dir():
            if not place.exists():
                raise FileNotFoundError(f"{place}: expected a film or a folder, found nothing there")
            found.append(place)
            continue
        inside = sorted(place.iterdir(), key=natural)
        films = [each for each in inside if each.suffix.lower() in FILMS]
        folders = [
            each for each in inside if each.is_dir() and any(one.suffix.lower() in IMAGES for one in each.iterdir())
        ]
        images = any(each.suffix.lower() in IMAGES for each in inside)
        found += films or folders or ([place] if images else [])
    if not found:
        raise FileNotFoundError(
            f"{', '.join(map(str, places))}: expected films ({', '.join(FILMS)}) or images, found none"
        )
    return found


def open_film(path: Path) -> Film:
    """Open a film, or a folder of images."""
    return ImageFolder(path) if path.is_dir() else FilmFile(path)
