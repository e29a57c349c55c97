"""What is asked for beyond any measure is refused at once, in a line that names it, its bounds and what came."""

from __future__ import annotations

import dataclasses
import errno
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from physid import cli
from physid.cli import main
from physid.commands import COMMANDS
from physid.commands.terminal.parser_errors import shorten
from physid.configuration import compose
from physid.data import RecordingSet
from physid.data.batches.datamodule import RecordingsDataModule
from physid.data.generation.settings import GenerateConfig
from physid.data.refusals import out_of_memory, worded
from physid.diagnosis.inputs.model_source import read_nominal_model
from physid.diagnosis.settings.settings import Settings
from physid.record import checksum
from physid.scenes import Integration, find_setup
from physid.schema.check import trusted_packages
from physid.simulators import find_simulator, sample
from physid.strict import LARGEST
from physid.training.learners.engine import Engine

HUGE = 184467440737095516
PUSH, PLAN = ["generate", "--config", "generate/push"], ["identifiability", "--config", "identifiability/push"]


def said(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """Run a command that is refused, and return the line that says why."""
    assert main(words) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    return line


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([*PUSH, f"trajectories={HUGE}"], f"trajectories must be a whole number of at most 1000000, got {HUGE}"),
        ([*PUSH, f"steps={HUGE}"], f"steps (with video) must be a whole number of at most 100000, got {HUGE}"),
        ([*PUSH, f"steps={HUGE}", "video=false"], f"steps must be a whole number of at most 10000000, got {HUGE}"),
        ([*PUSH, f"substeps={HUGE}"], f"substeps must be a whole number of at most 100000, got {HUGE}"),
        (
            [*PUSH, "substeps=100000", "steps=1001"],
            "steps, substeps: expected at most 100000000 steps of the simulator",
        ),
        ([*PUSH, "frame_rate=1e-300"], "frame_rate must be a number of at least 0.01, got 1e-300"),
        ([*PUSH, "force_rate=1e300"], "force_rate must be a number of at most 1e+06, got 1e+300"),
        ([*PUSH, "frame_rate=0.01", "force_rate=1e6"], "lower steps or substeps, or change frame_rate or force_rate"),
        ([*PLAN, f"trajectories={HUGE}"], f"trajectories must be a whole number of at most 1000000, got {HUGE}"),
        ([*PLAN, f"steps={HUGE}"], f"steps must be a whole number of at most 10000000, got {HUGE}"),
        ([*PLAN, "trajectories=10001", "steps=1000"], "trajectories, steps: expected at most 10000000 frames in all"),
        (
            ["reproduce", "--seeds", f"{HUGE}"],
            f"--seeds must be a whole number of at most 10000, got {HUGE}",
        ),
        (["reproduce", "--at-once", "0"], "reproduce: --at-once must be from 1 to 4096, or -1 for one on each core"),
        (
            [*PUSH, "--workers", f"{HUGE}"],
            "generate: --workers must be from 1 to 4096, or -1 for one on each core, got",
        ),
        (
            ["sample", "x", "--count", f"{HUGE}"],
            f"sample: --count must be a whole number of at most 10000000, got {HUGE}",
        ),
        (["diagnose", "x", "--seed", f"{HUGE}000"], f"of at most 9223372036854775807, got {HUGE}000"),
        (["diagnose", "x", "--seed", "-1"], "diagnose: --seed must be a whole number of at least 0, got -1"),
        (["benchmark", "diagnosis", "--sets", f"{HUGE}"], f"sets must be a whole number of at most 100000, got {HUGE}"),
        (["diagnose", "x", f"gap.bootstraps={HUGE}"], f"less than or equal to 1000000, got {HUGE}"),
    ],
)
def test_huge_numbers_are_refused_before_anything_is_made(
    words: list[str], message: str, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert message in said(words, capsys)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("command", [each.name for each in COMMANDS if "limit" in each.options])
@pytest.mark.parametrize("limit", [0, -1])
def test_a_limit_lets_something_be_looked_at(command: str, limit: int, capsys: pytest.CaptureFixture[str]) -> None:
    line = said([command, "data/none", "--limit", str(limit)], capsys)
    assert line.endswith(f"{command}: --limit must be a whole number of at least 1, got {limit}")


def test_what_honest_users_ask_for_is_within_the_bounds() -> None:
    GenerateConfig("push", trajectories=10**6, steps=10**4, frame_rate=1000.0, force_rate=10_000.0, substeps=100)
    GenerateConfig("push", steps=10**7, video=False)
    Settings().changed({"gap.bootstraps": 10**5})
    assert sample(1 / 240, 10**4, find_simulator("mujoco"), substeps=100, jitter=0.1).length > 10**4


def test_a_model_takes_no_more_substeps_than_there_can_be(recordings: Callable[[str], Path]) -> None:
    with pytest.raises(ValueError, match=rf"^model\.engine\.substeps must be from 1 to 100000, .* got {2**64 - 1}$"):
        Engine(substeps=2**64 - 1)
    scene = find_setup("push").scene
    with pytest.raises(ValueError, match=r"model\.engine\.substeps must be a whole number of at most 100000, got 10"):
        read_nominal_model(scene, {"model": {"engine": {"substeps": 10**9}}})
    with pytest.raises(ValueError, match=r"integration\.step must be at least time_step / 100000, got 1e-300 s"):
        dataclasses.replace(scene, integration=Integration("semi_implicit_euler", 1e-300))
    with pytest.raises(ValueError, match=r"data\.workers must be a whole number of at most 4096, got"):
        RecordingsDataModule(recordings("push"), workers=2**64 - 1)
    assert len(list(RecordingsDataModule(recordings("push"), batch_size=2**64 - 1).train_dataloader())) == 1


def test_what_is_learned_or_unknown_is_named_once(
    recordings: Callable[[str], Path], capsys: pytest.CaptureFixture[str]
) -> None:
    line = said(["identifiability", str(recordings("push")), "--learn", "block.mass,block.mass"], capsys)
    assert line == "physid: learn: block.mass is named twice; name it once"
    assert "unknown: block.mass is named twice" in said([*PUSH, "unknown=[block.mass,block.mass]"], capsys)


def spent() -> list[Exception]:
    """Return what Python, NumPy and torch raise where memory is short."""
    found: list[Exception] = [MemoryError(), OSError(errno.ENOMEM, "Cannot allocate memory")]
    for ask in (lambda: np.empty(2**62, np.uint8), lambda: torch.empty(2**50)):
        with pytest.raises((MemoryError, RuntimeError)) as caught:
            ask()
        found.append(caught.value)
    return [*found, torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 20.00 MiB. GPU 0 has a total ...")]


def test_memory_that_is_short_is_said_in_a_line_with_a_remedy(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for error in spent():

        def fail(words: list[str], error: Exception = error) -> int:
            raise error

        monkeypatch.setattr(cli, "_run", fail)
        assert main(["fit"]) == 1
        (line,) = capsys.readouterr().err.splitlines()
        assert line.startswith("physid: memory: expected room for ")
        assert "found none; ask for less at once, by what the command has of limit, trajectories, steps" in line
    assert "room for 20.00 MiB, found" in line


@pytest.mark.parametrize(
    "error", [RuntimeError("size mismatch"), ValueError("memory"), OSError(2, "No such file", "x")]
)
def test_other_errors_are_not_taken_for_a_want_of_memory(error: Exception) -> None:
    assert not out_of_memory(error)
    assert "expected room" not in worded(error)


def test_the_message_of_a_bound_below_alternatives_is_one_line() -> None:
    outer = "Does not validate\nErrors:\n  - {}\n  - Expected a <class 'NoneType'>"
    inner = "Does not validate against any of the Union subtypes\nErrors:\n  - substeps must be 1, got 0"
    assert shorten(outer.format(inner)) == "substeps must be 1, got 0"


@pytest.mark.parametrize("seed", [-1, 2**32])
def test_a_seed_that_cannot_be_is_named(
    seed: int, recordings: Callable[[str], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words: list[Any] = ["fit", str(recordings("push")), f"seed_everything={seed}", f"--run-dir={tmp_path}"]
    bound = "least 0" if seed < 0 else f"most {LARGEST['seed_everything']}"
    assert f"seed_everything must be a whole number of at {bound}, got {seed}" in said(words, capsys)


def test_what_is_no_package_and_no_file_is_not_allowed_in_silence(
    recordings: Callable[[str], Path], capsys: pytest.CaptureFixture[str]
) -> None:
    for words in (["fit", str(recordings("push"))], ["diagnose", str(recordings("push"))], PUSH):
        for place in ("../x", "my_package,a/b", "evil package", "a..b"):
            line = said([*words, "--allow", place], capsys)
            assert "--allow: expected the name of a package, as my_package, or a file of effects" in line
    assert compose(["generate/push"], allowed=trusted_packages(["my_package", "a.b"])).allowed == ("my_package", "a.b")


@pytest.mark.parametrize("kind", ["folder", "link", "nothing"])
def test_a_run_without_a_configuration_is_no_model_and_is_not_proposed_again(
    kind: str, recordings: Callable[[str], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = tmp_path / "run"
    run.mkdir()
    if kind == "folder":
        (run / "config.yaml").mkdir()
    elif kind == "link":
        (run / "config.yaml").symlink_to(tmp_path / "nowhere")
    line = said(["diagnose", str(recordings("push")), "--model", str(run), "--out", str(tmp_path / "out")], capsys)
    assert line.startswith(f"physid: {run}: expected a run of `physid fit` with a file config.yaml, found none there")
    line = said(["fit", "--config", str(run / "config.yaml")], capsys)
    assert "did you mean" not in line or str(run) not in line.partition("did you mean")[2]


def test_checksums_that_are_no_text_are_named(tmp_path: Path, recordings: Callable[[str], Path]) -> None:
    damaged = shutil.copytree(recordings("push"), tmp_path / "set")
    (damaged / "SHA256SUMS").write_bytes(b"ab\xff")
    for read in (lambda: checksum(damaged), RecordingSet(damaged).verify):
        with pytest.raises(ValueError, match="set/SHA256SUMS: expected checksums as text in UTF-8, found byte 0xff"):
            read()


@pytest.mark.parametrize("ending", ["sys.exit(3)", "raise SystemExit", "exit()"])
def test_a_file_of_effects_does_not_end_physid(
    ending: str, recordings: Callable[[str], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "ends.py"
    file.write_text(f"import sys\n{ending}\n")
    for words in (["diagnose", str(recordings("push")), "--effects"], ["fit", str(recordings("push")), "--allow"]):
        assert said([*words, str(file)], capsys).startswith(f"physid: {file} cannot be run: SystemExit: ")
