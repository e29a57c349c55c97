"""How far a command is, where there is no terminal: lines of a log, not too many."""

import io
from collections.abc import Callable
from pathlib import Path

import pytest

from physid.cli import main
from physid.progress import bar as progress_bar
from physid.progress.bar import LogLines


class Clock:
    """Seconds that pass as a test wants."""

    def __init__(self) -> None:
        self.now = 0.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(progress_bar, "time", clock)
    return clock


def test_what_is_drawn_over_itself_is_a_line_at_most_every_ten_seconds(clock: Clock) -> None:
    log = io.StringIO()
    lines = LogLines(log)
    for clock.now in range(0, 35, 1):
        lines.write(f"\r {clock.now} of 35   ")
        lines.write("\r")
    assert log.getvalue().splitlines() == ["10 of 35", "20 of 35", "30 of 35"]


def test_a_bar_writes_whole_lines_into_a_log_and_nothing_where_it_is_quiet(
    clock: Clock, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(progress_bar, "EVERY", 0.0)
    for quiet in (True, False):
        for _ in progress_bar.progress_bar(range(4), quiet=quiet, desc="pushing", mininterval=0):
            assert not quiet or not capsys.readouterr().err
    lines = capsys.readouterr().err.splitlines()
    assert lines[0].startswith("pushing: 0%")
    assert any("3/4" in line for line in lines)
    assert all(line.startswith("pushing:") for line in lines)


def test_what_is_soon_over_leaves_a_log_empty(capsys: pytest.CaptureFixture[str]) -> None:
    assert list(progress_bar.progress_bar(range(40), quiet=False, mininterval=0)) == list(range(40))
    assert not capsys.readouterr().err


def test_a_fit_writes_epochs_losses_and_the_time_left_into_a_log(
    recordings: Callable[[str], Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(progress_bar, "EVERY", 0.0)
    fit = ["fit", str(recordings("push")), "data.limit=2", "trainer.max_epochs=4", "wandb=disabled"]
    assert main([*fit, "--run-dir", str(tmp_path / "heard")]) == 0
    lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith("epoch")]
    assert lines[0].startswith("epoch 1/4")
    assert "loss" in lines[0]
    assert "left" not in lines[0]
    assert "left ≤0:00:" in lines[2]
    assert main([*fit, "--run-dir", str(tmp_path / "silent"), "trainer.enable_progress_bar=false"]) == 0
    assert "epoch" not in capsys.readouterr().err
