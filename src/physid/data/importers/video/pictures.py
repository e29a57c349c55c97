"""Pictures from files: one way to open them, which looks at their size before anything is decoded."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Picture
from PIL import UnidentifiedImageError

from physid.yaml_files import open_regular

T = TypeVar("T")
Image = NDArray[np.uint8]
IMAGES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")
FORMATS = ("PNG", "JPEG", "BMP", "TIFF", "WEBP")
"""Pillow's names of formats that hold pixels: it knows others, whatever a file is called, which other programs draw."""
MOST_PIXELS = 64_000_000
"""[px] Of a picture or a frame: films of 8K have 33 million, and a few frames in memory are then some gigabytes."""
DEEP = 257
"""Steps of 16 bits to one of 8: white stays white."""


def require_modest(path: Path, size: tuple[int, int]) -> None:
    """Refuse a picture or a film whose frames are larger than any camera's.

    Raises:
        ValueError: If it has more than `MOST_PIXELS`.
    """
    if size[0] * size[1] > MOST_PIXELS:
        raise ValueError(
            f"{path}: expected images of at most {MOST_PIXELS:,} pixels, found {size[0]} x {size[1]}; make them smaller"
        )


def size_of(path: Path) -> tuple[int, int]:
    """Return columns and rows of a picture, by its header.

    Raises:
        OSError: If the system refuses the file.
        ValueError: If it is no picture, or larger than any.
    """
    with _opened(path) as picture:
        return picture.size


def read_picture(path: Path, size: tuple[int, int], why: str) -> Image:
    """Read a picture.

    Args:
        path: The file.
        size: Columns and rows that it must have.
        why: Where these come from, for the message.

    Returns:
        Red, green and blue, shape (H, W, 3).

    Raises:
        OSError: If the system refuses the file.
        ValueError: If it is no picture, has another size, or colours that do not show which of them is white.
    """
    with _opened(path) as picture:
        if picture.size != size:
            raise ValueError(
                f"{path}: expected an image of {size[0]} x {size[1]} {why}, found {picture.width} x {picture.height}"
            )
        if picture.mode in ("I", "F"):
            raise ValueError(
                f"{path}: expected an image of 8 or 16 bits to a colour, found one of 32, of which nothing says how "
                "bright is white; save it with 8 bits (PNG)"
            )
        _tried(path, picture.load)
        if picture.mode.startswith("I;16"):
            grey = np.asarray(picture).astype(np.uint32)
            return np.repeat(((grey + DEEP // 2) // DEEP).astype(np.uint8)[..., None], 3, -1)
        return np.asarray(picture.convert("RGB"))


@contextmanager
def _opened(path: Path) -> Iterator[Picture.Image]:
    """Open a picture of modest size; nothing of it is decoded yet."""
    with open_regular(path) as file, warnings.catch_warnings():
        warnings.simplefilter("ignore", Picture.DecompressionBombWarning)  # refused below, with the limit
        picture = _tried(path, lambda: Picture.open(file, formats=FORMATS))
        require_modest(path, picture.size)
        yield picture


def _tried(path: Path, act: Callable[[], T]) -> T:
    """Do something with a picture; what Pillow says of a damaged one is said with file and remedy."""
    try:
        return act()
    except MemoryError:
        raise
    except Picture.DecompressionBombError:
        raise ValueError(
            f"{path}: expected images of at most {MOST_PIXELS:,} pixels, found more; make them smaller"
        ) from None
    except Exception as error:  # Pillow has errors of many kinds for what is damaged
        unknown = isinstance(error, UnidentifiedImageError)  # whose text names the open file, not the path
        reason = "" if unknown else f" ({(str(error).splitlines() or [type(error).__name__])[0][:160]})"
        raise ValueError(
            f"{path}: expected an image ({', '.join(IMAGES)}), found a file that cannot be read as one{reason}; "
            "copy it again, or name another"
        ) from None
