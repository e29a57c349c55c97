"""The record of a run, and that a run repeats itself."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest
import torch

from physid.cli import main
from physid.data.format import SUMS
from physid.record import COMMIT, Source, checksum, describe, recording_sets, source, write_record

ROOT = Path(__file__).parent.parent
CONFIG = str(ROOT / "configs" / "sysid" / "push_friction.yaml")
MEASURED_ANEW = {"seconds"}


def figures(folder: Path) -> dict[str, float]:
    """Return metrics.json without what a clock measured."""
    read: dict[str, float] = json.loads((folder / "metrics.json").read_text())
    return {name: value for name, value in read.items() if name not in MEASURED_ANEW}


def record(folder: Path) -> dict[str, Any]:
    read: dict[str, Any] = json.loads((folder / "record.json").read_text())
    return read


@pytest.mark.slow
def test_two_runs_of_a_configuration_give_the_same_figures_to_the_last_digit(
    recordings: Callable[[str], Path], tmp_path: Path
) -> None:
    words = ["fit", "--config", CONFIG, f"data.folder={recordings('push')}", "trainer.max_epochs=3"]
    assert main([*words, f"--run-dir={tmp_path / 'one'}"]) == 0
    assert main([*words, f"--run-dir={tmp_path / 'two'}"]) == 0
    assert main(["fit", "--config", str(tmp_path / "one" / "config.yaml"), f"--run-dir={tmp_path / 'again'}"]) == 0
    assert figures(tmp_path / "one") == figures(tmp_path / "two") == figures(tmp_path / "again")
    assert (tmp_path / "one" / "metrics.csv").read_bytes() == (tmp_path / "two" / "metrics.csv").read_bytes()
    assert record(tmp_path / "one")["data"] == {str(recordings("push")): checksum(recordings("push"))}


def test_a_record_names_versions_source_data_machine_and_command(recordings: Callable[[str], Path]) -> None:
    made = describe({"data": {"init_args": {"folder": str(recordings("push"))}}, "model": ["no set"]}).to_mapping()
    assert made["packages"]["torch"] == metadata.version("torch")
    # A build from PyPI names its kind ("+cu130") in torch alone, not in what pip knows.
    assert made["packages"]["torch"].split("+")[0] == torch.__version__.split("+")[0]
    assert made["source"]["version"] == metadata.version("physid")
    assert len(made["data"][str(recordings("push"))]) == 64
    assert made["machine"]["cores"] >= 1
    assert made["command"]
    json.dumps(made, allow_nan=False)


def test_the_commit_is_that_of_the_source_or_of_the_image(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    head = subprocess.run(["git", "-C", str(ROOT), "rev-parse", "HEAD"], capture_output=True, text=True, check=False)
    if head.returncode == 0:
        assert source().commit == head.stdout.strip()
    monkeypatch.setenv("PATH", str(tmp_path))  # no git
    monkeypatch.setenv(COMMIT, "abc")
    assert source() == Source(metadata.version("physid"), "abc", None)


def test_the_checksum_of_a_set_depends_on_its_content_alone(recordings: Callable[[str], Path], tmp_path: Path) -> None:
    original = recordings("push")
    copy = tmp_path / "elsewhere"
    subprocess.run(["cp", "-r", str(original), str(copy)], check=True)
    (copy / SUMS).unlink()
    assert checksum(copy) == checksum(original)
    with (copy / "recording.yaml").open("a") as file:
        file.write("# a comment\n")
    assert checksum(copy) != checksum(original)


def test_sets_are_found_anywhere_in_a_configuration(recordings: Callable[[str], Path]) -> None:
    folder = str(recordings("push"))
    values = {"a": [{"b": folder}], "c": "no/such/folder", "d": None, "e": 3, "f": "two\nlines"}
    assert list(recording_sets(values)) == [folder]


def test_a_resumed_run_keeps_the_record_of_its_first_session(tmp_path: Path) -> None:
    for _ in range(3):
        write_record(tmp_path, {})
    last = record(tmp_path)
    assert len(last["earlier"]) == 2
    assert all("earlier" not in each for each in last["earlier"])


def test_a_damaged_record_is_named(tmp_path: Path) -> None:
    write_record(tmp_path, {})
    content = record(tmp_path)
    (tmp_path / "record.json").write_text(json.dumps(content | {"comand": 3}))
    with pytest.raises(ValueError, match=r'record.json: unknown key "comand"; did you mean "command"'):
        write_record(tmp_path, {})
    (tmp_path / "record.json").write_text("{")
    with pytest.raises(ValueError, match=r"record.json: expected JSON, found a damaged file .*; delete it"):
        write_record(tmp_path, {})
