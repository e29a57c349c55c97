"""Files are there whole or not at all, and a damaged one is named."""

from __future__ import annotations

import random
from pathlib import Path

import pytest
import torch

from physid.data.files import read_json, read_tensors, write_picture, write_tensors, write_text, write_whole

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
    (tmp_path / "state.pt.part").symlink_to("/dev/full")
    with pytest.raises(OSError, match="No space left"):
        write_tensors(tmp_path / "state.pt", {"a": torch.arange(10_000.0)})
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
