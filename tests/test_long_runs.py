"""What runs for hours: memory, open files and threads stay what they were."""

from __future__ import annotations

import gc
import os
import threading
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.stats import theilslopes

from physid.cli import main
from physid.training.callbacks.parameter_history import ParameterHistory

CONFIG = "sysid/push_friction"
EPOCHS, WARM = 60, 20
"""Caches fill and the allocator settles in the first epochs."""
GROWTH = 10e3
"""[bytes] for each epoch: 36 MB in an hour of epochs of a second. Losing one (8, 120, 13) trajectory would be 100e3."""


class Held(NamedTuple):
    """What this process holds: resident memory [bytes], its open files and its threads, each with its count."""

    memory: int
    files: Counter[str]
    threads: Counter[int | None]


def held() -> Held:
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    files = Counter[str]()
    for number in os.listdir("/proc/self/fd"):
        with suppress(OSError):  # the one that listed them is closed
            files[os.readlink(f"/proc/self/fd/{number}")] += 1
    threads = Counter(thread.native_id for thread in threading.enumerate())
    return Held(pages * os.sysconf("SC_PAGE_SIZE"), files, threads)


def slope(series: list[Held]) -> tuple[float, int, int]:
    """Return the growth of memory at each step [bytes], and how many files and threads the last holds more.

    Memory goes up and down between two levels, 9 MB apart, as the allocator pleases, and a few such steps look like a
    slope: this is the low end of its 95 % interval (Theil-Sen, deaf to single jumps), what memory grows by at least.
    Files and threads of the first step may end in between, those of an earlier test, and must not hide new ones.
    """
    first, last = series[0], series[-1]
    memory = np.array([each.memory for each in series])
    return (
        float(theilslopes(memory).low_slope),
        (last.files - first.files).total(),
        (last.threads - first.threads).total(),
    )


@pytest.mark.slow
def test_the_slope_sees_a_leak() -> None:
    kept, series = [], []
    for _ in range(60):
        kept.append(np.ones(1_000_000))  # more than what the allocator holds ready, as the leak of an hour
        series.append(held())
    assert slope(series)[0] > 5 * GROWTH


def test_a_file_and_a_thread_left_behind_are_seen_though_others_end(tmp_path: Path) -> None:
    done, later = threading.Event(), threading.Event()
    before, after = threading.Thread(target=done.wait), threading.Thread(target=later.wait)
    with (tmp_path / "earlier").open("w"):
        before.start()
        series = [held()]
    done.set()
    before.join()
    with (tmp_path / "left").open("w"):
        after.start()
        series.append(held())
    later.set()
    after.join()
    assert slope(series)[1:] == (1, 1)
    assert slope(series[::-1])[1:] == (1, 1)
    assert slope(series[:1] * 2)[1:] == (0, 0)


@pytest.mark.slow
def test_epochs_leave_nothing_behind(
    recordings: Callable[[str], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    series: list[Held] = []
    usual = ParameterHistory.on_train_epoch_end

    def measured(self: ParameterHistory, *words: Any) -> None:
        usual(self, *words)
        series.append(held())

    monkeypatch.setattr(ParameterHistory, "on_train_epoch_end", measured)
    words = ["fit", "--config", CONFIG, f"--run-dir={tmp_path / 'run'}", f"data.folder={recordings('push')}"]
    descent = ["model.optimizer.class_path=torch.optim.SGD", "model.optimizer.lr=1e-9", "trainer.callbacks=[]"]
    words += [f"trainer.max_epochs={EPOCHS}", "trainer.enable_progress_bar=false"]  # its timer comes and goes
    assert main([*words, *descent]) == 0
    assert len(series) == EPOCHS
    growth, files, threads = slope(series[WARM:])
    assert growth < GROWTH
    assert (files, threads) == (0, 0)


@pytest.mark.slow
def test_fits_in_one_process_leave_nothing_behind(recordings: Callable[[str], Path], tmp_path: Path) -> None:
    series = []
    for number in range(8):
        words = ["fit", "--config", CONFIG, f"--run-dir={tmp_path / str(number)}", f"data.folder={recordings('push')}"]
        assert main([*words, "trainer.max_epochs=1"]) == 0
        series.append(held())
    growth, files, threads = slope(series[6:])
    assert growth < 100 * GROWTH
    assert (files, threads) == (0, 0)


@pytest.mark.slow
def test_diagnoses_in_one_process_leave_nothing_behind(tmp_path: Path) -> None:
    noise = ["noise.position=0.0005", "noise.rotation=0.002", "steps=60", "trajectories=6", "video=false", "--quiet"]
    assert main(["generate", "--config", "generate/push_rich", f"--out={tmp_path / 'set'}", *noise]) == 0
    series = []
    for number in range(24):  # the slope of five says nothing
        assert main(["diagnose", str(tmp_path / "set"), f"--out={tmp_path / str(number)}", "--quiet"]) == 0
        series.append(held())
    growth, files, threads = slope(series[6:])
    assert growth < 100 * GROWTH
    assert (files, threads) == (0, 0)


@pytest.mark.slow
def test_a_run_that_is_resumed_again_and_again_keeps_one_folder_of_wandb_for_each_call(
    recordings: Callable[[str], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("WANDB_MODE", "offline")
    words = ["fit", "--config", CONFIG, f"--run-dir={tmp_path / 'run'}", f"data.folder={recordings('push')}"]
    descent = ["model.optimizer.class_path=torch.optim.SGD", "model.optimizer.lr=1e-9", "trainer.callbacks=[]"]
    for epochs in (1, 2, 3):
        assert main([*words, *descent, f"trainer.max_epochs={epochs}", *["--resume"] * (epochs > 1)]) == 0
        assert len(list((tmp_path / "run" / "wandb").glob("offline-run-*"))) == epochs
