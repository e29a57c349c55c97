"""Figures are named after parameters, and a parameter after a body, whose name may hold anything that is seen."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from dashboard.folders import CONFIG
from physid.cli import main
from physid.commands.terminal.summary import summarize
from physid.dashboard.run import read_run
from physid.estimation.prediction.coordinates import correlated_names, logged_name, logged_names
from physid.training.callbacks.parameter_history import _intervals, draw

NAMES = ("block.friction", "a/b.friction", "params/x/low.friction", "low.mass", r"$\frac{.friction")


@pytest.mark.parametrize("name", NAMES)
def test_a_figure_gives_back_its_parameter_and_its_word(name: str) -> None:
    assert logged_name(f"params/{name}/relative_error") == (name, "relative_error")
    assert logged_names([f"params/{name}/low", f"params/{name}/high", "val/low", "params/low"], "low") == [name]
    assert _intervals({f"params/{name}/low": 1.0, f"params/{name}/high": 2.0}) == {name: (1.0, 2.0)}


def test_other_figures_name_no_parameter() -> None:
    assert [logged_name(key) for key in ("seconds", "params/low", "val/params/a/low", "params//low")] == [None] * 4


@pytest.mark.parametrize("one", NAMES)
@pytest.mark.parametrize("other", NAMES)
def test_a_correlation_gives_back_both_parameters(one: str, other: str) -> None:
    assert correlated_names(f"correlation/{one}/{other}") == (one, other)


@pytest.mark.parametrize("name", NAMES)
def test_summary_dashboard_and_figure_name_the_parameter(tmp_path: Path, name: str) -> None:
    figures = {f"params/{name}/{word}": value for word, value in {"estimate": 0.2, "low": 0.1, "high": 0.3}.items()}
    assert f"  {name}  0.2 " in summarize(figures, tmp_path)
    (tmp_path / "metrics.json").write_text(json.dumps(figures))
    (tmp_path / "config.yaml").write_text(CONFIG.format(name="a", segment=1))
    (found,) = read_run(tmp_path, tmp_path)["parameters"]
    assert (found["name"], found["low"], found["high"]) == (name, 0.1, 0.3)
    draw([{"epoch": 0, "evaluations": 0, name: 0.2}], {}, tmp_path / "a.png", {name: (0.1, 0.3)})
    assert (tmp_path / "a.png").is_file()


@pytest.mark.slow
def test_a_fit_of_such_a_body_comes_to_its_end(recordings: Callable[[str], Path], tmp_path: Path) -> None:
    data, out = shutil.copytree(recordings("push"), tmp_path / "push"), tmp_path / "run"
    (data / "SHA256SUMS").unlink()
    scene = yaml.safe_load((data / "recording.yaml").read_text())
    name = scene["bodies"][0]["name"] = r"params/x$\frac{/low"
    scene["unknown"] = [f"{name}.friction"]
    (data / "recording.yaml").write_text(yaml.safe_dump(scene))
    config = Path(__file__).parents[2] / "configs" / "sysid" / "push_friction.yaml"
    learn = f"model.learn=[{json.dumps(scene['unknown'][0])}]"
    assert main(["fit", "--config", str(config), f"data.folder={data}", learn, f"--run-dir={out}"]) == 0
    assert main(["predict", f"--run-dir={out}", f"--out={tmp_path / 'predicted'}"]) == 0
    written = json.loads((tmp_path / "predicted" / "parameters.json").read_text())[f"{name}.friction"]
    assert written["low"] < written["estimate"] < written["high"]
