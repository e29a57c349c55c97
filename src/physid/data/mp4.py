"""Pictures as an mp4 film, for people to look at."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from physid.data.files import write_whole


def write_mp4(path: Path, pictures: Sequence[NDArray[np.uint8]], rate: float) -> bool:
    """Write pictures (H, W, 3) of one size as a film, whole or not at all.

    Args:
        path: The file.
        pictures: What it shows.
        rate: Pictures per second.

    Returns:
        Whether it was written; without imageio-ffmpeg, which brings ffmpeg, a warning says so instead.
    """
    try:
        import imageio_ffmpeg

        imageio_ffmpeg.get_ffmpeg_exe()
    except (ImportError, RuntimeError) as error:
        logging.getLogger(__name__).warning("no film %s: install imageio-ffmpeg (%s)", path, error)
        return False
    height, width, _ = pictures[0].shape

    def write(part: Path) -> None:
        # ffmpeg takes the container from the end of a name, which that of `part` does not say.
        film = imageio_ffmpeg.write_frames(str(part), (width, height), fps=rate, output_params=["-f", "mp4"])
        with closing(film):
            film.send(None)
            for picture in pictures:
                film.send(np.ascontiguousarray(picture))
        if not part.stat().st_size:
            raise OSError(f"{path}: expected a film from ffmpeg, which wrote nothing; leave the film out")

    write_whole(path, write)
    return True
