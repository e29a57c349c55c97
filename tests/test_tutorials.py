"""The tutorials run as they stand, and end where they say."""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from physid.cli import main

ROOT = Path(__file__).parent.parent
TRUE = {"block.mass": 0.73, "block.friction": 0.21}
DRAG = 0.8
WRONG = "## Where the model is wrong"
MOST = 10


def shell(page: str, *, after: str = "", before: str = "") -> list[list[str]]:
    """Return the commands of a page, after or before a heading, but for those that its text alone names."""
    text = (ROOT / "docs" / page).read_text()
    text = text[text.index(after) : text.index(before) if before else None]
    lines = re.findall(r"^ {4}((?:physid|python) .*)$", text, re.MULTILINE)
    return [shlex.split(line) for line in lines]


def run(commands: list[list[str]]) -> None:
    """Run the commands of a tutorial, which are few."""
    assert len(commands) <= MOST
    for program, *words in commands:
        if program == "python":
            subprocess.run([sys.executable, str(ROOT / words[0]), *words[1:]], check=True, capture_output=True)
        else:
            assert main(words) == 0, words


@pytest.mark.slow
def test_the_tutorial_leads_from_logs_to_a_diagnosed_model(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    run(shell("tutorial_csv.md", before=WRONG))
    printed = capsys.readouterr().out
    assert "Nothing looks wrong." in printed
    assert "the fit leaves nothing beyond the noise of the poses" in printed
    figures = json.loads(Path("runs", "bench", "metrics.json").read_text())
    for name, true in TRUE.items():
        assert figures[f"params/{name}/low"] < true < figures[f"params/{name}/high"]
    assert json.loads(Path("runs", "diagnosis", "bench", "diagnosis.json").read_text())["verdict"] == "none"
    assert Path("runs", "dashboard.html").is_file()


@pytest.mark.slow
def test_the_tutorial_leads_from_logs_of_thick_air_to_its_drag(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    run(shell("tutorial_csv.md", after=WRONG))
    found = json.loads(Path("runs", "diagnosis", "thick", "diagnosis.json").read_text())
    assert "viscous_drag" in found["group"]
    size = next(one for one in found["effects"] if one["name"] == "viscous_drag")["parameters"]["coefficient"]
    values = {name: (found["parameters"][name]["with_effect"], true) for name, true in TRUE.items()}
    for known, true in (*values.values(), (size, DRAG)):
        # A 90 % interval misses now and then; three times as wide it does not. They are a few parts in 10,000 wide.
        assert abs(known["value"] - true) < 3 * (known["high"] - known["low"]) / 2
        assert known["value"] == pytest.approx(true, rel=2e-3)


@pytest.mark.slow
def test_the_tutorial_leads_from_films_to_a_friction(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("cv2", reason="needs physid[camera]")
    monkeypatch.chdir(tmp_path)
    run(shell("tutorial_mp4.md"))
    printed = capsys.readouterr().out
    assert "Nothing looks wrong." in printed
    assert "the fit leaves nothing beyond the noise of the poses" in printed
    figures = json.loads(Path("runs", "read", "metrics.json").read_text())
    assert figures["params/block.friction/low"] < TRUE["block.friction"] < figures["params/block.friction/high"]
    assert figures["params/block.friction/estimate"] == pytest.approx(TRUE["block.friction"], rel=0.01)
    assert Path("runs", "dashboard.html").is_file()
