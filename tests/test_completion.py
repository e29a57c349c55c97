"""What the shell completes, asked of bash itself."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from physid.cli import main
from physid.commands import COMMANDS

ASK = """\
{script}
COMP_WORDS=({words}) COMP_CWORD={place}
_physid
printf '%s\\n' "${{COMPREPLY[@]}}"
"""


@pytest.fixture
def script(capsys: pytest.CaptureFixture[str]) -> str:
    assert main(["completion"]) == 0
    return capsys.readouterr().out


def complete(script: str, *words: str) -> set[str]:
    """Return what bash offers for the last of the words."""
    bash = shutil.which("bash")
    if bash is None:
        pytest.skip("needs bash")
    quoted = " ".join(f"'{word}'" for word in ("physid", *words))
    code = ASK.format(script=script, words=quoted, place=len(words))
    done = subprocess.run([bash, "-uc", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    return set(done.stdout.split())


def test_the_first_word_is_a_command(script: str) -> None:
    assert complete(script, "") == {command.name for command in COMMANDS} | {"--help", "--version"}
    assert complete(script, "re") == {"reproduce"}


def test_a_dash_brings_the_options_of_the_command_and_no_others(script: str) -> None:
    assert complete(script, "dashboard", "runs", "--") == {"--out", "--light", "--wandb", "--help"}
    assert complete(script, "fit", "--conf") == {"--config"}
    assert complete(script, "effects", "--config") == set()


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["effects", "--site", ""], {"actuation", "dynamics", "contact", "perception"}),
        (["generate", "--backend", "d"], {"dask"}),
        (["import", ""], {"csv", "npz", "mcap", "rosbag", "lerobot", "mp4", "cube-tosses"}),
        (["benchmark", "diagnosis", "s"], {"seal", "score"}),
    ],
)
def test_a_value_that_is_one_of_some_words_is_completed(script: str, words: list[str], expected: set[str]) -> None:
    assert complete(script, *words) == expected


@pytest.mark.parametrize("words", [["fit", "--config", ""], ["dashboard", ""], ["diagnose", "data", "--out", "r"]])
def test_files_are_left_to_the_shell(script: str, words: list[str]) -> None:
    assert complete(script, *words) == set()
    assert "complete -o default -F _physid physid" in script


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["fit", "data/mine", "trainer.max"], {"trainer.max_epochs="}),
        (["fit", "model.lea"], {"model.learn="}),
        (["generate", "--config", "generate/push", "traj"], {"trajectories="}),
        (["generate", "noise."], {"noise.position=", "noise.rotation="}),
        (["diagnose", "data", "lack_of_fit.mar"], {"lack_of_fit.margin="}),
        (["import", "csv", "logs", "quat"], {"quaternion="}),
        (["import", "csv", "logs", "forces.o"], {"forces.offset="}),
        (["dashboard", "trainer."], set()),
        (["fit", "--run-dir", "trainer."], set()),
    ],
)
def test_keys_of_the_configuration_are_completed(script: str, words: list[str], expected: set[str]) -> None:
    assert complete(script, *words) == expected


def test_a_file_goes_before_a_key(script: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert "data.folder=" in complete(script, "fit", "data")
    (tmp_path / "data").mkdir()
    assert complete(script, "fit", "data") == set()


def test_every_option_of_every_command_is_offered(script: str) -> None:
    for command in COMMANDS:
        assert {f"--{name.replace('_', '-')}" for name in command.options} <= complete(script, command.name, "-")


def test_zsh_gets_the_same_words(script: str, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(["completion", "zsh"]) == 0
    printed = capsys.readouterr().out
    assert printed.endswith(script)
    zsh = shutil.which("zsh")
    if zsh is not None:
        (tmp_path / "start").write_text(printed)
        done = subprocess.run([zsh, "-fc", f"source {tmp_path / 'start'}"], capture_output=True, text=True, check=False)
        assert (done.returncode, done.stderr) == (0, "")
