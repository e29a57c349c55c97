"""A fit that is spread over two processes of this machine by Lightning's ddp."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from physid.runs import first_process

CONFIG = Path(__file__).parent.parent / "configs" / "sysid" / "push_friction.yaml"
# A gradient is a mean over the batch, whose halves two processes hold, so only rounding may differ.
RELATIVE = 1e-9
# A plain step along the gradient; sixteen frames of a push move the loss little, hence the rate.
DESCENT = ["model.optimizer.class_path=torch.optim.SGD", "model.optimizer.lr=1e4", "trainer.callbacks=[]"]


def fit(folder: Path, data: Path, *words: str) -> tuple[dict[str, float], str]:
    """Fit eight trajectories in a process of its own; returns metrics.json and what was printed."""
    budget = ["trainer.max_epochs=3", "trainer.accelerator=cpu", "data.limit=8", f"data.folder={data}"]
    command = [sys.executable, "-m", "physid", "fit", "--config", str(CONFIG), f"--run-dir={folder}"]
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "WANDB_MODE": "disabled"}
    done = subprocess.run(
        [*command, *budget, *DESCENT, *words], capture_output=True, text=True, env=environment, check=False
    )
    assert done.returncode == 0, done.stderr
    read: dict[str, float] = json.loads((folder / "metrics.json").read_text())
    return read, done.stdout


@pytest.mark.slow
def test_two_processes_learn_what_one_learns_and_speak_with_one_voice(
    recordings: Callable[[str], Path], tmp_path: Path
) -> None:
    alone, _ = fit(tmp_path / "alone", recordings("push"), "data.batch_size=8")
    spread = ["trainer.strategy=ddp", "trainer.devices=2", "data.batch_size=4"]
    together, printed = fit(tmp_path / "together", recordings("push"), *spread)
    for name in ("params/block.friction/estimate", "test/position_error"):
        assert together[name] == pytest.approx(alone[name], rel=RELATIVE)
    assert alone["params/block.friction/estimate"] != pytest.approx(0.24, rel=1e-3)
    assert printed.count("block.friction") == 1
    assert "earlier" not in json.loads((tmp_path / "together" / "record.json").read_text())


@pytest.mark.slow
def test_an_optimizer_that_would_part_the_processes_is_refused(
    recordings: Callable[[str], Path], tmp_path: Path
) -> None:
    words = ["fit", "--config", str(CONFIG), f"--run-dir={tmp_path / 'run'}", f"data.folder={recordings('push')}"]
    spread = ["trainer.strategy=ddp", "trainer.devices=2", "trainer.accelerator=cpu", "trainer.max_epochs=1"]
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "WANDB_MODE": "disabled"}
    command = [sys.executable, "-m", "physid", *words, *spread]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False, timeout=120)
    assert done.returncode == 2
    assert "GaussNewton needs all trajectories in one process, got 2 processes" in done.stderr


@pytest.mark.parametrize(
    ("environment", "first"),
    [
        ({}, True),
        ({"LOCAL_RANK": "1", "NODE_RANK": "0"}, False),
        ({"LOCAL_RANK": "0", "NODE_RANK": "1"}, False),
        ({"RANK": "0", "LOCAL_RANK": "0"}, True),
        ({"RANK": "2", "LOCAL_RANK": "0"}, False),
        ({"SLURM_PROCID": "3"}, False),
    ],
)
def test_one_process_of_all_counts_as_the_first(
    environment: dict[str, str], first: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("RANK", "SLURM_PROCID", "NODE_RANK", "LOCAL_RANK"):
        monkeypatch.delenv(name, raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    assert first_process() is first
