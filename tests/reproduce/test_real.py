"""Real tosses: compared where they are there, left out with a word where they are not."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.conftest import write_tosses

from physid.cli import main
from physid.reproduce.real import VARIABLE
from physid.reproduce.results import read_results

CONFIGS = Path(__file__).parents[2] / "configs"


@pytest.mark.slow
def test_tosses_are_compared_with_published_figures_and_baselines(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(VARIABLE, str(write_tosses(tmp_path / "tosses")))
    monkeypatch.chdir(tmp_path)
    words = ["reproduce", "--cell=real/cube_tosses", f"--configs={CONFIGS}", "--out=out", "--workers=1"]
    assert main(words) == 0
    found = {result.metric: result for result in read_results(Path("out/results.json"))}
    assert found["cube.friction"].value == pytest.approx(0.18, abs=0.02)
    assert found["position error, held out"].paper == 13.5
    assert found["rotation error, held out"].paper == 16.5
    ours, held = (found[f"position error, held out{words}"].value for words in ("", ", initial pose held"))
    assert ours is not None
    assert held is not None
    assert ours < held


def test_without_tosses_the_cell_is_left_out_and_says_where_to_get_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(VARIABLE, str(tmp_path / "absent"))
    words = ["reproduce", f"--configs={CONFIGS}", f"--out={tmp_path / 'out'}", "--workers=1"]
    assert main([*words, "--cell=real/cube_tosses,identifiability/slide"]) == 0
    printed = capsys.readouterr().out
    assert "real/cube_tosses is left out: no tosses in" in printed
    assert VARIABLE in printed
    assert {result.cell for result in read_results(tmp_path / "out" / "results.json")} == {"identifiability/slide"}
    assert main([*words, "--cell=real/cube_tosses"]) == 2
    assert "nothing is left to run" in capsys.readouterr().err
