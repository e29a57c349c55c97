"""Learning from video end to end, on a recording set that is far too small to learn anything."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from physid.cli import main

CONFIGS = Path(__file__).parent.parent.parent / "configs"
TINY = [
    "data.batch_size=4",
    "data.every=5",
    "data.draw=1",
    "model.imagination.frames=1",
    "model.phases.warm_up=1",
    "model.phases.refine=1",
    "model.polish.steps=2",
    "model.polish.headings=1",
    "trainer.max_epochs=3",
    "trainer.accelerator=cpu",
    "wandb=disabled",
]


@pytest.fixture(scope="module")
def films(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("films") / "push"
    config = str(CONFIGS / "generate" / "push.yaml")
    tiny = ["trajectories=10", "steps=21", "--workers=1", "--quiet", f"--out={out}"]
    assert main(["generate", "--config", config, *tiny]) == 0
    return out


@pytest.mark.parametrize("method", ["supervised", "self_supervised"])
def test_all_phases_run_within_one_fit_and_leave_films(method: str, films: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    config = str(CONFIGS / method / "push_friction.yaml")
    assert main(["fit", "--config", config, f"--run-dir={run}", f"data.folder={films}", *TINY]) == 0
    figures = json.loads((run / "metrics.json").read_text())
    assert figures["params/block.friction/low"] < figures["params/block.friction/high"]
    assert {"test/position_error", "test/encoded_position_error", "test/psnr", "test/ssim"} <= figures.keys()
    assert list(run.glob("frames_*.png"))
    assert list(run.glob("prediction_*.mp4"))


def test_recordings_without_video_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, config = tmp_path / "blind", str(CONFIGS / "generate" / "push.yaml")
    blind = ["trajectories=10", "steps=5", "video=false", "--workers=1", "--quiet", f"--out={out}"]
    assert main(["generate", "--config", config, *blind]) == 0
    fit = ["fit", "--config", str(CONFIGS / "supervised" / "push_friction.yaml"), f"--run-dir={tmp_path / 'run'}"]
    assert main([*fit, f"data.folder={out}", *TINY]) == 2
    assert "video=true" in capsys.readouterr().err
