"""Every shipped configuration runs through the real command line with a tiny budget."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from physid.cli import main
from physid.configuration import compose
from physid.data import RecordingSet

CONFIGS = Path(__file__).parent.parent / "configs"
TINY_FIT = ["trainer.max_epochs=1", "data.limit=2", "trainer.accelerator=cpu"]


def files(folder: str) -> list[str]:
    """Return the configurations of a folder that run by themselves: not `base`, nor those with an underscore."""
    found = sorted((CONFIGS / folder).rglob("*.yaml"))
    return [str(path.relative_to(CONFIGS)) for path in found if path.stem != "base" and not path.stem.startswith("_")]


@pytest.mark.parametrize("file", files("generate"))
def test_a_scene_can_be_generated(file: str, recordings: Callable[[str], Path]) -> None:
    made = RecordingSet(recordings(Path(file).stem))
    assert len(made) == 10
    made.verify()


@pytest.mark.parametrize("file", files("generate"))
def test_a_scene_can_be_filmed(file: str, tmp_path: Path) -> None:
    out = tmp_path / "filmed"
    tiny = ["trajectories=1", "steps=2", "--workers=1", "--quiet", f"--out={out}"]
    assert main(["generate", "--config", str(CONFIGS / file), *tiny]) == 0
    recording = RecordingSet(out).read(0, video=True)
    assert recording.frames is not None
    assert recording.frames.shape[:1] == (2,)


@pytest.mark.slow
@pytest.mark.parametrize("file", files("sysid"))
def test_parameters_can_be_identified(
    file: str, recordings: Callable[[str], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wanted = compose([CONFIGS / file]).values["data"]["init_args"]["folder"]
    monkeypatch.chdir(tmp_path)
    tiny = [*TINY_FIT, f"data.folder={recordings(Path(wanted).name)}"]
    assert main(["fit", "--config", str(CONFIGS / file), *tiny]) == 0
    figures = json.loads((tmp_path / "runs" / Path(file).stem / "metrics.json").read_text())
    assert any(key.startswith("params/") and key.endswith("/estimate") for key in figures)
    assert "test/position_error" in figures


@pytest.mark.slow
def test_an_identification_is_resumed_and_tested_from_its_folder(
    recordings: Callable[[str], Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    config, data = str(CONFIGS / "sysid" / "push_friction.yaml"), f"data.folder={recordings('push')}"
    figures = {}
    for run, sessions in {"whole": [[]], "halves": [["trainer.max_epochs=1"], ["--resume"]]}.items():
        for words in sessions:
            assert main(["fit", "--config", config, data, "trainer.max_epochs=2", *words, "--run-dir", run]) == 0
        figures[run] = json.loads((tmp_path / run / "metrics.json").read_text())
        del figures[run]["seconds"]
    assert figures["halves"] == figures["whole"]
    assert main(["test", "--run-dir", "whole"]) == 0
