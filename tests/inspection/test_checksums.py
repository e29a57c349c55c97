"""`physid check` compares the files of a set with its SHA256SUMS."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from tests.data.sets import recording, write_set

from physid.cli import main
from physid.data import RecordingSet, trajectory_path, write_trajectory
from physid.inspection.finding import Finding
from physid.inspection.report import inspect

LEFT = "delete SHA256SUMS if you changed the set yourself"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return write_set(tmp_path / "set", [recording(seed=seed) for seed in range(3)])


def found(folder: Path, limit: int | None = None) -> list[Finding]:
    return [one for one in inspect(RecordingSet(folder), limit).findings if "SHA256SUMS" in one.what]


def test_a_set_as_it_was_written_fits(folder: Path) -> None:
    assert found(folder) == []


def test_files_that_differ_or_are_missing_are_named(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_trajectory(trajectory_path(folder, 1), recording(seed=7))
    trajectory_path(folder, 2).unlink()
    (one,) = found(folder)
    assert one.wrong
    assert one.what.startswith("000001.h5, 000002.h5: missing, or not as written")
    assert LEFT in one.mend
    assert main(["check", str(folder)]) == 1
    assert "Nothing looks wrong" not in capsys.readouterr().out
    (one,) = found(folder, limit=1)
    assert one.what.startswith("000002.h5: "), "what lies beyond the limit is not read"


def test_wrong_sums_are_a_finding_and_many_files_are_counted(folder: Path) -> None:
    sums = folder / "SHA256SUMS"
    sums.write_text("".join(f"{'0' * 64}  trajectories/{index:06d}.h5\n" for index in range(9)))
    (one,) = found(folder)
    assert one.what.startswith("000000.h5, 000001.h5, 000002.h5, 000003.h5, 000004.h5 and 4 more: ")


def test_a_description_that_was_corrected_by_hand_is_a_remark(folder: Path) -> None:
    with (folder / "recording.yaml").open("a") as file:
        file.write("# measured again\n")
    (one,) = found(folder)
    assert not one.wrong
    assert one.what.startswith("recording.yaml is not as written")


def test_a_set_without_sums_is_not_asked_for_them(folder: Path) -> None:
    (folder / "SHA256SUMS").unlink()
    trajectory_path(folder, 2).unlink()
    assert found(folder) == []


@pytest.mark.parametrize(
    ("content", "what"),
    [
        (b"\xff\xfe", "expected checksums as text in UTF-8"),
        (b"abc", "expected a checksum and a file of the set, found 'abc'"),
        (b"0  ../outside\n", "expected a checksum and a file of the set"),
        (b"0  /dev/zero\n", "expected a checksum and a file of the set"),
    ],
)
def test_damaged_sums_are_a_finding_and_nothing_outside_of_the_set_is_read(
    folder: Path, content: bytes, what: str
) -> None:
    (folder / "SHA256SUMS").write_bytes(content)
    (one,) = found(folder)
    assert one.wrong
    assert what in one.what
    with pytest.raises(ValueError, match="SHA256SUMS: expected"):
        RecordingSet(folder).verify()


def test_a_trajectory_that_became_a_pipe_differs_and_nothing_waits_for_it(folder: Path) -> None:
    trajectory_path(folder, 2).unlink()
    os.mkfifo(trajectory_path(folder, 2))
    (one,) = found(folder)
    assert one.what.startswith("000002.h5: missing, or not as written")


def test_who_waits_is_told_of_each_file_that_was_compared(folder: Path) -> None:
    known, done = RecordingSet(folder), list[Path]()
    inspect(known, compared=done.append)
    assert sorted(done) == sorted([known.folder / "recording.yaml", *known.paths])
