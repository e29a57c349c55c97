"""Data sets as LeRobot lays them out, written by pyarrow: each episode comes out as a trajectory."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.data.logs import Truth

from physid.cli import main
from physid.data import RecordingSet
from physid.data.importers.guessing import guess_mapping

parquet = pytest.importorskip("pyarrow.parquet", reason="needs physid[lerobot]")
import pyarrow  # noqa: E402

RATE = 30.0
TRUTHS = [Truth.of(seed, rate=RATE, jitter=0.0, missing=0.0, seconds=1.0 + seed) for seed in range(3)]
STATE = ("x", "y", "z", "qx", "qy", "qz", "qw")
WORDS = ["position=[observation.state/x, observation.state/y, observation.state/z]", "size=[0.1,0.1,0.05]", "mass=0.4",
         "quaternion=[observation.state/qx, observation.state/qy, observation.state/qz, observation.state/qw]",
         "force=action", "friction=0.3"]  # fmt: skip
SINGLE = 1e-6  # LeRobot stores single precision


def rows(index: int) -> dict[str, Any]:
    """Return an episode's columns."""
    truth = TRUTHS[index]
    count = len(truth.time)
    state = np.concatenate([truth.place, truth.turn.as_quat()], 1).astype(np.float32)
    return {
        "observation.state": pyarrow.FixedSizeListArray.from_arrays(pyarrow.array(state.ravel()), 7),
        "action": list(np.outer(truth.time, [1, 2, 3]).astype(np.float32)),
        "timestamp": (np.arange(count) / RATE).astype(np.float32),
        "frame_index": np.arange(count),
        "episode_index": np.full(count, index),
        "task_index": np.zeros(count, np.int64),
    }


def write_data_set(folder: Path, version: str = "v2.1") -> Path:
    """Write three episodes: a file each, or two files, by version."""
    tables = [pyarrow.table(rows(index)) for index in range(len(TRUTHS))]
    if version == "v3.0":
        tables = [pyarrow.concat_tables(tables[:2]), tables[2]]
    for index, table in enumerate(tables):
        name = f"file-{index:03d}" if version == "v3.0" else f"episode_{index:06d}"
        path = folder / "data" / "chunk-000" / f"{name}.parquet"
        path.parent.mkdir(parents=True, exist_ok=True)
        parquet.write_table(table, path)
    features = {
        "observation.state": {"dtype": "float32", "shape": [7], "names": {"axes": list(STATE)}},
        "action": {"dtype": "float32", "shape": [3], "names": None},
        "observation.images.top": {"dtype": "video", "shape": [480, 640, 3], "names": ["height", "width", "channels"]},
    }
    info = {"codebase_version": version, "fps": RATE, "total_episodes": len(TRUTHS), "features": features}
    (folder / "meta").mkdir()
    (folder / "meta/info.json").write_text(json.dumps(info))
    return folder


@pytest.mark.parametrize("version", ["v2.1", "v3.0"])
def test_episodes_are_trajectories(tmp_path: Path, version: str) -> None:
    place = write_data_set(tmp_path / "pushes", version)
    assert main(["import", "lerobot", str(place), *WORDS, "--out", str(tmp_path / "set")]) == 0
    found = RecordingSet(tmp_path / "set")
    assert len(found) == len(TRUTHS)
    assert found.scene.time_step == pytest.approx(1 / RATE)
    for index, truth in enumerate(TRUTHS):
        one = found.read(index)
        assert one.pose is not None
        assert one.wrench is not None
        assert np.allclose(one.pose[:, 0, :3], truth.place, atol=SINGLE)
        assert np.allclose(np.abs((one.pose[:, 0, 3:] * truth.turn.as_quat()).sum(1)), 1, atol=SINGLE)
        assert np.allclose(one.wrench[:, 0, 3:], np.outer(truth.time, [1, 2, 3]), atol=1e-5)


def test_one_table_is_a_log_like_any_other(tmp_path: Path) -> None:
    place = write_data_set(tmp_path / "pushes") / "data/chunk-000/episode_000001.parquet"
    numbers = [f'"observation.state[{n}]"' for n in range(7)]
    words = [word for word in WORDS if not word.startswith(("position", "quaternion"))]
    words += [f"position=[{', '.join(numbers[:3])}]", f"quaternion=[{', '.join(numbers[3:])}]", "order=xyzw"]
    assert main(["import", str(place), *words, "--out", str(tmp_path / "set")]) == 0
    pose = RecordingSet(tmp_path / "set").read(0).pose
    assert pose is not None
    assert np.allclose(pose[:, 0, :3], TRUTHS[1].place, atol=SINGLE)


def test_a_guess_knows_stamps_and_episodes(tmp_path: Path) -> None:
    said = guess_mapping(write_data_set(tmp_path / "pushes"))
    assert "time: timestamp" in said
    assert "trajectory: episode_index" in said
    assert "position: observation.state" not in said, "a name alone would stand for seven"
    assert "position: [observation.state/x, observation.state/y, observation.state/z]" in said
    assert "quaternion: [observation.state/qx, " in said


@pytest.mark.parametrize(
    ("break_it", "message"),
    [
        (
            lambda folder: (folder / "meta/info.json").write_text("[" * 100_000),
            "info.json: expected the description of",
        ),
        (
            lambda folder: (folder / "meta/info.json").write_text("{"),
            "info.json: expected the description of a data set as JSON, found a damaged",
        ),
        (
            lambda folder: (folder / "meta/info.json").write_text('{"codebase_version": "v1.6"}'),
            "expected a data set of version v2.0 or v2.1 or v3.0, found 'v1.6'; LeRobot converts older ones",
        ),
        (
            lambda folder: (folder / "data/chunk-000/episode_000001.parquet").unlink(),
            "expected 3 tables data/chunk-*/*.parquet that meta/info.json promises, found 2; download",
        ),
        (
            lambda folder: (folder / "data/chunk-000/episode_000001.parquet").write_bytes(b"PAR1 cut off"),
            "episode_000001.parquet: expected a table of Parquet, found what cannot be read",
        ),
        (
            lambda folder: parquet.write_table(
                pyarrow.table({"timestamp": [0.0]}), folder / "data/chunk-000/episode_000002.parquet"
            ),
            "episode_000002.parquet: expected the columns of episode_000000.parquet, found timestamp",
        ),
    ],
)
def test_a_broken_data_set_is_answered(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], break_it: Any, message: str
) -> None:
    place = write_data_set(tmp_path / "pushes")
    break_it(place)
    assert main(["import", "lerobot", str(place), *WORDS, "--out", str(tmp_path / "set")]) == 2
    said = capsys.readouterr().err
    assert message in said
    assert said.count("\n") == 1
    assert not (tmp_path / "set").exists()


def test_a_folder_that_is_no_data_set_is_answered(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["import", "lerobot", str(tmp_path), *WORDS, "--out", str(tmp_path / "set")]) == 2
    assert "found no .parquet file in it, and no meta/info.json" in capsys.readouterr().err
