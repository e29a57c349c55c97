"""What all tests share: quiet libraries, and one tiny recording set per scene."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

# Before anything imports torch or wandb.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ["WANDB_MODE"] = "disabled"

# A shell that runs the tests in the background makes them, and what they start, deaf to Ctrl-C, which some tests press.
signal.signal(signal.SIGINT, signal.default_int_handler)

ROOT = Path(__file__).parent.parent


def write_tosses(folder: Path) -> Path:
    """Write files like those of the real cube tosses: cubes that slide to rest with a friction of 0.18, at 148 Hz."""
    import torch

    folder.mkdir()
    time = torch.arange(40, dtype=torch.float64) / 148
    for index in range(10):
        speed = (0.2 + 0.02 * index - 0.18 * 9.81 * time).clamp_min(0)
        rows = torch.zeros(40, 13, dtype=torch.float64)
        rows[:, 0] = 1
        rows[:, 4] = speed.cumsum(0) / 148
        rows[:, 6] = 0.0524
        rows[:, 10] = speed
        torch.save(rows, folder / f"{index}.pt")
    return folder


@pytest.fixture(scope="session")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Return a tiny recording set, made through the command line at first use: recordings("push")."""
    from physid.cli import main

    folder = tmp_path_factory.mktemp("recordings")

    def make(name: str) -> Path:
        made = folder / name
        if name == "cube" and not made.exists():
            assert main(["import", "cube-tosses", str(write_tosses(folder / "tosses")), f"--out={made}"]) == 0
        if not made.exists():
            tiny = ["trajectories=10", "steps=16", "video=false", "--workers=1", "--quiet", f"--out={made}"]
            assert main(["generate", "--config", str(ROOT / "configs" / "generate" / f"{name}.yaml"), *tiny]) == 0
        return made

    return make
