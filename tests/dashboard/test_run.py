from __future__ import annotations

import base64
import hashlib
import json
import os
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from dashboard.folders import write_fit, write_runs
from physid.cli import main
from physid.dashboard.curves import MOST_POINTS, numbers_of, read_curves, thin
from physid.dashboard.folders import find_runs
from physid.dashboard.page import render, write_dashboard
from physid.dashboard.run import flatten, read_run

HALF_A_LINE = "3,3,0."


@pytest.fixture
def root(tmp_path: Path) -> Path:
    return write_runs(tmp_path / "runs")


def test_every_kind_of_run_is_found_and_named_by_its_folder(root: Path) -> None:
    kinds = {run["id"]: run["kind"] for run in (read_run(folder, root) for folder in find_runs(root))}
    expected = {
        "damaged": "fit",
        "diagnosis": "diagnosis",
        "diagnosis_free": "diagnosis",
        "identifiability": "identifiability",
        "push_bad": "fit",
        "push_good": "fit",
        "reproduce": "benchmark",
        "reproduce_again": "benchmark",
        "score": "benchmark",
    }
    assert kinds == expected


def test_a_parameter_has_its_truth_its_error_and_its_history(root: Path) -> None:
    (parameter,) = read_run(root / "push_good", root)["parameters"]
    assert (parameter["name"], parameter["true"], parameter["estimate"]) == ("block.friction", 0.12, 0.1201)
    assert parameter["error"] == pytest.approx(0.1201 / 0.12 - 1)
    assert parameter["y"][0] == 0.24
    assert len(parameter["x"]) == 8


def test_the_first_guess_is_shown_where_the_run_has_left_it(root: Path) -> None:
    (root / "push_good" / "parameters.csv").write_text("epoch,evaluations,block.friction\n0,0.0,0.5\n1,3.0,0.2\n")
    (parameter,) = read_run(root / "push_good", root)["parameters"]
    assert tuple(parameter["y"]) == (0.5, 0.2)


def test_curves_are_told_apart_by_their_names(root: Path) -> None:
    groups = {curve.name: curve.group for curve in read_curves(root / "push_good" / "metrics.csv")}
    assert groups["train/loss"] == "loss"
    assert groups["blur/sigma"] == groups["lr-Adam"] == "schedule"
    assert groups["params/block.friction/estimate"] == "parameter"


def test_a_line_that_is_still_being_written_is_left_out(tmp_path: Path) -> None:
    path = tmp_path / "metrics.csv"
    path.write_text("epoch,step,a,b\n0,0,1.0,\n1,1,nan,2.0\n2,2,3.0,\n" + HALF_A_LINE)
    curves = {curve.name: curve for curve in read_curves(path)}
    assert curves["a"].y == (1.0, 3.0)
    assert curves["b"].x == (1.0,)


def test_a_figure_with_several_values_in_an_epoch_is_drawn_over_the_steps(tmp_path: Path) -> None:
    path = tmp_path / "metrics.csv"
    path.write_text("epoch,step,a,b\n0,0,1,\n0,1,2,5\n1,2,3,\n1,3,4,6\n")
    axes = {curve.name: (curve.axis, curve.x) for curve in read_curves(path)}
    assert axes == {"a": ("step", (0, 1, 2, 3)), "b": ("epoch", (0, 1))}


def test_thinning_keeps_the_ends_and_every_peak() -> None:
    points = [(float(x), 0.0) for x in range(100_000)]
    points[31_234] = (31_234.0, 7.0)
    kept = thin(points)
    assert len(kept) <= MOST_POINTS
    assert {points[0], points[31_234], points[-1]} <= set(kept)
    assert kept == sorted(kept)


def test_damaged_files_cost_only_what_they_would_have_shown(root: Path) -> None:
    (root / "push_good" / "metrics.csv").write_bytes(b"\xff\xfe\x00")
    (root / "push_good" / "config.yaml").write_text("a: [")
    run = read_run(root / "push_good", root)
    assert run["figures"]["seconds"] == 3.0
    assert [note.split()[0] for note in run["notes"]] == ["config.yaml", "metrics.csv"]
    assert read_run(root / "damaged", root)["state"] == "unfinished"


@pytest.mark.parametrize("endless", [os.mkfifo, lambda path: path.symlink_to("/dev/zero")])
def test_a_pipe_or_a_device_costs_only_what_it_stands_for(root: Path, endless: Callable[[Path], None]) -> None:
    names = ("metrics.json", "metrics.csv", "config.yaml", "record.json", "parameters.csv", "results.json", "x.png")
    folder = root / "push_good"
    for name in names:
        (folder / name).unlink(missing_ok=True)
        endless(folder / name)
    notes = read_run(folder, root)["notes"]
    assert {note.split()[0] for note in notes} == set(names)
    assert all("expected a regular file, found" in note for note in notes)
    write_dashboard(root, root / "page.html")
    assert "expected a regular file, found" in (root / "page.html").read_text()


@pytest.mark.parametrize("through", ["the file", "a folder"])
def test_what_lies_outside_of_a_run_is_on_no_page_whatever_links_lead_to_it(
    root: Path, tmp_path_factory: pytest.TempPathFactory, through: str
) -> None:
    names = ("metrics.json", "metrics.csv", "config.yaml", "record.json", "parameters.csv", "results.json")
    folder, home = root / "push_good", tmp_path_factory.mktemp("home")
    (home / "x.png").write_text("precious")
    links = ["x.png", "report.html", "findings.json", *names] if through == "the file" else ["drawn"]
    for name in links:
        (folder / name).unlink(missing_ok=True)
        (folder / name).symlink_to(home if through == "a folder" else home / "x.png")
    notes = read_run(folder, root)["notes"]
    assert len(notes) == len(links)
    assert all("found a link to what lies outside of" in note for note in notes)
    write_dashboard(root, root / "page.html")
    page = (root / "page.html").read_text()
    assert "precious" not in page
    assert base64.b64encode(b"precious").decode() not in page


def test_a_link_to_a_file_of_the_same_run_is_followed(root: Path) -> None:
    folder = root / "push_good"
    before = read_run(folder, root)
    (folder / "metrics.json").rename(folder / "figures.json")
    (folder / "metrics.json").symlink_to("figures.json")
    assert read_run(folder, root)["figures"] == before["figures"]
    (root.parent / "by_another_name").symlink_to(root)
    assert read_run(root.parent / "by_another_name" / "push_good", root.parent / "by_another_name")["notes"] == []


def test_settings_are_flat_and_leave_out_init_args() -> None:
    config = {"model": {"class_path": "A", "init_args": {"b": None, "c": [1, 2], "d": {}}}}
    assert flatten(config) == {"model.class_path": '"A"', "model.b": "null", "model.c": "[1, 2]", "model.d": "{}"}


def test_no_text_of_a_run_can_leave_its_script_element(root: Path) -> None:
    run = read_run(root / "push_good", root) | {"id": "</script><script>alert(1)</script><!--"}
    page = render([run], "a </title> & b")
    (data,) = re.findall(r'<script type="application/json" id="data">(.*?)</script>', page, re.DOTALL)
    assert json.loads(data)[0]["id"] == run["id"]
    assert "alert(1)</script>" not in page
    assert "<title>a &lt;/title&gt; &amp; b" in page


def test_a_light_page_carries_no_films_images_or_reports(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["dashboard", str(root)]) == 0
    assert "9 runs" in capsys.readouterr().out
    whole = (root / "dashboard.html").read_text()
    assert main(["dashboard", str(root), "--light", "--out", str(root / "light.html")]) == 0
    light = (root / "light.html").read_text()
    assert "data:video/mp4" in whole
    assert "The report" in whole
    assert "data:video/mp4" not in light
    assert "The report" not in light


def test_a_scored_bank_gives_its_figures_and_what_is_neither_rows_nor_a_bank_is_named(root: Path) -> None:
    run = read_run(root / "score", root)
    assert run["figures"] == {
        "false alarms on effect-free sets": 3.3,
        "coverage of 90 % intervals, effects": 91.0,
        "exact accuracy, medium and up": 71.0,
    }
    assert (run["cells"], run["state"]) == ([], "finished")
    (root / "score" / "results.json").write_text('{"bank": {}, "figures": 3, "tables": {}}')
    assert "expected rows of a reproduction or a scored bank" in read_run(root / "score", root)["notes"][0]


def test_a_diagnosis_without_all_of_its_parts_is_shown_all_the_same(root: Path) -> None:
    assert "viscous drag or quadratic drag" in read_run(root / "diagnosis", root)["sentence"]
    (root / "diagnosis" / "diagnosis.json").write_text('{"verdict": "group"}')
    assert read_run(root / "diagnosis", root)["sentence"] == "group"


def test_what_a_benchmark_has_sealed_is_not_opened(root: Path) -> None:
    (root / "bank" / "sealed").mkdir(parents=True)
    (root / "bank" / "sealed" / "metrics.json").write_text("{}")
    assert not any("sealed" in folder.parts for folder in find_runs(root))


def test_a_folder_without_runs_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["dashboard", str(tmp_path)]) == 2
    assert f"{tmp_path}: expected runs" in capsys.readouterr().err


@pytest.mark.parametrize("value", ['"3"', "[1]", "null", "true", "1" + "0" * 400, "1e400", "-Infinity"])
@pytest.mark.parametrize("name", ["params/x/estimate", "val/y", "seconds"])
def test_a_figure_that_is_no_finite_number_costs_itself_alone(tmp_path: Path, name: str, value: str) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "metrics.json").write_text(f'{{"test/error": 1.5, "{name}": {value}, "val/loss": 2}}')
    (run,) = write_dashboard(tmp_path, tmp_path / "page.html")
    assert run["state"] == "finished"
    assert (run["figures"], run["parameters"]) == ({"test/error": 1.5, "val/loss": 2.0}, [])
    (note,) = run["notes"]
    assert note.startswith("metrics.json")
    assert name in note


def test_figures_that_are_no_numbers_are_named_in_one_short_line() -> None:
    found, note = numbers_of({"good": 1.0, **{f"{'long ' * 100}\x1b[31m\n{k}": "bad" for k in range(20_000)}})
    assert found == {"good": 1.0}
    assert "and 19997 more" in note
    assert len(note) < 1000
    assert note.isprintable()


HOSTILE = "a0: &a0 [x, x]\n" + "".join(f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]\n" for n in range(1, 12))


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("config.yaml", HOSTILE),
        ("config.yaml", "[" * 100_000),
        ("config.yaml", "\x00"),
        ("metrics.json", ""),
        ("metrics.json", "[" * 100_000),
        ("metrics.json", '{"params/x/estimate": 1, "params/x/true": "two"}'),
        ("record.json", "[1"),
        ("diagnosis.json", '{"verdict": 3, "effects": 4}'),
        ("results.json", '{"bank": {}, "figures": [3], "tables": {}}'),
        ("results.json", '[{"cell": 1}]'),
        ("identifiability.json", '{"config": [1]}'),
        ("metrics.csv", "epoch,\x00\n1,2\n"),
        ("metrics.csv", "epoch,a,a\n1,2\n"),
    ],
)
def test_a_malformed_run_costs_no_other(tmp_path: Path, name: str, content: str) -> None:
    for run in ("good", "bad"):
        (tmp_path / run).mkdir()
        (tmp_path / run / "metrics.json").write_text('{"test/error": 1.0}')
    (tmp_path / "bad" / name).write_text(content)
    runs = {run["id"]: run for run in write_dashboard(tmp_path, tmp_path / "page.html")}
    assert runs["good"]["figures"] == {"test/error": 1.0}
    assert runs["bad"]["state"] in ("finished", "unfinished", "damaged")
    assert runs.keys() == {"good", "bad"}


def test_only_the_pages_own_script_may_run(tmp_path: Path) -> None:
    page = render([], "<script>alert(1)</script>")
    policy = re.search(r"script-src '(sha256-[^']+)'", page)
    scripts = re.findall(r"<script>(.*?)</script>", page, re.DOTALL)
    assert policy is not None
    assert "unsafe-inline'; script" in page
    assert "script-src 'unsafe-inline'" not in page
    digest = base64.b64encode(hashlib.sha256(scripts[-1].encode()).digest()).decode()
    assert policy[1] == f"sha256-{digest}"
    assert len(scripts) == 1


@pytest.mark.parametrize("explained", [0.0, 1.0])
def test_a_run_whose_model_leaves_more_than_noise_says_so_beside_its_intervals(root: Path, explained: float) -> None:
    path = root / "push_good" / "metrics.json"
    kinds = {"position": explained, "rotation": 1.0}
    left = {"noise": 1e-4, "unexplained": 3e-3, "share": 0.0068}
    figures = {f"fit/{kind}_{word}": value for kind in kinds for word, value in left.items()}
    figures |= {f"fit/{kind}_explained": value for kind, value in kinds.items()}
    path.write_text(json.dumps(json.loads(path.read_text()) | figures))
    notes = " ".join(read_run(root / "push_good", root)["notes"])
    assert ("0.68 % of the motion, 3 mm (noise 0.1 mm): run physid diagnose data/push" in notes) == (explained == 0)
    assert ("The intervals of the parameters hold for a model" in notes) == (explained == 0)
    write_dashboard(root, root / "page.html")
    page = (root / "page.html").read_text()
    assert page.count(">the model leaves 3 mm<") == (explained == 0), "once, in the row of this run"
    assert page.count('title="90 % interval, if the model held"') == (explained == 0)


@pytest.mark.parametrize(("observable", "shown"), [(0.0, True), (1.0, False), (None, False)])
def test_an_estimate_that_recordings_do_not_identify_is_marked_in_the_table_and_beside_its_interval(
    tmp_path: Path, observable: float | None, shown: bool
) -> None:
    write_fit(tmp_path / "mine", 0.21, 4.0)
    path = tmp_path / "mine" / "metrics.json"
    said = {} if observable is None else {"params/block.friction/observable": observable}
    path.write_text(json.dumps(json.loads(path.read_text()) | said))
    write_dashboard(tmp_path, tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text()
    assert (">not identified<" in page) is shown
    assert ("do not rely on it: these recordings do not identify it by itself" in page) is shown


def test_the_table_has_intervals_and_no_column_without_a_value(tmp_path: Path) -> None:
    write_fit(tmp_path / "mine", 0.21, 4.0)
    path = tmp_path / "mine" / "metrics.json"
    known = {name: value for name, value in json.loads(path.read_text()).items() if "test/" not in name}
    path.write_text(json.dumps(known))
    write_dashboard(tmp_path, tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text()
    assert "0.2100 (0.2090 to 0.2110)" in page
    assert ">Evaluations<" in page
    assert ">Parameter error<" in page
    assert ">Position error<" not in page
