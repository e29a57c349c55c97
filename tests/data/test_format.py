"""What is written can be read again, and what is damaged or wrong is named."""

import dataclasses
import hashlib
import subprocess
from pathlib import Path

import h5py
import numpy as np
import pytest
from tests.data.sets import FRAMES, SCENE, SIZE, recording, write_set

from physid.data import Recording, RecordingSet, read_trajectory, trajectory_path, write_trajectory
from physid.data.files import write_whole
from physid.data.trajectory import read_film


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "000000.h5"


def damage(path: Path, dataset: str) -> None:
    """Flip one bit in the middle of a dataset."""
    with h5py.File(path) as file:
        chunk = file[dataset].id.get_chunk_info(0)
    content = bytearray(path.read_bytes())
    content[chunk.byte_offset + chunk.size // 2] ^= 1
    path.write_bytes(content)


def test_a_trajectory_written_and_read_again_is_the_same(path: Path) -> None:
    written = recording(video=True)
    write_trajectory(path, written)
    read = read_trajectory(path)
    assert {name: array.dtype for name, array in read.arrays().items()} == {
        name: array.dtype for name, array in written.arrays().items()
    }
    assert all(np.array_equal(read.arrays()[name], array) for name, array in written.arrays().items())
    assert (read.split, read.protocol) == ("train", "paper")


def test_the_same_trajectory_gives_the_same_bytes(tmp_path: Path) -> None:
    digests = set()
    for name in ("a.h5", "b.h5"):
        write_trajectory(tmp_path / name, recording(video=True))
        digests.add(hashlib.sha256((tmp_path / name).read_bytes()).hexdigest())
    assert len(digests) == 1


def test_datasets_carry_checksums_and_frames_are_chunked_one_by_one(path: Path) -> None:
    write_trajectory(path, recording(video=True))
    with h5py.File(path) as file:
        assert all(file[name].fletcher32 for name in file)
        assert file["frames"].chunks == (1, SIZE, SIZE, 3)
        assert file["frames"].compression == "gzip"


@pytest.mark.parametrize("dataset", ["pose", "wrench", "frames"])
def test_a_flipped_bit_is_found_and_named(path: Path, dataset: str) -> None:
    write_trajectory(path, recording(video=True))
    damage(path, dataset)
    with pytest.raises(ValueError, match=rf"{path}: {dataset}: expected data that fit their checksum"):
        read_trajectory(path)


def test_a_file_that_is_no_hdf5_is_named(path: Path) -> None:
    path.write_text("nothing of the kind")
    with pytest.raises(ValueError, match=f"{path}: expected an HDF5 file"):
        read_trajectory(path)


def test_a_missing_trajectory_is_named(path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=f"{path}: expected a trajectory"):
        read_trajectory(path)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("pose", np.zeros((FRAMES, 1, 6)), r"pose: expected shape \(T, N, 7\), found \(8, 1, 6\)"),
        ("pose", np.zeros((FRAMES, 1, 7)), "pose: expected unit quaternions x y z w, found one of length 0 in frame 0"),
        ("pose", np.zeros((FRAMES, 1, 7), dtype=np.float32), "pose: expected type float64, found float32"),
        ("wrench", np.zeros((FRAMES + 1, 1, 6)), r"wrench: expected shape \(8, 1, 6\), found \(9, 1, 6\)"),
        ("wrench", np.full((FRAMES, 1, 6), np.nan), "wrench: expected finite values, found .* in frame 0"),
        (
            "wrench",
            np.full((FRAMES, 1, 6), 1e300),
            r"wrench: expected values of at most 1e\+09 in SI, found .* frame 0",
        ),
        ("pose", np.full((FRAMES, 1, 7), 1e200), r"pose: expected values of at most 1e\+09 in SI, found .* frame 0"),
        ("time", np.zeros(FRAMES), "time: expected increasing times, found 0 s in frame 1"),
        ("wrench_time", np.zeros(FRAMES), "wrench_time: expected increasing times, found 0 s in row 1"),
        ("wrench_time", np.arange(5.0), r"wrench_time: expected shape \(8\), found \(5,\)"),
        ("pose", np.zeros((0, 1, 7)), r"pose: expected at least one of each axis, found shape \(0, 1, 7\)"),
        ("split", "trian", "split must be one of train, val, test"),
    ],
)
def test_a_recording_that_breaks_the_format_is_refused(name: str, value: object, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(recording(), **{name: value})


def test_a_body_may_be_unseen_but_not_known_in_part() -> None:
    good = recording()
    assert good.pose is not None
    assert good.twist is not None
    pose, twist = good.pose.copy(), good.twist.copy()
    pose[[0, 5]] = twist[5] = np.nan
    unseen = dataclasses.replace(good, pose=pose, twist=twist)
    assert unseen.seen[:, 0].tolist() == [False, True, True, True, True, False, True, True]
    with pytest.raises(ValueError, match=r"twist: expected finite values, found .* in frame 5"):
        dataclasses.replace(good, twist=twist)
    pose[3, 0, 6] = np.nan
    with pytest.raises(ValueError, match=r"seven NaN for a body that was not seen, found .* in frame 3, body 0"):
        dataclasses.replace(good, pose=pose)


def test_forces_may_have_a_clock_of_their_own(path: Path) -> None:
    one = dataclasses.replace(recording(), wrench=np.ones((20, 1, 6)), wrench_time=np.arange(20) / 500)
    write_trajectory(path, one)
    read = read_trajectory(path)
    assert np.array_equal(read.wrench_stamps(1 / 60), np.arange(20) / 500)
    assert np.array_equal(recording().wrench_stamps(1 / 60), np.arange(FRAMES) / 60)
    with pytest.raises(ValueError, match=r"wrench: expected shape \(8, 1, 6\), found \(20, 1, 6\)"):
        dataclasses.replace(one, wrench_time=None)


def test_a_recording_needs_poses_or_frames() -> None:
    with pytest.raises(ValueError, match="pose or frames must be there"):
        Recording(wrench=np.zeros((3, 1, 6)))


def test_a_wrong_file_is_named_with_dataset_expected_and_found(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["pose"] = np.ones((5, 2, 7)) * [0, 0, 0, 0, 0, 0, 1]
    with pytest.raises(ValueError, match=rf"{path}: pose: expected shape \(T, 1, 7\), found \(5, 2, 7\)"):
        read_trajectory(path, bodies=1)


def test_an_unknown_dataset_is_answered_with_the_nearest(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["poses"] = np.zeros((5, 1, 7))
    with pytest.raises(ValueError, match='unknown dataset "poses"; did you mean "pose"'):
        read_trajectory(path)


def test_single_frames_are_decoded_in_any_order(path: Path) -> None:
    written = recording(video=True)
    write_trajectory(path, written)
    frames, mask, background = read_film(path, [5, 0, 5])
    assert written.frames is not None
    assert np.array_equal(frames, written.frames[[5, 0, 5]])
    assert mask.dtype == np.bool_
    assert np.array_equal(background, written.background)


def test_a_set_knows_its_scene_its_splits_and_its_trajectories(tmp_path: Path) -> None:
    folder = write_set(tmp_path, [recording(seed=0), recording(seed=1, split="test"), recording(seed=2)])
    recordings = RecordingSet(folder)
    assert recordings.scene == SCENE
    assert len(recordings) == 3
    assert recordings.splits() == ["train", "test", "train"]
    assert recordings.indices(["train"]) == [0, 2]
    assert np.array_equal(recordings.read(1).pose, recording(seed=1).pose)
    with pytest.raises(ValueError, match="expected trajectories of split val, found only test, train"):
        recordings.indices(["val"])


def test_the_checksums_are_those_of_sha256sum_and_catch_a_change(tmp_path: Path) -> None:
    folder = write_set(tmp_path, [recording()])
    subprocess.run(["sha256sum", "--check", "--quiet", "SHA256SUMS"], cwd=folder, check=True)
    recordings = RecordingSet(folder)
    recordings.verify()
    damage(recordings.paths[0], "pose")
    with pytest.raises(ValueError, match=r"000000.h5: expected SHA-256"):
        recordings.verify()


def test_a_folder_that_is_no_set_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"recording.yaml: expected a recording set"):
        RecordingSet(tmp_path)
    (tmp_path / "recording.yaml").write_text("format: [")
    with pytest.raises(ValueError, match=r"recording.yaml:2: no valid YAML"):
        RecordingSet(tmp_path)


def test_a_recording_yaml_of_aliases_that_multiply_is_refused(tmp_path: Path) -> None:
    bomb = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
        f"{name}: &{name} [{', '.join(['*' + before] * 9)}]\n"
        for before, name in zip("abcdefgh", "bcdefghi", strict=True)
    )
    (tmp_path / "recording.yaml").write_text(bomb)
    with pytest.raises(ValueError, match=r"recording.yaml: expected aliases to repeat at most"):
        RecordingSet(tmp_path)


def test_a_write_that_is_interrupted_leaves_nothing_behind_under_the_final_name(tmp_path: Path) -> None:
    path = trajectory_path(tmp_path, 3)

    def interrupted(part: Path) -> None:
        part.write_text("half")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_whole(path, interrupted)
    assert not path.exists()
    write_trajectory(path, recording())
    assert [file.name for file in path.parent.iterdir()] == ["000003.h5"]


def test_a_film_without_poses_is_known_without_its_images(tmp_path: Path) -> None:
    one = dataclasses.replace(recording(video=True), pose=None, twist=None)
    made = RecordingSet(write_set(tmp_path / "set", [one]))
    blank = made.read(0, blank=True)
    assert blank.frames is not None
    assert blank.length == one.length
    assert blank.frames.strides == (0, 0, 0, 0), "in no memory"
    assert np.array_equal(np.asarray(blank.wrench), np.asarray(one.wrench))
    with pytest.raises(ValueError, match="expected to be there when frames are left on the disk"):
        made.read(0)
