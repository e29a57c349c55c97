"""Cells and results of `physid reproduce`."""

import json
import os
import pty
import subprocess
import sys
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from physid.configuration import ConfigurationError, compose
from physid.reproduce.cells import Cell, Fit, Recordings
from physid.reproduce.profiles import PROFILES
from physid.reproduce.results import Result, markdown, over_seeds, read_results, table, write_results
from physid.reproduce.run import _remaining, choose, report, reproduce

CONFIGS = Path(__file__).parents[2] / "configs"
GOOD = Result("sysid/push_mass", "block.mass, error", 0.02, "%", None, 0.1)
BAD = Result("sysid/push_mass", "position error", 0.7, "% of size", 0.7, 0.1)


@dataclass
class Counting(Cell):
    name: str = "sysid/counting"
    recordings: Recordings | None = None
    minutes: float = 1.0
    calls: list[Path] = field(default_factory=list)

    def run(self, configs: Path, data: Path, folder: Path) -> list[Result]:
        folder.mkdir(parents=True)
        self.calls.append(folder)
        return [GOOD]


def test_results_read_back_as_they_were_written(tmp_path: Path) -> None:
    write_results(tmp_path / "results.json", [GOOD, BAD])
    assert read_results(tmp_path / "results.json") == [GOOD, BAD]
    entries = json.loads((tmp_path / "results.json").read_text())
    assert set(entries[0]) == {"cell", "metric", "value", "unit", "paper", "target", "spread"}


def test_a_missed_target_is_marked_and_named() -> None:
    assert not GOOD.misses
    assert BAD.misses
    nothing = Result("c", "m", float("inf"), "", target=1.0)
    assert nothing.misses
    assert nothing.row()[2] == "none x"
    assert "0.7 x" in table([GOOD, BAD])
    assert "0.7 x" in markdown([GOOD, BAD])
    assert "missed: sysid/push_mass position error" in report([GOOD, BAD], Path("out"))
    assert "every target is met" in report([GOOD], Path("out"))


def test_several_seeds_give_mean_and_standard_deviation() -> None:
    runs = [[replace(GOOD, value=value)] for value in (1.0, 2.0, 3.0)]
    (merged,) = over_seeds(runs)
    assert (merged.value, merged.spread) == (2.0, 1.0)
    assert merged.row()[2].startswith("2 ± 1")
    assert over_seeds(runs[:1]) == runs[0]
    assert over_seeds([[GOOD], [replace(GOOD, value=None)]])[0].value is None


def test_only_what_learns_from_video_is_repeated() -> None:
    film, poses = choose("quick", ["supervised/push_friction", "sysid/push_friction"], seeds=3)
    assert isinstance(film, Fit)
    assert isinstance(poses, Fit)
    assert (film.seeds, poses.seeds) == (3, 1)
    with pytest.raises(ConfigurationError, match="--seeds"):
        choose("quick", [], seeds=0)


def test_a_second_call_runs_nothing_again_unless_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cell = Counting()
    for _ in range(2):
        assert reproduce([cell], tmp_path, configs=CONFIGS) == [GOOD]
    assert len(cell.calls) == 1
    assert capsys.readouterr().out.splitlines() == ["sysid/counting begins", "[1/1] sysid/counting"]
    assert (tmp_path / "results.md").exists()
    (cell.calls[0] / "last.ckpt").write_text("a run that would be taken up where it ended")
    assert reproduce([cell], tmp_path, configs=CONFIGS, again=True) == [GOOD]
    assert len(cell.calls) == 2
    assert not (cell.calls[0] / "last.ckpt").exists()


def test_seeds_are_kept_one_by_one_and_more_of_them_run_only_what_is_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fitted: list[str] = []

    def fit(values: dict[str, Any], folder: Path, *, resume: bool) -> dict[str, float]:
        fitted.append(folder.name)
        return {"test/position_error": float(values.get("seed_everything", 9)), "seconds": 1.0}

    monkeypatch.setattr("physid.training.runs.run.fit", fit)
    monkeypatch.setattr("physid.reproduce.run._record", lambda *_: None)

    def error(seeds: int, again: bool = False) -> Result:
        cells = choose("quick", ["supervised/push_friction"], seeds=seeds)
        return reproduce(cells, tmp_path, configs=CONFIGS, again=again)[0]

    error(1)
    assert (error(2).value, error(3).value, error(3).spread) == (50.0, 100.0, 100.0)
    assert fitted == ["push_friction", "seed_0", "seed_1", "seed_2"]
    error(2, again=True)
    assert fitted[4:] == ["seed_0", "seed_1"]


@pytest.mark.slow
def test_relative_folders_hold_where_worker_processes_outlive_a_call(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cells = [Counting(name="sysid/one"), Counting(name="sysid/two")]
    for place in (tmp_path / "first", tmp_path / "second"):
        place.mkdir()
        monkeypatch.chdir(place)
        assert reproduce(cells, Path("runs"), configs=CONFIGS, at_once=2) == [GOOD, GOOD]
        assert (place / "runs/sysid/two").is_dir()


@pytest.mark.slow
def test_cells_beside_each_other_say_when_they_begin_and_draw_no_bars(tmp_path: Path) -> None:
    cells = ("sysid/push_mass", "sysid/push_friction")
    options = ["--at-once=2", f"--cell={','.join(cells)}", f"--configs={CONFIGS}", f"--out={tmp_path}"]
    command = [sys.executable, "-m", "physid", "reproduce", *options]
    terminal, end = pty.openpty()
    with subprocess.Popen(command, stdout=end, stderr=end) as process:
        os.close(end)
        shown = b"".join(iter(partial(_read, terminal), b"")).decode()
    os.close(terminal)
    assert process.returncode == 0, shown
    assert all(f"{cell} begins" in shown for cell in cells)
    assert "[2/2]" in shown
    assert "Epoch" not in shown


def _read(terminal: int) -> bytes:
    """Read what a terminal shows; nothing once its last writer is gone, which Linux reports as an error."""
    try:
        return os.read(terminal, 4096)
    except OSError:
        return b""


@pytest.mark.parametrize("profile", PROFILES)
def test_every_cell_has_its_configuration_and_a_name_of_its_own(profile: str) -> None:
    cells = PROFILES[profile]
    assert len({cell.name for cell in cells}) == len(cells)
    for cell in cells:
        if isinstance(cell, Fit):
            compose([CONFIGS / cell.configuration], list(cell.overrides))
            assert (CONFIGS / "generate" / f"{cell.recordings.name}.yaml").is_file()


def test_the_time_left_counts_what_cells_cost(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert _remaining(60.0, total=10.0, left=4.0) == "  (about 40 s left)"
    assert _remaining(600.0, total=10.0, left=9.0) == "  (about 90 min left)"
    assert _remaining(60.0, total=10.0, left=0.0) == ""
    reproduce([Counting(name="sysid/one", minutes=1.0)], tmp_path, configs=CONFIGS)
    assert "left" not in capsys.readouterr().out


def test_an_unknown_cell_or_profile_is_refused_with_the_nearest_name() -> None:
    assert [cell.name for cell in choose("quick", ["sysid/push_mass"])] == ["sysid/push_mass"]
    every = [cell.name for cell in choose("quick", [])]
    assert [cell.name for cell in choose("quick", ["sysid"])] == [name for name in every if name.startswith("sysid/")]
    with pytest.raises(ConfigurationError, match=r"did you mean 'sysid/push_mass'"):
        choose("quick", ["sysid/pushmass"])
    with pytest.raises(ConfigurationError, match="unknown profile"):
        choose("slow", [])


def test_cells_with_the_same_films_share_an_encoder_once_it_is_learned(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[dict[str, Any]] = []

    def fit(values: dict[str, Any], folder: Path, *, resume: bool) -> dict[str, float]:
        seen.append(values)
        return {}

    monkeypatch.setattr("physid.training.runs.run.fit", fit)
    (cell,) = choose("paper", ["supervised/push_mass"])
    (alone,) = choose("reduced", ["supervised/push_mass"])
    donor = tmp_path / "supervised/push_friction"
    donor.mkdir(parents=True)
    (donor / "metrics.json").write_text("{}")
    for one, name in ((cell, "supervised/push_mass"), (cell, "supervised/push_mass"), (alone, "other/push_mass")):
        one.run(CONFIGS, tmp_path / "data", tmp_path / name)
    taking, resumed, own = (values["model"]["init_args"] for values in seen)
    assert taking == resumed
    assert taking["vision"]["weights"] == str(donor / "checkpoints/last.ckpt")
    assert taking["phases"]["warm_up"] == 0
    assert seen[0]["trainer"]["max_epochs"] == 6
    assert "weights" not in own["vision"]
    # What has begun without goes on without.
    (tmp_path / "supervised/push_mass/config.yaml").write_text("{}")
    cell.run(CONFIGS, tmp_path / "data", tmp_path / "supervised/push_mass")
    assert "weights" not in seen[-1]["model"]["init_args"]["vision"]
