from __future__ import annotations

import io
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from tqdm import tqdm

from physid.cli import main, sort_words
from physid.commands import COMMANDS, Command
from physid.commands.terminal.parser_errors import shorten
from physid.commands.terminal.screen import frame_bar, interruptible, styled
from physid.configuration import compose

HELP_SECONDS = 0.5
HEAVY = (
    "torch",
    "lightning",
    "pybullet",
    "h5py",
    "llvmlite",
    "matplotlib",
    "wandb",
    "jsonargparse",
    "omegaconf",
)
PUSH = str(Path(__file__).parent.parent / "configs" / "generate" / "push.yaml")
COMMAND = [sys.executable, "-m", "physid"]


def test_help_answers_at_once_and_loads_nothing_heavy() -> None:
    code = (
        "import sys; from physid.cli import main; main(['--help']); "
        f"sys.exit(', '.join(name for name in {HEAVY} if name in sys.modules) or 0)"
    )
    seconds = []
    for _ in range(3):
        start = time.perf_counter()
        answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
        seconds.append(time.perf_counter() - start)
        assert answer.returncode == 0, f"--help loads {answer.stderr}"
    assert min(seconds) < HELP_SECONDS


def test_the_overview_lists_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 0
    printed = capsys.readouterr().out
    assert all(f"  {command.name} " in printed and command.summary in printed for command in COMMANDS)


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command.name)
def test_the_help_of_a_command_teaches_it(command: Command, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([command.name, "--help"]) == 0
    printed = capsys.readouterr().out
    assert f"\n  physid {command.name} " in printed, "an example is missing"
    assert all(f"--{option.replace('_', '-')}" in printed for option in command.options)
    assert not any("{true,false}" in line or "Args:" in line for line in printed.splitlines())


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["genrate"], 'unknown command "genrate"; did you mean "generate"?'),
        (["generate"], "generate needs a configuration: --config FILE"),
        (["generate", "--config"], "--config: no such option, or its value is missing"),
        (["generate", "--config", PUSH.replace("push", "psuh")], "psuh.yaml does not exist; did you mean"),
        (["generate", "--config", PUSH, "stpes=3"], 'unknown key "stpes"; did you mean "steps"?'),
        (["generate", "--config", PUSH, "steps=many"], "steps: expected a whole number, found 'many'"),
        (["generate", "--config", PUSH, "scene=pusk"], 'unknown scene "pusk"; did you mean "push"?'),
        (["benchmark", "diagnosis", "--so-far"], "--so-far belongs to score and to calibrate --spent, got it with all"),
        (["generate", "--config", PUSH, "--worker", "2"], 'no option --worker; did you mean "--workers"?'),
        (["generate", "--config", PUSH, "--workers=two"], "generate: workers: expected int, got two"),
        (["generate", "--config", PUSH, "stray"], "unrecognized arguments: stray; physid generate --help shows what"),
        (["generate", PUSH], f"unrecognized arguments: {PUSH}; did you mean --config {PUSH}?"),
        (
            ["predict"],
            "predict needs a configuration: --config FILE (see physid configs) or recordings or --run-dir RUN",
        ),
        (
            ["predict", "--run-dir", "no"],
            "no holds no run; predict needs a configuration: --config FILE (see physid configs) or recordings",
        ),
        (["diagnose", "no"], "found no recording.yaml there; make one with physid import or physid generate, or write"),
        (["calibrate", "board.mp4", "--out", "camera.mp4"], "--out must end in .yaml, .yml, got camera.mp4"),
        (["dashboard", ".", "--out", "runs.pdf"], "--out must end in .html, .htm, got runs.pdf"),
        (["dashboard"], "runs: expected a folder with runs"),
        (["import", "cube-toss", "x"], 'import: unknown kind "cube-toss"; did you mean "cube-tosses"?'),
        (["import", "mp4", "a.mp4", "--guess"], "--guess belongs to logs, got it with mp4"),
        (["import", "cube-tosses", "x", "y"], "cube-tosses: expected one folder and no mapping"),
        (["import", "cube-tosses", "x", "--guess"], "--guess belongs to logs, got it with cube-tosses"),
        (["import", "cube-tosses"], "import: expected files or a folder after cube-tosses, found none"),
        (["effects", "--site=contacts"], "effects: site: expected one of"),
        (["effects", "site=contact"], 'effects has no option "site", and takes no key=value; did you mean "--site"?'),
        (["check", "data/mine", "friction=0.3"], 'check has no option "friction", and takes no key=value; known are'),
    ],
)
def test_a_mistake_is_one_line_and_exit_code_2(
    words: list[str], message: str, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(words) == 2
    error = capsys.readouterr().err.strip()
    assert message in error
    assert len(error.splitlines()) == 1
    assert not list(tmp_path.rglob("*"))


def test_a_traceback_is_there_for_who_asks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PHYSID_TRACEBACK", "1")
    with pytest.raises(ValueError, match="unknown command"):
        main(["genrate"])


def test_words_are_files_overrides_or_options_in_any_order_and_spelling() -> None:
    words = ["a.b=1", "--run-dir", "x", "--config=f", "--c.d", "-3", "--resume", "--e=2", "place", "--config", "g"]
    sorted_words = sort_words(words, {"run_dir": True, "resume": False})
    assert sorted_words.files == ("f", "g")
    assert sorted_words.overrides == ("a.b=1", "c.d=-3", "e=2")
    assert sorted_words.own == ("--run_dir=x", "--resume=true", "place")


def test_the_resolved_configuration_can_be_looked_at(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(["generate", "--config", PUSH, "--print-config", "steps=7"]) == 0
    printed = tmp_path / "printed.yaml"
    printed.write_text(capsys.readouterr().out)
    assert compose([printed]).values == compose([PUSH], ["steps=7"]).values


def test_a_long_message_of_the_parser_becomes_one_line() -> None:
    message = (
        'Parser key "model":\n  Does not validate against any of the Union subtypes\n  Errors:\n'
        "    - Problem with given class_path 'a.B':\n        Parser key \"rate\":\n"
        "          Expected a <class 'float'>. Got value: abc\n    - Expected a <class 'NoneType'>\n"
        "  Given value type: <class 'dict'>\n  Given value: {}"
    )
    assert shorten(message) == "model.rate: expected float, got abc"
    importing = message.replace(
        message[message.index("        Parser") : message.index("    - Expected")], " " * 8 + "why\n"
    )
    assert shorten(importing) == "model: a.B: why"
    failed = "Does not validate\nErrors:\n  - mass must be positive\n    got -1\n  - Expected a <class 'NoneType'>"
    assert shorten(failed) == "mass must be positive\ngot -1"


def test_generate_makes_a_recording_set_that_can_be_read(recordings: Callable[[str], Path]) -> None:
    from physid.data import RecordingSet

    made = RecordingSet(recordings("push"))
    assert (len(made), made.scene.name) == (10, "push")


class Screen(io.StringIO):
    """What is written to a terminal."""

    def isatty(self) -> bool:
        return True


def test_colours_are_for_terminals_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("TERM", "xterm")
    assert styled("physid:", "red", Screen()) == "\x1b[31mphysid:\x1b[0m"
    assert styled("physid:", "red", io.StringIO()) == "physid:"
    monkeypatch.setattr("sys.stderr", screen := Screen())
    assert main(["genrate"]) == 2
    assert screen.getvalue().startswith("\x1b[31mphysid:\x1b[0m unknown command")
    monkeypatch.setenv("NO_COLOR", "1")
    assert styled("physid:", "red", Screen()) == "physid:"


@pytest.mark.slow
def test_a_reader_that_has_seen_enough_is_no_error() -> None:
    piped = subprocess.run(
        f"{' '.join(COMMAND)} effects | head -n 1", shell=True, capture_output=True, text=True, check=False
    )
    assert piped.stdout.count("\n") == 1
    assert not piped.stderr


def test_what_an_ascii_terminal_cannot_write_is_escaped() -> None:
    code = "from physid.commands.terminal.screen import write_any_sign; write_any_sign(); print('2 \\N{MICRO SIGN}m')"
    setting = {**os.environ, "PYTHONIOENCODING": "ascii"}
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=setting, check=True)
    assert answer.stdout == "2 \\xb5m\n"


def test_an_interrupt_in_a_destructor_is_not_lost() -> None:
    class Interrupted:
        def __del__(self) -> None:
            signal.raise_signal(signal.SIGINT)

    def interrupted() -> None:
        Interrupted()
        for _ in range(500):
            time.sleep(0.01)
        pytest.fail("nothing was interrupted")

    with pytest.raises(KeyboardInterrupt), interruptible():
        interrupted()


@pytest.mark.slow
def test_an_interrupted_generation_exits_with_130_and_goes_on(tmp_path: Path) -> None:
    words = ["generate", "--config", PUSH, "--out", str(tmp_path / "set"), "--workers=1", "--quiet", "video=false"]
    running = subprocess.Popen(
        [*COMMAND, *words, "trajectories=100000", "steps=20"], stderr=subprocess.PIPE, text=True, env=dict(os.environ)
    )
    try:
        while not list(tmp_path.glob("set/trajectories/*.h5")):
            assert running.poll() is None
            time.sleep(0.05)
        running.send_signal(signal.SIGINT)
        _, error = running.communicate(timeout=30)
    finally:
        running.kill()
    assert running.returncode == 130
    assert error.strip() == "interrupted: the same command goes on where it stopped"
    count = len(list(tmp_path.glob("set/trajectories/*.h5")))
    assert main([*words, f"trajectories={count + 1}", "steps=20"]) == 0


@pytest.mark.slow
def test_ctrl_c_while_a_command_that_has_done_its_work_ends_says_nothing() -> None:
    tidy = "def tidy():\n    print('ending', flush=True)\n    time.sleep(0.5)\n"
    ending = f"import atexit, time\n{tidy}atexit.register(tidy)\nfrom physid.cli import program\nprogram()"
    running = subprocess.Popen(
        [sys.executable, "-c", ending, "effects"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    with running:
        assert running.stdout is not None
        assert "ending\n" in iter(running.stdout.readline, "")
        running.send_signal(signal.SIGINT)
        _, error = running.communicate(timeout=30)
    assert running.returncode == 0
    assert not error


def test_a_bar_that_is_not_shown_takes_what_it_is_told(capfd: pytest.CaptureFixture[str]) -> None:
    with frame_bar(quiet=True) as say:
        say("reading the films", 0, 80)
        say("reading drawn films", 60, 80)
    assert capfd.readouterr().err == ""


def test_the_bar_of_films_is_one_for_both_readings_and_counts_no_time_for_what_was_there(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    bars = []

    class Seen(tqdm):  # type: ignore[type-arg]
        def __init__(self, *words: object, **options: object) -> None:
            super().__init__(*words, **{**options, "disable": False, "file": io.StringIO()})
            bars.append(self)

    monkeypatch.setattr("tqdm.tqdm", Seen)
    with frame_bar(False) as say:
        for task, done, counted in (
            ("films", 30, 0),
            ("films", 40, 10),
            ("drawn films", 60, 10),
            ("drawn films", 80, 30),
        ):
            say(task, done, 80)
            assert (bars[0].n, bars[0].n - bars[0].initial, bars[0].total) == (done, counted, 80)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["generate", "toss"], "did you mean --config generate/toss? physid configs generate lists all there are"),
        (["generate", "pusch"], "did you mean --config generate/push?"),
        (["fit", "sysid/push_friction"], "did you mean --config sysid/push_friction?"),
        (["generate", "xyz"], "physid generate --help shows what it takes"),
    ],
)
def test_a_configuration_that_is_named_without_its_option_is_recognised(
    words: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("command", "said"),
    [
        ("calibrate", ["[9x6]", "[0.025]"]),
        ("generate", ["[loky]", "  trajectories=1000", "  noise.position=0.0"]),
        ("fit", ["  trainer.max_epochs=30", "  model.learn=null"]),
    ],
)
def test_help_says_defaults_of_options_and_keys(
    command: str, said: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([command, "--help"]) == 0
    text = capsys.readouterr().out
    assert [one for one in said if one not in text] == []


@pytest.mark.parametrize("command", ["check", "fit", "show"])
def test_a_folder_that_reads_like_key_and_value_is_not_passed_over(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "day=3").mkdir()
    monkeypatch.chdir(tmp_path)
    assert main([command, "day=3"]) == 2
    assert "write ./day=3 for it" in capsys.readouterr().err
    assert main([command, "./day=3"]) == 2
    assert "day=3/recording.yaml: expected a recording set" in capsys.readouterr().err


def test_a_key_can_be_set_where_a_folder_reads_like_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "seed=1").mkdir()
    monkeypatch.chdir(tmp_path)
    words = ["generate", "--config", "generate/push", "--print-config"]
    assert main([*words, "seed=1"]) == 2
    assert "--seed=1 for the key" in capsys.readouterr().err
    assert main([*words, "--seed=1"]) == 0
    assert "seed: 1" in capsys.readouterr().out
