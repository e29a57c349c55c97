"""A checkpoint asks for no more memory or time than its size allows, and holds all that one needs."""

from __future__ import annotations

import io
import pickle
import tracemalloc
import zipfile
from collections import Counter, OrderedDict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch

from physid.data import tensors
from physid.data.files import read_tensors

BOMB = 10**9
Write = Callable[[Path], object]


class Called:
    """What a pickle holds as the call of a function."""

    def __init__(self, function: Any, *arguments: Any) -> None:
        self.call = function, arguments

    def __reduce__(self) -> Any:
        return self.call


def saved(content: Any) -> Write:
    """Return what writes something as a checkpoint of torch."""
    return lambda path: torch.save({"state_dict": content}, path)


def packed(content: bytes, compression: int = zipfile.ZIP_STORED) -> Write:
    """Return what writes a pickle and a storage of seven numbers as an archive of torch."""

    def write(path: Path) -> None:
        with zipfile.ZipFile(path, "w", compression) as archive:
            for name, each in (
                ("data.pkl", content),
                ("byteorder", b"little"),
                ("data/0", bytes(28)),
                ("version", b"3\n"),
            ):
                archive.writestr(f"last/{name}", each)

    return write


def changed(before: bytes, after: bytes) -> Write:
    """Return what writes seven numbers, a part of their pickle changed."""
    buffer = io.BytesIO()
    torch.save({"state_dict": torch.zeros(7)}, buffer)
    with zipfile.ZipFile(buffer) as archive:
        content = archive.read("archive/data.pkl")
    assert content.count(before) == 1
    return packed(content.replace(before, after))


def doubled(times: int) -> tuple[Any, ...]:
    """Return a tuple that holds a tuple twice, which holds one twice, and so on."""
    inner: tuple[Any, ...] = (1,)
    for _ in range(times):
        inner = inner, inner
    return inner


def holding_itself() -> list[Any]:
    """Return a list that holds itself."""
    own: list[Any] = []
    own.append(own)
    return own


def deep(levels: int) -> list[Any]:
    """Return a list in a list in a list."""
    inner: list[Any] = []
    for _ in range(levels):
        inner = [inner]
    return inner


@pytest.mark.parametrize(
    ("write", "message"),
    [
        (saved(Called(bytearray, BOMB)), "bytearray', which no checkpoint needs"),
        (saved(Called(torch.UntypedStorage, BOMB)), "UntypedStorage', which no checkpoint needs"),
        (saved(torch.zeros(1).expand(10**11)), "repeat beyond any measure"),
        (saved([torch.zeros(1000)] * 10**5), "repeat beyond any measure"),
        (saved(list(doubled(40))), "repeat beyond any measure"),
        (saved(["x" * 10**4] * 10**5), "repeat beyond any measure"),
        (saved(holding_itself()), "a part that holds itself"),
        (saved(deep(100)), "more than 64 levels"),
        (saved({doubled(10): 1}), "names are neither texts nor numbers"),
        (saved(Called(set, [doubled(30)])), "a set of what is neither"),
        (packed(pickle.dumps({"state_dict": 1}, 2), zipfile.ZIP_DEFLATED), "compressed entries"),
        (packed(pickle.dumps({"state_dict": bytearray(9)}, 5)), ""),
        (packed(b"\x80\x02}K\x01\x85R."), "a call of what is no function"),
        (packed(b"\x80\x02}}b."), "a change of what is no mapping"),
        (packed(b"\x80\x02](K\x01K\x02u."), "entries of what is no mapping"),
        (changed(b"K\x00K\x07\x85", b"K\x00J\x00\x00\x00\x10\x85"), "268435456 values in a storage of 7"),
        (changed(b"K\x07t", b"J\x00\x00\x00\x10t"), "268435456 values in an entry that holds fewer"),
        (changed(b"K\x00K\x07\x85", b"K\x01K\x07\x85"), "7 values in a storage of 7"),
        (lambda path: torch.save({"a": 1}, path, _use_new_zipfile_serialization=False), "not a zip file"),
    ],
)
def test_what_would_take_more_than_it_holds_is_refused_before_torch_reads_it(
    tmp_path: Path, write: Write, message: str
) -> None:
    path = tmp_path / "last.ckpt"
    write(path)
    tracemalloc.start()
    with pytest.raises(ValueError, match=rf"last\.ckpt: expected a checkpoint, found a damaged file .*{message}"):
        read_tensors(path)
    assert tracemalloc.get_traced_memory()[1] < 2 * 10**7
    tracemalloc.stop()


def test_plain_values_of_many_bytes_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tensors, "LARGEST_PICKLE", 1000)
    torch.save({"a": list(range(1000))}, tmp_path / "last.ckpt")
    with pytest.raises(ValueError, match="plain values of more than 1000 bytes"):
        read_tensors(tmp_path / "last.ckpt")


def test_what_optimizers_models_and_schedules_keep_is_read_as_it_was_written(tmp_path: Path) -> None:
    model = torch.nn.Sequential(torch.nn.Linear(3, 2), torch.nn.BatchNorm1d(2))
    optimizers = [torch.optim.Adam(model.parameters()), torch.optim.LBFGS(model.parameters())]
    for optimizer in optimizers:
        optimizer.step(lambda: model(torch.ones(4, 3)).square().sum())  # type: ignore[arg-type]
    base = torch.arange(6.0)
    content = {
        "state_dict": model.state_dict(),
        "optimizer_states": [each.state_dict() for each in optimizers],
        "schedule": torch.optim.lr_scheduler.MultiStepLR(optimizers[0], [3, 5]).state_dict(),
        "types": [getattr(torch, name) for name in tensors.TYPES],
        "values": [torch.zeros(2, dtype=getattr(torch, name)) for name in tensors.TYPES],
        "views": [base[1::2], base.view(2, 3).T, base[:0], torch.tensor(2.0).expand(3), torch.nn.Parameter(base)],
        "plain": [None, True, 2**70, 1.5, float("inf"), "ä", (1, (2,)), {1: {2.0: None}}, {"a", 1}, OrderedDict(a=1)],
        "counts": Counter([1, 1]),
        "size": base.shape,
        "device": base.device,
    }
    torch.save(content, tmp_path / "last.ckpt")
    assert str(read_tensors(tmp_path / "last.ckpt")) == str(content)
