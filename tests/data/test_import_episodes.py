"""Data sets as LeRobot lays them out, written by pyarrow: each episode comes out as a trajectory."""

from __future__ import annotations

import json
import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.data.logs import Truth

from physid.cli import main
from physid.data import RecordingSet
from physid.data.importers.guessing import guess_mapping
from physid.data.importers.tables.files import read_table

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
            lambda folder: (folder / "meta/info.json").write_text("{"),
            "info.json: expected the description of a data set as JSON, found a damaged file (Expecting property name",
        ),
        (
            lambda folder: (folder / "meta/info.json").write_text("[" * 100_000),
            "info.json: expected the description of a data set as JSON, found a damaged file (maximum recursion",
        ),
        (
            lambda folder: (folder / "meta/info.json").write_text('{"codebase_version": "v1.6"}'),
            "expected a data set of version v2.0 or v2.1 or v3.0, found 'v1.6'; LeRobot converts older ones",
        ),
        (
            lambda folder: (folder / "data/chunk-000/episode_000001.parquet").unlink(),
            "expected 3 total_episodes, which meta/info.json promises, found 2; download",
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


def test_whatever_is_damaged_in_the_description_of_a_table_is_answered(tmp_path: Path) -> None:
    """Types that nobody has, and what ends the process where pyarrow is asked for the description of a column."""
    table = write_data_set(tmp_path / "pushes") / "data/chunk-000/episode_000000.parquet"
    whole, draw, refused = table.read_bytes(), random.Random(0), 0
    for _ in range(500):
        changed = bytearray(whole)
        changed[-draw.randrange(1, 3000)] = draw.randrange(256)
        table.write_bytes(changed)
        try:
            read_table(table)
        except ValueError as error:
            refused += str(error).startswith(str(table))
    assert refused > 50


def test_a_folder_that_is_no_data_set_is_answered(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["import", "lerobot", str(tmp_path), *WORDS, "--out", str(tmp_path / "set")]) == 2
    assert "found no .parquet file in it, and no meta/info.json" in capsys.readouterr().err


def test_a_data_set_of_v3_of_which_a_file_is_missing_is_refused(tmp_path: Path) -> None:
    """How many files there are nothing says: rows and episodes are counted."""
    place = write_data_set(tmp_path / "pushes", "v3.0")
    (place / "data/chunk-000/file-001.parquet").unlink()
    with pytest.raises(
        ValueError, match=r"pushes: expected 3 total_episodes, which meta.info.json promises, found 2; down"
    ):
        read_table(place)
    info = json.loads((place / "meta/info.json").read_text())
    (place / "meta/info.json").write_text(json.dumps(info | {"total_frames": 1000}))
    with pytest.raises(
        ValueError, match=r"expected 1000 total_frames, which meta.info.json promises, found \d+; download"
    ):
        read_table(place)


def describe_episodes(place: Path, version: str) -> None:
    """Write how many rows each episode has, and how many all of them have."""
    info = json.loads((place / "meta/info.json").read_text())
    described = [{"episode_index": index, "length": len(one.time)} for index, one in enumerate(TRUTHS)]
    total = sum(one["length"] for one in described)
    (place / "meta/info.json").write_text(json.dumps(info | {"total_frames": total}))
    if version == "v3.0":
        (place / "meta/episodes/chunk-000").mkdir(parents=True)
        parquet.write_table(pyarrow.Table.from_pylist(described), place / "meta/episodes/chunk-000/file-000.parquet")
    else:
        (place / "meta/episodes.jsonl").write_text("".join(json.dumps(one) + "\n" for one in described))


@pytest.mark.parametrize("version", ["v2.1", "v3.0"])
def test_whole_episodes_may_be_missing_and_rows_of_one_may_not(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], version: str
) -> None:
    place = write_data_set(tmp_path / "pushes", version)
    describe_episodes(place, version)
    first, last = sorted(place.glob("data/*/*.parquet"))[:: 1 if version == "v3.0" else 2]
    last.unlink()
    assert main(["import", "lerobot", str(place), *WORDS, "--out", str(tmp_path / "set")]) == 0
    assert "2 of 3 episodes are there, each of them whole" in capsys.readouterr().out
    found = RecordingSet(tmp_path / "set")
    for index in (0, 1):
        pose = found.read(index).pose
        assert pose is not None
        assert np.allclose(pose[:, 0, :3], TRUTHS[index].place, atol=SINGLE)
    if version != "v3.0":
        lengths = (place / "meta/episodes.jsonl").read_text().splitlines(keepends=True)
        (place / "meta/episodes.jsonl").write_text("".join(lengths[:2]))
        with pytest.raises(ValueError, match="which say how long each of all episodes is"):
            read_table(place)
        (place / "meta/episodes.jsonl").write_text("".join(lengths))
    table = parquet.read_table(first)
    parquet.write_table(table.slice(0, len(table) - 5), first)
    cut = len(TRUTHS[1 if version == "v3.0" else 0].time)
    with pytest.raises(ValueError, match=rf"pushes: expected {cut} rows of episode \d, .* found {cut - 5}; download"):
        read_table(place)


def test_two_features_that_come_to_one_name_are_refused(tmp_path: Path) -> None:
    place = write_data_set(tmp_path / "pushes")
    info = json.loads((place / "meta/info.json").read_text())
    info["features"]["action"]["names"] = ["x", "y", "z"]
    (place / "meta/info.json").write_text(json.dumps(info))
    for index in range(len(TRUTHS)):
        table = pyarrow.table(rows(index) | {"action/x": np.zeros(len(TRUTHS[index].time))})
        parquet.write_table(table, place / f"data/chunk-000/episode_{index:06d}.parquet")
    with pytest.raises(ValueError, match='expected each column once, found two that are called "action/x"; rename'):
        read_table(place)


@pytest.mark.slow
def test_a_table_that_unpacks_to_more_than_its_size_promises_is_refused_by_its_description(tmp_path: Path) -> None:
    """Zeros pack a thousand times; text and images beside numbers are not read, and do not count."""
    count = 3_000_000
    parquet.write_table(
        pyarrow.table({name: np.zeros(count) for name in "abc"}), tmp_path / "log.parquet", compression="zstd"
    )
    with pytest.raises(ValueError, match=r"log.parquet: expected numbers of 67108864 bytes at most, .* found 72000000"):
        read_table(tmp_path / "log.parquet")
    lists = pyarrow.ListArray.from_arrays(np.arange(0, 3 * count + 1, 300), pyarrow.array(np.zeros(3 * count)))
    parquet.write_table(pyarrow.table({"a.b": lists}), tmp_path / "lists.parquet", compression="zstd")
    with pytest.raises(
        ValueError, match=r"lists.parquet: expected numbers of 67108864 bytes at most, .* found \d+ or more"
    ):
        read_table(tmp_path / "lists.parquet")
    there = {"text": ["push"] * count, "a": np.arange(float(count))}
    parquet.write_table(pyarrow.table(there), tmp_path / "text.parquet", compression="zstd")
    assert list(read_table(tmp_path / "text.parquet").columns) == ["a"]
