"""The real cube tosses, where they are at hand."""

import os
from pathlib import Path

import numpy as np
import pytest
import torch

from physid.data import RecordingSet
from physid.data.importers.cube_tosses import import_cube_tosses
from physid.scenes.camera import corners
from physid.scenes.rotations import conjugate, multiply, to_vector

ROOT = Path(__file__).parents[2]
PLACE = Path(os.environ.get("PHYSID_CUBE_TOSSES", ROOT.parent / "shared" / "real" / "cube_tosses"))
needs_tosses = pytest.mark.skipif(
    not any(PLACE.glob("*.pt")),
    reason=f"no cube tosses in {PLACE}: get assets/contactnets_cube of github.com/DAIRLab/dair_pll and set "
    f"PHYSID_CUBE_TOSSES to that folder",
)


@pytest.fixture(scope="module")
def tosses(tmp_path_factory: pytest.TempPathFactory) -> RecordingSet:
    folder = tmp_path_factory.mktemp("cube")
    import_cube_tosses(PLACE, folder)
    return RecordingSet(folder)


@needs_tosses
def test_every_toss_is_converted_and_dealt_to_a_split(tosses: RecordingSet) -> None:
    assert len(tosses) == len(list(PLACE.glob("*.pt")))
    assert {"train", "val", "test"} == set(tosses.splits())
    assert tosses.scene.time_step == pytest.approx(1 / 148)


@needs_tosses
def test_velocities_are_the_change_of_the_poses_in_the_world_frame(tosses: RecordingSet) -> None:
    step, errors = tosses.scene.time_step, []
    for index in range(0, len(tosses), 20):
        recording = tosses.read(index)
        assert recording.pose is not None
        assert recording.twist is not None
        turn = to_vector(multiply(recording.pose[1:, :, 3:], conjugate(recording.pose[:-1, :, 3:]))) / step
        middle = 0.5 * (recording.twist[1:] + recording.twist[:-1])
        errors.append(np.linalg.norm(turn - middle[..., :3], axis=-1).mean())
    assert np.mean(errors) < 0.5  # [rad/s]; with the body frame taken for the world it is 3.5


@needs_tosses
def test_the_cube_comes_to_rest_on_the_ground(tosses: RecordingSet) -> None:
    ground, sizes = tosses.scene.ground, tosses.scene.sizes
    last = [corners(one.pose[-1:], sizes)[..., 2].min() - ground.offset for one in tosses if one.pose is not None]
    assert abs(np.median(last)) < 5e-4  # [m]
    assert np.abs(last).max() < 5e-3


@needs_tosses
def test_it_falls_with_about_the_acceleration_of_gravity(tosses: RecordingSet) -> None:
    falls = [one.twist[2:10, 0, 5] for one in tosses if one.twist is not None and one.pose is not None]
    assert np.median(np.diff(falls, axis=1)) / tosses.scene.time_step == pytest.approx(-9.81, rel=0.05)


def test_a_folder_without_tosses_says_where_to_get_them(tmp_path: Path) -> None:
    with pytest.raises(
        FileNotFoundError, match=r"expected cube tosses N.pt, found none; get them from github.com/DAIR"
    ):
        import_cube_tosses(tmp_path, tmp_path / "out")


@pytest.mark.parametrize("content", [torch.zeros(20, 12), torch.zeros(20, 13), {"a": 1}])
def test_a_file_of_another_kind_is_named(tmp_path: Path, content: object) -> None:
    torch.save(content, tmp_path / "0.pt")
    with pytest.raises(ValueError, match=r"0.pt: expected"):
        import_cube_tosses(tmp_path, tmp_path / "out")


def test_a_toss_in_the_format_before_archives_is_refused_with_the_remedy(tmp_path: Path) -> None:
    torch.save(torch.zeros(20, 13), tmp_path / "0.pt", _use_new_zipfile_serialization=False)
    with pytest.raises(ValueError, match=r"0.pt: .*no archive of torch.save; torch.save\(torch.load\(FILE\), FILE\)"):
        import_cube_tosses(tmp_path, tmp_path / "out")


@pytest.mark.parametrize(("columns", "jointed"), [(15, True), (12, False)])
def test_tosses_of_a_body_with_a_joint_are_refused_as_what_they_are(
    columns: int, jointed: bool, tmp_path: Path
) -> None:
    torch.save(torch.zeros(121, columns), tmp_path / "0.pt")
    with pytest.raises(ValueError, match=rf"expected a tensor \(T, 13\) .* found \(121, {columns}\)") as caught:
        import_cube_tosses(tmp_path, tmp_path / "out")
    assert ("15 columns are those of a body with a joint" in str(caught.value)) == jointed
