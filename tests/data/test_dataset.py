"""Batches hold what the recordings hold."""

import resource
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from tests.data.sets import FRAMES, recording, write_set

from physid.data import RecordingSet
from physid.data.batches.datamodule import RecordingsDataModule
from physid.data.batches.dataset import Segments, collate
from physid.data.generation.generate import generate
from physid.data.generation.settings import GenerateConfig
from physid.data.observations.trajectories import load_trajectories


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    trajectories = [recording(seed=n, split="test" if n == 2 else "train", video=True) for n in range(3)]
    return write_set(tmp_path, trajectories)


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("film")
    generate(GenerateConfig("collide", trajectories=3, steps=8, split={"train": 2, "test": 1}), place, quiet=True)
    return place


def test_segments_cut_the_trajectories_without_gap(folder: Path) -> None:
    recordings = RecordingSet(folder)
    segments = Segments(recordings, [0, 1], length=4)
    assert len(segments) == 2 * 2
    assert [(int(one["index"]), int(one["start"])) for one in (segments[n] for n in range(4))] == [
        (0, 0), (0, 3), (1, 0), (1, 3),
    ]  # fmt: skip
    expected = recordings.read(1)
    assert expected.pose is not None
    assert expected.wrench is not None
    assert np.array_equal(segments[3]["pose"].numpy(), expected.pose[3:7])
    assert np.array_equal(segments[3]["wrench"].numpy(), expected.wrench[3:7])


def test_a_stride_of_one_gives_a_segment_at_every_frame(folder: Path) -> None:
    assert len(Segments(RecordingSet(folder), [0], length=3, stride=1)) == FRAMES - 2


def test_chosen_frames_of_a_segment_are_decoded(folder: Path) -> None:
    recordings = RecordingSet(folder)
    item = Segments(recordings, [1], length=4, stride=2, video=[2, 0])[1]
    expected = recordings.read(1, video=True)
    assert expected.frames is not None
    assert np.array_equal(item["frames"].numpy(), expected.frames[[2, 4]])
    assert np.array_equal(item["first"].numpy(), expected.frames[0])
    assert item["mask"].dtype == torch.bool


def test_shorter_trajectories_are_filled_up_with_their_last_frame(tmp_path: Path) -> None:
    folder = write_set(tmp_path, [recording(5), recording(8, seed=1)])
    segments = Segments(RecordingSet(folder), [0, 1])
    batch = collate([segments[0], segments[1]])
    assert batch["pose"].shape == (2, 8, 1, 7)
    assert batch["length"].tolist() == [5, 8]
    assert torch.equal(batch["pose"][0, 5:], batch["pose"][0, 4:5].expand(3, 1, 7))


def test_a_segment_longer_than_a_trajectory_is_refused(folder: Path) -> None:
    with pytest.raises(ValueError, match="expected at least the 9 frames of a segment, found 8"):
        Segments(RecordingSet(folder), [0], length=9)


def test_a_trajectory_of_one_frame_is_predicted_from_and_learned_from_by_nobody(tmp_path: Path) -> None:
    folder = write_set(tmp_path, [recording(seed=0), recording(seed=1, frames=1)])
    for use in ("fit", "test"):
        segments = RecordingsDataModule(folder, test=["train"]).segments(use)
        assert len(segments[0]["pose"]) == FRAMES
        with pytest.raises(ValueError, match=r"000001.h5: pose: expected at least 2 frames, found 1"):
            segments[1]
    assert len(RecordingsDataModule(folder).segments("predict")[1]["pose"]) == 1
    with pytest.raises(ValueError, match=r"000001.h5: pose: expected at least 2 frames, found 1"):
        load_trajectories(RecordingSet(folder))


@pytest.mark.parametrize(
    ("name", "change", "said"),
    [
        ("frames", lambda old: np.concatenate([old, old]), "expected shape"),
        ("frames", lambda old: old[:-1], "expected shape"),
        ("mask", lambda old: 255 * old.astype(np.uint8), "expected type bool, found uint8"),
        ("mask", lambda old: old[:, 1:], "expected shape"),
        ("background", lambda old: old.astype(np.uint16), "expected type uint8, found uint16"),
    ],
)
def test_a_film_must_fit_its_poses_also_where_it_is_left_on_the_disk(
    name: str, change: Callable[[NDArray[Any]], NDArray[Any]], said: str, folder: Path
) -> None:
    recordings = RecordingSet(folder)
    recordings.read(0)
    with h5py.File(recordings.paths[0], "a") as file:
        value = file[name][:]
        del file[name]
        file[name] = change(value)
    with pytest.raises(ValueError, match=f"{recordings.paths[0].name}: (frames|mask|background): {said}"):
        recordings.read(0)


def test_absent_wrenches_are_zero_and_absent_twists_stay_absent(tmp_path: Path) -> None:
    import dataclasses

    bare = dataclasses.replace(recording(), wrench=None, twist=None)
    item = Segments(RecordingSet(write_set(tmp_path, [bare])), [0])[0]
    assert not item["wrench"].any()
    assert "twist" not in item


def test_a_batch_mixes_no_trajectories_with_and_without_velocities(tmp_path: Path) -> None:
    import dataclasses

    folder = write_set(tmp_path, [recording(), dataclasses.replace(recording(), twist=None)])
    segments = Segments(RecordingSet(folder), [0, 1])
    with pytest.raises(ValueError, match="must carry the same arrays"):
        collate([segments[0], segments[1]])


def test_the_data_module_serves_each_use_from_its_splits(folder: Path) -> None:
    data = RecordingsDataModule(folder, segment=4, batch_size=3)
    assert data.trajectories("fit") == [0, 1]
    assert data.trajectories("test") == [2]
    assert data.val_dataloader() == []
    assert [len(batch["pose"]) for batch in data.train_dataloader()] == [3, 1]
    assert next(iter(data.test_dataloader()))["pose"].shape == (1, FRAMES, 1, 7)
    assert next(iter(data.predict_dataloader()))["pose"].dtype == torch.float64


def test_without_a_batch_size_a_split_is_one_batch(folder: Path) -> None:
    (batch,) = RecordingsDataModule(folder).train_dataloader()
    assert batch["index"].sort().values.tolist() == [0, 1]


def test_recordings_without_splits_are_all_fitted_on(tmp_path: Path) -> None:
    folder = write_set(tmp_path, [recording(split=None), recording(split=None, seed=1)])
    data = RecordingsDataModule(folder)
    assert data.trajectories("fit") == [0, 1]
    with pytest.raises(ValueError, match="expected trajectories of split"):
        data.trajectories("test")


def test_worker_processes_load_the_same_batches(film: Path) -> None:
    batches = [
        next(iter(RecordingsDataModule(film, video=[0, 3], shuffle=False, workers=workers).train_dataloader()))
        for workers in (0, 1)
    ]
    assert all(torch.equal(batches[0][name], batches[1][name]) for name in batches[0])
    assert batches[0]["frames"].shape == (2, 2, 128, 128, 3)


def test_worker_processes_need_no_shared_memory(film: Path) -> None:
    """Where it is full, or no file may grow, torch would wait for ever for tensors that no process can hand over."""
    data = RecordingsDataModule(film, video="all", shuffle=False, workers=1)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    before = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (1024, hard))
        (batch,) = data.train_dataloader()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        signal.signal(signal.SIGXFSZ, before)
    assert batch["frames"].nbytes > 1024


def test_a_video_that_is_whole_passes_the_check(film: Path) -> None:
    RecordingsDataModule(film, video="all").setup("fit")
