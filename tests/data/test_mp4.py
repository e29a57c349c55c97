from __future__ import annotations

import logging
import sys
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from physid.data.mp4 import write_mp4

Pixels = NDArray[np.uint8]
PICTURES = [np.full((32, 48, 3), 40 * shade, np.uint8) for shade in range(6)]


def test_a_film_shows_what_it_was_given(tmp_path: Path) -> None:
    assert write_mp4(tmp_path / "new" / "grey.mp4", PICTURES, 24)
    film = cv2.VideoCapture(str(tmp_path / "new" / "grey.mp4"))
    assert film.get(cv2.CAP_PROP_FPS) == 24
    read = [picture for _ in range(7) if (picture := film.read()[1]) is not None]
    shades = [picture.mean() for picture in read]
    np.testing.assert_allclose(shades, [40 * shade for shade in range(6)], atol=3)


def test_a_film_that_fails_leaves_the_old_one(tmp_path: Path) -> None:
    class Broken(list[Pixels]):
        def __iter__(self) -> Iterator[Pixels]:
            yield self[0]
            raise KeyError("no more")

    path = tmp_path / "a.mp4"
    path.write_text("old")
    with pytest.raises(KeyError, match="no more"):
        write_mp4(path, Broken(PICTURES), 24)
    assert path.read_text() == "old"
    assert [one.name for one in tmp_path.iterdir()] == ["a.mp4"]


def test_without_ffmpeg_there_is_a_warning_and_no_film(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with caplog.at_level(logging.WARNING):
        assert not write_mp4(tmp_path / "a.mp4", PICTURES, 24)
    assert "install imageio-ffmpeg" in caplog.text
    assert not list(tmp_path.iterdir())
