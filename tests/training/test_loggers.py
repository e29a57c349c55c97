"""A result that is set to wandb: read back from the offline run."""

from __future__ import annotations

import json
import os
import struct
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from diagnosis.documents import NAMED, said
from physid.diagnosis.document.flat_figures import figures_of
from physid.training.runs.loggers import Reached, build_loggers, log_result

HEAD, BLOCK = 7, 32768  # of a log as LevelDB writes it: after a head come records in blocks, each with a head, too
PATIENCE = 20.0  # [s]
WHOLE, FIRST, LAST = 1, 2, 4


def records(path: Path) -> Iterator[bytes]:
    """Read the records of a log file, as far as it is written."""
    data, place, part = path.read_bytes(), HEAD, b""
    while place + HEAD <= len(data):
        left = BLOCK - place % BLOCK
        if left < HEAD:
            place += left
            continue
        _, length, kind = struct.unpack("<IHB", data[place : place + HEAD])
        if place + HEAD + length > len(data):
            return
        part = (b"" if kind in (WHOLE, FIRST) else part) + data[place + HEAD : place + HEAD + length]
        place += HEAD + length
        if kind in (WHOLE, LAST):
            yield part


def logged(folder: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return what the one offline run in a folder has logged, and its configuration."""
    from wandb.proto import wandb_internal_pb2

    def parsed(data: bytes) -> Any:
        record: Any = wandb_internal_pb2.Record()  # type: ignore[attr-defined, unused-ignore]
        record.ParseFromString(data)
        return record

    history: dict[str, Any] = {}
    config: dict[str, Any] = {}
    (path,) = folder.glob("wandb/offline-run-*/*.wandb")
    end = time.monotonic() + PATIENCE  # a process of its own writes the last records
    while "exit" not in [parsed(data).WhichOneof("record_type") for data in records(path)]:
        assert time.monotonic() < end
        time.sleep(0.1)
    for record in map(parsed, records(path)):
        kind = record.WhichOneof("record_type")
        if kind == "history":
            history |= {
                each.key or ".".join(each.nested_key): json.loads(each.value_json) for each in record.history.item
            }
        if kind == "run":
            config |= {each.key: json.loads(each.value_json) for each in record.run.config.update}
    return history, config


def test_an_offline_run_holds_figures_ranking_page_and_film(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WANDB_MODE", "offline")
    (tmp_path / "report.html").write_text("<p>report</p>")
    (tmp_path / "film.mp4").write_bytes(b"film")
    tables = {"ranking": (("effects", "score"), [("viscous_drag", 412.3)])}
    media = [tmp_path / "report.html", tmp_path / "film.mp4", tmp_path / "missing.mp4"]
    log_result(tmp_path, "disabled", {"recordings": "data/drag"}, figures_of(said()), tables, media)
    found, config = logged(tmp_path)
    assert found["verdict"] == "named"
    assert found["effects/viscous_drag/coefficient/value"] == 0.21
    assert found["gap/same/before"] == NAMED["gap"]["same"]["before"]
    assert found["ranking.nrows"] == 1
    assert found["report._type"] == "html-file"
    assert found["film._type"] == "video-file"
    assert "missing._type" not in found
    assert config["recordings"] == "data/drag"


def test_nothing_is_logged_where_it_is_not_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WANDB_MODE", "disabled")
    log_result(tmp_path, "offline", {}, {"a": 1.0}, {}, [])
    assert not (tmp_path / "wandb").exists()
    monkeypatch.setenv("WANDB_MODE", "sometimes")
    with pytest.raises(ValueError, match="got 'sometimes'"):
        log_result(tmp_path, "offline", {}, {"a": 1.0}, {}, [])


@pytest.mark.parametrize("verdict", ["none", "named", "group", "unknown"])
def test_figures_are_numbers_and_texts_without_gaps(verdict: str) -> None:
    figures = figures_of(said(verdict, transfer=False))
    assert figures["verdict"] == verdict
    assert all(isinstance(value, int | float | str) for value in figures.values())
    assert not [name for name in figures if name.startswith("gap/transfer")]
    assert ("effects/viscous_drag/coefficient/low" in figures) == (verdict in ("named", "group"))


@pytest.mark.parametrize("endless", [os.mkfifo, lambda path: path.symlink_to("/dev/zero")])
def test_a_history_that_is_no_file_stops_what_would_go_on_with_it(
    tmp_path: Path, endless: Callable[[Path], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("WANDB_MODE", "disabled")
    endless(tmp_path / "metrics.csv")
    with pytest.raises(OSError, match=r"metrics\.csv: expected a regular file, found a .*; put a file in its place"):
        build_loggers(tmp_path, "disabled", {}, Reached(1, {}))
