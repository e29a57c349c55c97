"""`physid predict`: a recording set of what a fitted model predicts, under recorded or planned forces."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from physid.cli import main
from physid.data import Recording, RecordingSet, trajectory_path, write_scene, write_trajectory

CONFIG = Path(__file__).parents[2] / "configs" / "sysid" / "push_friction.yaml"
TRACKED = 1e-4  # [m] over the 16 frames of the tiny recordings


@pytest.fixture(scope="module")
def run(recordings: Callable[[str], Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run") / "push"
    data = f"data.folder={recordings('push')}"
    assert main(["fit", "--config", str(CONFIG), data, f"--run-dir={folder}"]) == 0
    return folder


def predict(run: Path, out: Path, *words: str) -> RecordingSet:
    assert main(["predict", f"--run-dir={run}", f"--out={out}", *words]) == 0
    made = RecordingSet(out)
    made.verify()
    return made


def pose(recording: Recording) -> np.ndarray:
    assert recording.pose is not None
    return recording.pose


def test_predictions_are_a_recording_set_near_the_one_they_are_of(run: Path, tmp_path: Path) -> None:
    made = predict(run, tmp_path / "out")
    known = RecordingSet(json.loads((run / "record.json").read_text())["data"].popitem()[0])
    assert [path.name for path in made.paths] == [path.name for path in known.paths]
    assert made.splits() == known.splits()
    for recorded, predicted in zip(known, made, strict=True):
        assert np.abs(pose(recorded) - pose(predicted)).max() < TRACKED
    estimate = json.loads((run / "metrics.json").read_text())["params/block.friction/estimate"]
    assert made.scene.value("block.friction") == pytest.approx(estimate, rel=1e-12)
    assert made.scene.unknown == ()
    found = json.loads((tmp_path / "out" / "parameters.json").read_text())
    assert found["block.friction"]["estimate"] == made.scene.value("block.friction")
    figures = json.loads((run / "metrics.json").read_text())
    for end in ("low", "high"):
        assert found["block.friction"][end] == figures[f"params/block.friction/{end}"]


def test_what_was_predicted_is_predicted_again(run: Path, tmp_path: Path) -> None:
    once = predict(run, tmp_path / "once")
    twice = predict(run, tmp_path / "twice", f"data.folder={once.folder}")  # a set that calls nothing unknown
    for first, second in zip(once, twice, strict=True):
        assert np.allclose(pose(first), pose(second), atol=1e-9)


def test_planned_forces_that_are_the_recorded_ones_give_the_same(run: Path, tmp_path: Path) -> None:
    under_recorded = predict(run, tmp_path / "recorded").read(0)
    assert under_recorded.wrench is not None
    np.save(tmp_path / "planned.npy", under_recorded.wrench[:-1])
    planned = predict(run, tmp_path / "planned", f"--forces={tmp_path / 'planned.npy'}")
    assert np.array_equal(pose(planned.read(0)), pose(under_recorded))


def test_a_constant_planned_force_gives_the_closed_form(run: Path, tmp_path: Path) -> None:
    steps, force = 40, 6.0
    (tmp_path / "planned.csv").write_text("block.force_x\n" + f"{force}\n" * steps)
    made = predict(run, tmp_path / "out", f"--forces={tmp_path / 'planned.csv'}", "data.limit=1")
    block, h = made.scene.bodies[0], made.scene.time_step
    moved = pose(made.read(0))[:, 0, 0] - pose(made.read(0))[0, 0, 0]
    assert len(moved) == steps + 1
    step = np.arange(steps + 1)
    expected = (force / block.mass - block.friction * 9.81) * h**2 * step * (step + 1) / 2
    assert np.allclose(moved, expected, atol=1e-5)


def test_a_initial_state_of_ones_own_is_a_recording_of_one_frame(run: Path, tmp_path: Path) -> None:
    known = RecordingSet(json.loads((run / "record.json").read_text())["data"].popitem()[0])
    first = known.read(0)
    assert first.pose is not None
    assert first.twist is not None
    assert first.wrench is not None
    write_scene(tmp_path / "mine", known.scene)
    write_trajectory(trajectory_path(tmp_path / "mine", 0), Recording(pose=first.pose[:1], twist=first.twist[:1]))
    np.save(tmp_path / "planned.npy", first.wrench[:-1])
    words = [f"data.folder={tmp_path / 'mine'}", f"--forces={tmp_path / 'planned.npy'}"]
    predicted = predict(run, tmp_path / "planned", *words).read(0)
    assert np.array_equal(pose(predicted), pose(predict(run, tmp_path / "recorded").read(0)))


def test_a_folder_of_ones_own_is_not_cleared_for_predictions(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "out.part" / "my").mkdir(parents=True)
    (tmp_path / "out.part" / "my" / "thesis.txt").touch()
    assert main(["predict", f"--run-dir={run}", f"--out={tmp_path / 'out'}"]) == 2
    assert "out.part: expected what an earlier run left unfinished, or nothing, found 'my'" in capsys.readouterr().err
    assert (tmp_path / "out.part" / "my" / "thesis.txt").exists()
    assert not (tmp_path / "out").exists()


def test_an_earlier_result_is_kept_unless_asked(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    predict(run, out, "data.limit=3")
    assert main(["predict", f"--run-dir={run}", f"--out={out}"]) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert len(predict(run, out, "data.limit=2", "--overwrite")) == 2
    (out / "parameters.json").unlink()
    assert main(["predict", f"--run-dir={run}", f"--out={out}", "--overwrite"]) == 2
    assert "is not deleted" in capsys.readouterr().err
    assert out.exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--forces=absent.csv"], "absent.csv: expected planned forces, found no such file"),
        (["data.folder=absent"], "absent/recording.yaml: expected a recording set"),
        (["--checkpoint=absent.ckpt"], "absent.ckpt does not exist: run `physid fit` first"),
    ],
)
def test_a_mistake_ends_in_one_line_and_leaves_nothing(
    words: list[str], message: str, run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["predict", f"--run-dir={run}", f"--out={tmp_path / 'out'}", *words]) == 2
    error = capsys.readouterr().err.strip()
    assert message in error
    assert len(error.splitlines()) == 1
    assert not list(tmp_path.iterdir())
