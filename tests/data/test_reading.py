"""Poses that were read from films name the folder of these, and whoever sends them could name any."""

from __future__ import annotations

import dataclasses
import logging
import os
from pathlib import Path

import pytest

from physid.data import RecordingSet
from physid.data.generation.generate import generate
from physid.data.generation.settings import GenerateConfig
from physid.data.reading import Reading, checksum_of_files, film_of, read_reading, write_reading
from physid.inspection.origin import Origin


@pytest.fixture
def films(tmp_path: Path) -> Path:
    generate(GenerateConfig("push", trajectories=2, steps=20), tmp_path / "elsewhere" / "films", 1, quiet=True)
    (tmp_path / "elsewhere" / "films" / "import.yaml").write_text("force: [secret_x, secret_y, secret_z]\n")
    return tmp_path / "elsewhere" / "films"


@pytest.fixture
def poses(films: Path, tmp_path: Path) -> RecordingSet:
    generate(GenerateConfig("push", trajectories=2, steps=20, seed=3), tmp_path / "read", 1, quiet=True)
    known = Reading(str(films), "", "planar", 0.0, 0.0, "", seen=checksum_of_files(films))
    write_reading(tmp_path / "read", known)
    return RecordingSet(tmp_path / "read")


def test_films_that_were_read_are_found_wherever_they_lie(films: Path, poses: RecordingSet) -> None:
    found, index = film_of(poses, 1)
    assert (found.folder, index) == (films, 1)
    assert Origin.of(poses.folder).force == ("secret_x", "secret_y", "secret_z")


@pytest.mark.parametrize("mark", ["", "0" * 64])
def test_a_folder_that_was_not_read_is_not_looked_at(
    mark: str, films: Path, poses: RecordingSet, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    known = read_reading(poses.folder)
    assert known is not None
    write_reading(poses.folder, dataclasses.replace(known, seen=mark))
    with caplog.at_level(logging.WARNING):
        assert [film_of(poses, index)[0] for index in range(2)] == [poses, poses]
    assert [each.getMessage().count("no picture of them is shown") for each in caplog.records] == [1]
    assert Origin.of(poses.folder).force == Origin().force


def test_films_that_have_changed_are_others(films: Path, poses: RecordingSet) -> None:
    path = RecordingSet(films).paths[0]
    os.utime(path, ns=(0, path.stat().st_mtime_ns + 1))
    assert film_of(poses, 0) == (poses, 0)
    path.unlink()
    assert film_of(poses, 0) == (poses, 0)


def test_a_folder_without_recordings_has_no_checksum(tmp_path: Path) -> None:
    assert checksum_of_files(tmp_path) == checksum_of_files(tmp_path / "none") == ""
