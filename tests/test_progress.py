"""How far a command is, where there is no terminal: lines of a log, not too many."""

import importlib.util
import io
import sys
from collections.abc import Callable
from pathlib import Path
from typing import ClassVar

import pytest

from physid.cli import main
from physid.commands.terminal.screen import frame_bar, stage_bar
from physid.diagnosis.progress import Stage
from physid.progress import bar as progress_bar
from physid.progress.bar import LogLines
from physid.training.callbacks import progress


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


def test_what_is_redrawn_is_a_line_at_most_every_ten_seconds(clock: Clock) -> None:
    log = io.StringIO()
    lines = LogLines(log)
    for clock.now in range(0, 35, 1):
        lines.write(f"\r {clock.now} of 35   ")
        lines.write("\n")  # as tqdm moves to another bar
        lines.write(progress_bar.UP)
    lines.write("\r   ")
    assert log.getvalue().splitlines() == ["10 of 35", "20 of 35", "30 of 35"]


class Alarm:
    """A timer that goes off when a test wants."""

    set: ClassVar[list["Alarm"]] = []

    def __init__(self, seconds: float, function: Callable[[], None]) -> None:
        self.seconds, self.function, self.daemon = seconds, function, False

    def start(self) -> None:
        assert self.daemon, "a log keeps no command from ending"
        self.set.append(self)

    def cancel(self) -> None:
        self.set.remove(self)

    @classmethod
    def go_off(cls, clock: Clock) -> None:
        """Let the time pass until the one alarm that is set goes off."""
        (alarm,) = cls.set
        cls.set.remove(alarm)
        clock.now += alarm.seconds
        alarm.function()


@pytest.fixture
def alarm(monkeypatch: pytest.MonkeyPatch) -> type[Alarm]:
    monkeypatch.setattr(progress_bar, "Timer", Alarm)
    Alarm.set.clear()
    return Alarm


def test_the_newest_of_what_came_too_soon_is_written_in_its_time_unless_it_was_taken_away(
    clock: Clock, alarm: type[Alarm]
) -> None:
    log = io.StringIO()
    lines = LogLines(log)
    clock.now = 4.0
    for text in ("reading", "   ", "fitting", "testing"):
        lines.write(f"\r{text}")
    alarm.go_off(clock)
    assert clock.now == 10.0
    assert log.getvalue() == "testing\n"
    lines.write("\rwriting")
    lines.write("\r       ")
    assert not alarm.set
    assert log.getvalue() == "testing\n"


class Unwritable(io.StringIO):
    """The log of a full disk, of a reader that has gone, or closed."""

    def __init__(self, error: Exception) -> None:
        super().__init__()
        self.error = error

    def write(self, _: str) -> int:
        raise self.error


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), BrokenPipeError(), ValueError("closed")])
def test_a_log_that_cannot_be_written_disturbs_nothing(error: Exception, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress_bar, "EVERY", 0.0)
    assert LogLines(Unwritable(error)).write("\rpushing") == 8
    monkeypatch.setattr(sys, "stderr", Unwritable(error))
    assert list(progress_bar.progress_bar(range(4), quiet=False, mininterval=0)) == [0, 1, 2, 3]


@pytest.mark.parametrize("quiet", [True, False])
@pytest.mark.parametrize("closed", [True, False])
def test_without_standard_error_nothing_is_shown(quiet: bool, closed: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    stream = io.StringIO() if closed else None
    if stream is not None:
        stream.close()
    monkeypatch.setattr(sys, "stderr", stream)
    assert list(progress_bar.progress_bar(range(4), quiet=quiet)) == [0, 1, 2, 3]
    with stage_bar(quiet) as stage, frame_bar(quiet) as frame:
        stage(Stage.READING)
        frame("reading the films", 1, 80)


def test_a_bar_writes_whole_lines_into_a_log_and_nothing_where_it_is_quiet(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(progress_bar, "EVERY", 0.0)
    for quiet in (True, False):
        for _ in progress_bar.progress_bar(range(4), quiet=quiet, desc="pushing", mininterval=0):
            assert not quiet or not capsys.readouterr().err
    lines = capsys.readouterr().err.splitlines()
    assert lines[0].startswith("pushing: 0%")
    assert any("3/4" in line for line in lines)
    assert all(line.startswith("pushing:") for line in lines)


@pytest.mark.parametrize(("seconds", "lines"), [(2.4, 0), (2.6, 1)])
def test_what_is_over_within_ten_seconds_leaves_a_log_empty(
    seconds: float, lines: int, clock: Clock, capsys: pytest.CaptureFixture[str]
) -> None:
    for task in progress_bar.progress_bar(range(5), quiet=False, mininterval=0):
        clock.now = task * seconds
    assert len(capsys.readouterr().err.splitlines()) == lines


def test_each_stage_of_a_diagnosis_that_lasts_is_in_a_log_whole(
    clock: Clock, alarm: type[Alarm], capsys: pytest.CaptureFixture[str]
) -> None:
    with stage_bar(quiet=False) as say:
        for stage in (Stage.READING, Stage.TESTING):  # the second begins at once, and lasts
            say(stage)
        alarm.go_off(clock)
        say(Stage.FITTING, "a drag that is named at length, beside another one")
        alarm.go_off(clock)
        say(Stage.WRITING)
    testing, fitting = capsys.readouterr().err.splitlines()
    assert testing == "testing all effects at once, against null simulations, 50 %"
    assert fitting == "fitting a drag that is named at length, beside another one, 62 %"
    assert not alarm.set


def test_the_bar_of_films_names_what_is_done_to_them_in_a_log(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(progress_bar, "EVERY", 0.0)
    with frame_bar(quiet=False) as say:
        say("looking at the films", 0, 0)
        say("writing the films", 1, 80)
    lines = capsys.readouterr().err.splitlines()
    assert any(line.startswith("looking at the films: 0frame") for line in lines)
    assert lines[-1].startswith("writing the films: 1%")


@pytest.fixture
def fit(
    recordings: Callable[[str], Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> Callable[..., list[str]]:
    """Fit two pushes, an hour of each epoch, and return the lines of epochs in the log."""
    monkeypatch.setattr(progress_bar, "EVERY", 0.0)
    hours = iter(range(0, 3600_000, 3600))
    monkeypatch.setattr(progress, "clock", lambda: next(hours))
    words = ["fit", str(recordings("push")), "data.limit=2", "wandb=disabled", "--run-dir", str(tmp_path / "run")]

    def run(*changes: str) -> list[str]:
        assert main([*words, *changes]) == 0
        return [line for line in capsys.readouterr().err.splitlines() if line.startswith("epoch")]

    return run


@pytest.mark.parametrize(("most", "first"), [(4, "epoch 1/4"), (-1, "epoch 1, ")])
def test_a_fit_writes_epochs_losses_and_the_time_left_into_a_log(
    most: int, first: str, fit: Callable[..., list[str]]
) -> None:
    lines = fit(f"trainer.max_epochs={most}", "trainer.max_steps=4")
    assert lines[0].startswith(first)
    assert "loss" in lines[0]
    assert "left" not in lines[0]
    assert ("left ≤" in lines[2]) is (most > 0)


@pytest.mark.slow
@pytest.mark.parametrize("asked", ["false", "true"])  # the second has Lightning's own
def test_a_fit_that_says_whether_it_has_a_bar_writes_no_lines_into_a_log(
    asked: str, fit: Callable[..., list[str]]
) -> None:
    assert not fit("trainer.max_epochs=2", f"trainer.enable_progress_bar={asked}")


def test_lines_of_progress_are_no_complaint_of_the_script_of_faults_and_messages_are(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = Path(__file__).parents[1] / "benchmarks" / "faults.py"
    spec = importlib.util.spec_from_file_location("faults", path)
    assert spec is not None
    assert spec.loader is not None
    faults = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "faults", faults)
    spec.loader.exec_module(faults)
    monkeypatch.setattr(progress_bar, "EVERY", 0.0)
    with stage_bar(quiet=False) as stage:
        for each in Stage:
            stage(each, "drag + a:b (1 of 20)")
    with frame_bar(quiet=False) as frame:
        frame("looking at the films", 0, 0)
        for k in range(3):
            frame("reading a:b.mp4", k, 3)
    list(progress_bar.progress_bar(range(3), quiet=False, mininterval=0))
    shown = capsys.readouterr().err + "epoch 3/7, left ≤0:01:00, train/loss 2\nepoch 3, train/loss 2\n"
    assert len(shown.splitlines()) > 20
    assert faults.complaints(shown + "physid: interrupted\n", 130, {130}) == []
    for message in ("physid: 97% of the frames are lost", "Segmentation fault (core dumped)", "wrong 5% 00:00"):
        (found,) = faults.complaints(f"{message}\n{shown}physid: interrupted\n", 130, {130})
        assert message in found
