"""What the system refuses is said with the file or folder that a user knows, and what to do about it."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
import yaml
from tests.data.sets import SCENE

from physid import cli
from physid.cli import main
from physid.data import refusals, write_scene
from physid.data.files import write_whole
from physid.data.refusals import worded


def test_a_folder_that_may_not_be_written_to_is_named_without_what_is_physids_own(tmp_path: Path) -> None:
    for name in ("on.part", "on", ".lock", "on.part/.lock", "deeper/recording.yaml.part"):
        said = worded(PermissionError(13, "Permission denied", str(tmp_path / name)))
        assert ".part" not in said
        assert ".lock" not in said
        assert f"found that {tmp_path} may not be (permission denied); choose another folder, or change" in said
        assert said.startswith(str(tmp_path / name.removesuffix(".lock").strip("/").removesuffix(".part")))


def test_a_file_that_may_not_be_read_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "log.csv"
    path.write_text("t")
    monkeypatch.setattr(refusals.os, "access", lambda place, mode: not (place == path and mode == os.R_OK))
    said = worded(PermissionError(13, "Permission denied", str(path)))
    assert said.startswith(f"{path}: expected what may be read")
    assert f"chmod u+r {path}" in said


def test_a_folder_that_may_not_be_looked_into_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "set" / "recording.yaml"
    path.parent.mkdir()
    path.write_text("name: a")
    monkeypatch.setattr(refusals.os, "access", lambda place, mode: place != path.parent)
    monkeypatch.setattr(refusals.os.path, "exists", lambda place: place != path)
    said = worded(PermissionError(13, "Permission denied", str(path)))
    assert f"found that {path.parent} may not be (permission denied)" in said
    assert f"chmod u+rx {path.parent}" in said


def test_a_full_disk_and_other_refusals_are_named_and_own_words_are_kept(tmp_path: Path) -> None:
    said = worded(OSError(28, "No space left on device", str(tmp_path / "a.h5.part")))
    assert said.startswith(f"{tmp_path / 'a.h5'}: expected room on the disk")
    assert worded(NotADirectoryError(20, "Not a directory", "a/b")) == "a/b: not a directory"
    assert worded(FileNotFoundError("x: expected a film, found none")) == "x: expected a film, found none"


def test_what_cannot_be_written_is_named_whatever_the_library_says(tmp_path: Path) -> None:
    def refuse(part: Path) -> None:
        raise OSError(13, f"Unable to create file (name = '{part}')")  # as h5py says it

    with pytest.raises(PermissionError, match="Permission denied") as caught:
        write_whole(tmp_path / "a.h5", refuse)
    assert caught.value.filename == str(tmp_path / "a.h5")


def test_the_command_line_says_it_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(words: list[str]) -> int:
        raise PermissionError(13, "Permission denied", str(tmp_path / "on.part"))

    monkeypatch.setattr(cli, "_run", refuse)
    assert cli.main(["show", "x"]) == cli.USAGE
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"physid: {tmp_path / 'on'}: expected a place that may be written to")
    assert "Errno" not in line


def test_a_user_without_a_home_is_told_in_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def homeless(*_: object) -> None:
        monkeypatch.setattr(os.path, "expanduser", str)
        Path("~").expanduser()

    monkeypatch.setattr("physid.cli._run", homeless)
    assert main(["effects"]) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert len(said) == 1
    assert "HOME: expected the folder of the user" in said[0]


@pytest.mark.parametrize("change", [{"unknown": ["b\x1b[2J.mass"]}, {"a\x1b[2J": {"b": 1 << 70}}, {"bodies": []}])
def test_what_a_file_holds_reaches_no_terminal_as_a_command(
    tmp_path: Path, change: dict[str, object], capsys: pytest.CaptureFixture[str]
) -> None:
    write_scene(tmp_path, SCENE)
    content = yaml.safe_load((tmp_path / "recording.yaml").read_text())
    if "bodies" in change:
        content["bodies"][0]["name"] = "b\x1b[2J\nc"
    else:
        content |= change
    (tmp_path / "recording.yaml").write_text(yaml.safe_dump(content))
    assert main(["check", str(tmp_path)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.isprintable()
    assert r"\x1b[2J" in line
