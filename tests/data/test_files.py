"""Files are there whole or not at all, and a damaged one is named."""

from __future__ import annotations

import os
import random
import resource
from collections.abc import Callable
from pathlib import Path

import pytest
import torch

from physid.data.files import (
    UNFINISHED,
    finish,
    holds_anything,
    read_json,
    read_tensors,
    whole_folder,
    write_picture,
    write_tensors,
    write_text,
    write_whole,
)

DAMAGES = 200


def test_what_fails_half_way_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    write_text(path, "old")

    def half(part: Path) -> None:
        part.write_text("ne")
        raise OSError(28, "No space left on device")

    with pytest.raises(OSError, match="No space"):
        write_whole(path, half)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    "stands",
    [lambda part, mine: part.symlink_to(mine), lambda part, mine: os.link(mine, part), lambda part, _: os.mkfifo(part)],
)
def test_what_stands_under_the_name_of_a_file_being_written_is_not_written_to(
    tmp_path: Path, stands: Callable[[Path, Path], None]
) -> None:
    (tmp_path / "precious").write_text("mine")
    (tmp_path / "run").mkdir()
    stands(tmp_path / "run" / "a.txt.part", tmp_path / "precious")
    write_text(tmp_path / "run" / "a.txt", "new")
    assert (tmp_path / "precious").read_text() == "mine"
    (found,) = (tmp_path / "run").iterdir()
    assert (found.name, found.read_text(), found.is_symlink()) == ("a.txt", "new", False)


def test_a_link_under_the_name_of_a_file_is_replaced_and_not_what_it_leads_to(tmp_path: Path) -> None:
    (tmp_path / "precious").write_text("mine")
    (tmp_path / "a.txt").symlink_to(tmp_path / "precious")
    write_text(tmp_path / "a.txt", "new")
    assert (tmp_path / "precious").read_text() == "mine"
    assert (tmp_path / "a.txt").read_text() == "new"


def test_a_folder_under_the_name_of_a_file_being_written_stays_and_is_named(tmp_path: Path) -> None:
    (tmp_path / "a.txt.part").mkdir()
    (tmp_path / "a.txt.part" / "mine").touch()
    with pytest.raises(OSError, match=r"a\.txt\.part: expected the name of a file .*, found a folder; rename or"):
        write_text(tmp_path / "a.txt", "new")
    assert (tmp_path / "a.txt.part" / "mine").exists()


def test_a_new_file_has_the_rights_that_the_umask_leaves(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        write_text(tmp_path / "a.txt", "new")
    finally:
        os.umask(before)
    assert (tmp_path / "a.txt").stat().st_mode & 0o777 == 0o640


def test_a_filled_folder_holds_what_was_written_and_nothing_else(tmp_path: Path) -> None:
    with whole_folder(tmp_path / "out") as place:
        (place / "a").write_text("new")
        assert not (tmp_path / "out").exists()
    assert [path.name for path in tmp_path.rglob("*")] == ["out", "a"]


def test_what_a_killed_run_has_left_of_a_folder_is_cleared(tmp_path: Path) -> None:
    part = tmp_path / "out.part"
    for names in ([], [".lock"], [".lock", UNFINISHED], [UNFINISHED, "half"], [".lock", UNFINISHED, "half"]):
        part.mkdir()
        for name in names:
            (part / name).touch()
        with whole_folder(tmp_path / "out", overwrite=True) as place:
            (place / "a").touch()
        assert sorted(path.name for path in tmp_path.rglob("*")) == ["a", "out"]


def test_a_folder_whose_last_rename_was_the_last_of_a_killed_run_is_whole(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / UNFINISHED).touch()
    (tmp_path / "out" / "a").touch()
    finish(tmp_path / "out")
    assert holds_anything(tmp_path / "out")
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["a"]


def test_a_folder_that_fails_leaves_nothing_and_one_that_was_filled_meanwhile_stays(tmp_path: Path) -> None:
    def fill(fails: bool) -> None:
        with whole_folder(tmp_path / "out") as place:
            (place / "a").touch()
            if fails:
                raise ValueError("no")
            (tmp_path / "out").mkdir()
            (tmp_path / "out" / "mine").touch()

    with pytest.raises(ValueError, match="no"):
        fill(fails=True)
    assert not list(tmp_path.iterdir())
    with pytest.raises(OSError, match="not empty"):
        fill(fails=False)
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["mine", "out"]


def test_a_folder_of_the_users_own_under_the_temporary_name_is_not_cleared(tmp_path: Path) -> None:
    (tmp_path / "out.part" / "my").mkdir(parents=True)
    (tmp_path / "out.part" / "my" / "thesis.txt").write_text("mine")
    message = (
        rf"out\.part: expected what an earlier run left unfinished, .*, found 'my' and no file {UNFINISHED}; rename"
    )
    with pytest.raises(FileExistsError, match=message), whole_folder(tmp_path / "out"):
        pytest.fail("cleared")
    assert [path.name for path in tmp_path.rglob("*")] == ["out.part", "my", "thesis.txt"]
    (tmp_path / "file.part").write_text("mine")
    with (
        pytest.raises(FileExistsError, match=r"file\.part: .*, found a file; rename it"),
        whole_folder(tmp_path / "file"),
    ):
        pytest.fail("replaced")
    assert (tmp_path / "file.part").read_text() == "mine"


@pytest.mark.parametrize("name", ["out", "out.part"])
def test_a_folder_is_filled_through_no_link(tmp_path: Path, name: str) -> None:
    (tmp_path / "home").mkdir()
    (tmp_path / "home" / "mine").write_text("mine")
    (tmp_path / name).symlink_to(tmp_path / "home")
    message = rf"{name}: expected a new folder, or none, found a symbolic link;"
    with pytest.raises(OSError, match=message), whole_folder(tmp_path / "out", overwrite=True):
        pytest.fail("followed")
    assert [path.name for path in (tmp_path / "home").iterdir()] == ["mine"]


@pytest.mark.parametrize("content", [b"", b"{", b"\xff", b"[" * 100_000, b"nul"])
def test_damaged_json_is_named_with_what_to_do(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "record.json"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"record\.json: expected a record as JSON, found a damaged file .*; delete"):
        read_json(path, "a record")


def test_a_damaged_checkpoint_is_named_whatever_is_wrong_with_it(tmp_path: Path) -> None:
    whole, path, draw = tmp_path / "whole.ckpt", tmp_path / "last.ckpt", random.Random(0)
    torch.save({"state_dict": {"a": torch.arange(50.0)}, "epoch": 3, "text": "x" * 300}, whole)
    content = whole.read_bytes()
    for _ in range(DAMAGES):
        changed = bytearray(content)
        if draw.random() < 0.5:
            changed = changed[: draw.randrange(len(changed))]
        for _ in range(draw.randrange(1, 20)):
            if changed:
                changed[draw.randrange(len(changed))] = draw.randrange(256)
        path.write_bytes(changed)
        message = f"{path}: expected a checkpoint"
        try:
            read_tensors(path, ["state_dict"])
        except ValueError as error:
            message = str(error)
        assert message.startswith(f"{path}: expected a checkpoint")
        assert len(message.splitlines()) == 1


def test_a_checkpoint_that_would_run_code_is_refused(tmp_path: Path) -> None:
    class Hostile:
        def __reduce__(self) -> tuple[object, ...]:
            return (Path.touch, (tmp_path / "hit",))

    torch.save({"state_dict": Hostile()}, tmp_path / "last.ckpt")
    with pytest.raises(ValueError, match=r"last\.ckpt: expected a checkpoint"):
        read_tensors(tmp_path / "last.ckpt")
    assert not (tmp_path / "hit").exists()


def test_a_checkpoint_that_lacks_a_part_is_named_with_it(tmp_path: Path) -> None:
    torch.save({"epoch": 1}, tmp_path / "last.ckpt")
    with pytest.raises(ValueError, match=r"last\.ckpt: expected a checkpoint with state_dict, found none"):
        read_tensors(tmp_path / "last.ckpt", ["epoch", "state_dict"])


def test_tensors_for_which_the_disk_has_no_room_are_an_error_of_the_system(tmp_path: Path) -> None:
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, before[1]))
    try:
        with pytest.raises(OSError, match=r"File too large: .*state\.pt'$"):
            write_tensors(tmp_path / "state.pt", {"a": torch.arange(10_000.0)})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert not list(tmp_path.iterdir())
    write_tensors(tmp_path / "state.pt", {"a": torch.arange(3.0)})
    assert read_tensors(tmp_path / "state.pt", ["a"])["a"].tolist() == [0, 1, 2]


def test_a_picture_is_there_whole_or_not_at_all(tmp_path: Path) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(1, 1))
    assert write_picture(tmp_path / "new" / "a.png", figure) == (tmp_path / "new" / "a.png").read_bytes()
    figure.text(0.5, 0.5, "$x_{$")  # matplotlib cannot draw this
    with pytest.raises(ValueError, match="x_"):
        write_picture(tmp_path / "b.png", figure)
    assert [each.name for each in tmp_path.iterdir()] == ["new"]
