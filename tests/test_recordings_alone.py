"""Recordings without a configuration: the scene says what is unknown."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.data.sets import recording, write_set

from physid.cli import main
from physid.data import RecordingSet


@pytest.fixture
def made(recordings: Callable[[str], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = recordings("push")
    monkeypatch.chdir(tmp_path)
    return folder


def test_a_set_is_fitted_tested_and_predicted_by_its_name(made: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["fit", str(made), "trainer.max_epochs=2"]) == 0
    printed = capsys.readouterr().out
    assert "block.friction" in printed
    assert "(90 %" in printed
    assert main(["test", str(made)]) == 0
    assert "% of the size" in capsys.readouterr().out
    assert main(["predict", str(made), "data.limit=2"]) == 0
    assert len(RecordingSet(Path("runs", made.name, "predictions"))) == 2


@pytest.mark.slow
def test_the_limit_of_a_run_is_that_of_its_own_recordings(made: Path, tmp_path: Path) -> None:
    assert main(["fit", str(made), "trainer.max_epochs=1", "data.limit=2", "--run-dir", "runs/few"]) == 0
    taken = [dataclasses.replace(RecordingSet(made).read(index), split=None) for index in range(3)]
    others = write_set(tmp_path / "others", taken, RecordingSet(made).scene)
    assert main(["predict", str(others), "--run-dir", "runs/few"]) == 0
    assert len(RecordingSet(Path("runs/few/predictions"))) == 3


@pytest.mark.slow
def test_others_that_name_no_split_are_tested_whole_and_what_was_fitted_only_where_it_is_asked_for(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    taken = [dataclasses.replace(RecordingSet(made).read(index), split=None) for index in range(3)]
    mine, others = (write_set(tmp_path / name, taken, RecordingSet(made).scene) for name in ("mine", "others"))
    assert main(["fit", str(mine), "trainer.max_epochs=1"]) == 0
    capsys.readouterr()
    assert main(["test", str(others), "--run-dir", "runs/mine"]) == 0
    whole = capsys.readouterr().out
    assert "% of the size" in whole
    assert main(["test", str(mine)]) == 2
    assert "data.test=[train] tests on what was fitted" in capsys.readouterr().err
    assert main(["test", str(mine), "data.test=[train]"]) == 0
    assert capsys.readouterr().out == whole, "the same trajectories"


@pytest.mark.parametrize("given", ["null", "train", "3"])
def test_splits_that_are_no_list_are_refused(given: str, made: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["fit", str(made), f"data.test={given}"]) == 2
    said = capsys.readouterr().err
    assert "data.test" in said
    assert "expected Sequence" in said or "must be a list of splits" in said


@pytest.mark.slow
def test_another_parameter_and_another_run_are_chosen_on_the_command_line(
    made: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["model.learn=[block.mass]", "--run-dir=runs/mass", "trainer.max_epochs=1"]
    assert main(["fit", str(made), *words]) == 0
    assert " kg (90 %" in capsys.readouterr().out
    assert main(["test", str(made), "--run-dir", "runs/mass"]) == 0


def test_a_set_says_what_it_identifies(made: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["identifiability", str(made), "--learn=block.mass,block.friction"]) == 0
    assert "block.mass" in capsys.readouterr().out
    found = json.loads(Path("runs", "identifiability", made.name, "identifiability.json").read_text())
    assert found["examined"] > 0


def test_keys_beside_a_set_that_would_be_ignored_are_refused(made: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["identifiability", str(made), "model.engine.substeps=4"]) == 2
    assert "expected a configuration or recordings, got both: model.engine.substeps=4" in capsys.readouterr().err


@pytest.mark.slow
def test_an_interrupted_fit_of_a_set_goes_on(made: Path) -> None:
    assert main(["fit", str(made), "trainer.max_epochs=2"]) == 0
    assert main(["fit", str(made)]) == 2, "an earlier run is there"
    assert main(["fit", str(made), "--resume"]) == 0


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["fit", "none"], "none/recording.yaml: expected a recording set, found no recording.yaml there"),
        (["fit", "sysid/base.yaml"], "did you mean --config sysid/base.yaml?"),
        (["fit"], "fit needs a configuration: --config FILE (see physid configs) or recordings"),
        (["predict", "{set}"], "holds no run: physid fit {set} makes one, --run-dir RUN names another"),
        (["identifiability", "{set}", "--config", "identifiability/push"], "a configuration or recordings, got both"),
        (["identifiability", "--learn=block.mass"], "identifiability needs a configuration"),
    ],
)
def test_what_is_missing_is_said_with_what_would_do(
    words: list[str], message: str, made: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([word.format(set=made) for word in words]) == 2
    assert message.format(set=made) in capsys.readouterr().err
    assert not list(Path().rglob("*"))


def test_films_are_to_be_tracked_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    filmed = dataclasses.replace(recording(video=True), pose=None, twist=None)
    folder = write_set(tmp_path / "films", [filmed])
    assert main(["fit", str(folder)]) == 2
    assert f"physid track {folder} reads them first" in capsys.readouterr().err
