"""A file cannot make its reader allocate more than it holds, look elsewhere, or fail other than by one error."""

import tracemalloc
from pathlib import Path

import h5py
import numpy as np
import pytest
from tests.data.sets import recording

from physid.data import read_trajectory, write_trajectory
from physid.data.trajectory import read_film, read_labels

SMALL = 8 << 20  # bytes


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "000000.h5"


@pytest.mark.parametrize("compression", [None, "gzip"])
@pytest.mark.parametrize("frames", [10**5, 10**9])
def test_a_small_file_that_declares_many_frames_is_refused_without_memory(
    path: Path, compression: str | None, frames: int
) -> None:
    with h5py.File(path, "w") as file:
        pose = file.create_dataset("pose", (frames, 1, 7), "f8", chunks=(100, 1, 7), compression=compression)
        pose[:100] = [0, 0, 0, 0, 0, 0, 1]
    assert path.stat().st_size < 50_000
    tracemalloc.start()
    with pytest.raises(ValueError, match=rf"{path}: pose: expected .*found"):
        read_trajectory(path)
    assert tracemalloc.get_traced_memory()[1] < SMALL
    tracemalloc.stop()


def test_floating_point_numbers_that_pack_better_than_any_motion_are_refused(path: Path) -> None:
    zeros = np.zeros((2 * 10**6, 1, 7))
    with h5py.File(path, "w") as file:
        file.create_dataset("pose", data=zeros, chunks=(10**5, 1, 7), compression="gzip", compression_opts=1)
    with pytest.raises(ValueError, match=r"pose: expected the 112000000 bytes of shape .* found"):
        read_trajectory(path)


def test_forces_that_stay_the_same_may_pack_well(path: Path) -> None:
    write_trajectory(path, recording(2000))
    with h5py.File(path, "r+") as file:
        del file["wrench"]
        file.create_dataset("wrench", data=np.ones((2000, 1, 6)), chunks=(2000, 1, 6), compression="gzip")
    assert read_trajectory(path).length == 2000


def test_one_huge_chunk_is_refused(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file.create_dataset("pose", (2, 1, 7), "f8", chunks=(10**6, 1, 7), maxshape=(None, 1, 7), compression="gzip")
        file["pose"][:] = [0, 0, 0, 0, 0, 0, 1]
    with pytest.raises(ValueError, match=r"pose: expected .* chunks"):
        read_trajectory(path)


def test_numbers_that_lie_elsewhere_are_refused(path: Path) -> None:
    other = path.with_name("other.h5")
    write_trajectory(other, recording())
    with h5py.File(path, "w") as file:
        file["pose"] = h5py.ExternalLink(str(other), "pose")
    with pytest.raises(ValueError, match="pose: expected a dataset of this file, found a group or a link"):
        read_trajectory(path)
    layout = h5py.VirtualLayout((8, 1, 7), "f8")
    layout[:] = h5py.VirtualSource(str(other), "pose", (8, 1, 7))
    with h5py.File(path, "w") as file:
        file.create_virtual_dataset("pose", layout)
    with pytest.raises(ValueError, match="expected numbers in this file, found some that lie in another"):
        read_trajectory(path)
    path.with_name("raw").write_bytes(bytes(8 * 56))
    with h5py.File(path, "w") as file:
        file.create_dataset("pose", (8, 1, 7), "f8", external=[(str(path.with_name("raw")), 0, 8 * 56)])
    with pytest.raises(ValueError, match="expected numbers in this file"):
        read_trajectory(path)


def test_what_is_no_array_of_numbers_is_refused(path: Path) -> None:
    for content, message in (
        (["a", "b"], "expected an array of numbers"),
        (np.float64(3), r"expected shape \(T, N, 7\)"),
    ):
        with h5py.File(path, "w") as file:
            file["pose"] = content
        with pytest.raises(ValueError, match=f"pose: {message}"):
            read_trajectory(path)
    with h5py.File(path, "w") as file:
        file.create_group("pose")
    with pytest.raises(ValueError, match="found a group or a link"):
        read_trajectory(path)


@pytest.mark.parametrize("value", [np.arange(3), "x" * 5000])
def test_a_label_that_is_no_short_text_is_refused(path: Path, value: object) -> None:
    write_trajectory(path, recording())
    with h5py.File(path, "a") as file:
        file.attrs["split"] = value
    with pytest.raises(ValueError, match="split: expected a text of at most 4096 characters"):
        read_labels(path)


def test_a_label_in_bytes_is_read(path: Path) -> None:
    write_trajectory(path, recording())
    with h5py.File(path, "a") as file:
        file.attrs["split"], file.attrs["protocol"] = np.bytes_("test"), h5py.Empty("S1")
    assert read_labels(path) == ("test", None)


def test_a_file_without_permission_is_told_in_the_systems_words(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_trajectory(path, recording())
    path.chmod(0)
    try:
        path.open("rb").close()
    except PermissionError:
        with pytest.raises(PermissionError, match="Permission denied"):
            read_trajectory(path)


def problem_of(path: Path) -> str:
    """Return the message with which a file is refused; nothing where it is read."""
    try:
        read_trajectory(path)
        read_film(path, [0, 3])
    except ValueError as error:
        return str(error)
    return ""


@pytest.mark.parametrize("seed", range(3))
def test_flipped_bytes_anywhere_give_an_error_or_the_same_numbers(path: Path, seed: int) -> None:
    generator = np.random.default_rng(seed)
    write_trajectory(path, recording(video=True))
    whole, before = path.read_bytes(), read_trajectory(path)
    for _ in range(60):
        content = bytearray(whole)
        places = generator.integers(0, len(content) if generator.random() < 0.3 else 4096, 3)
        for place in places:
            content[place] = generator.integers(256)
        path.write_bytes(content[: generator.integers(len(content))] if generator.random() < 0.2 else content)
        problem = problem_of(path)
        assert not problem or str(path) in problem
        if not problem:
            read = read_trajectory(path)
            assert read.pose is None or np.array_equal(read.pose, before.pose)  # type: ignore[arg-type]
