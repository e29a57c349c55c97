"""What is read of recordings for a diagnosis, and the part that each trajectory plays in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from diagnosis.sets import config
from physid.data import Recording, RecordingSet, trajectory_path, write_scene, write_sums, write_trajectory
from physid.data.reading import ECHO, FILE, Reading, write_reading
from physid.diagnosis.inputs import load_observations, read_inputs
from physid.diagnosis.inputs.observations import require_same_scene
from physid.diagnosis.settings.inputs import RoleSettings
from physid.diagnosis.settings.settings import Settings

MOST = RoleSettings(probes_from=100)


def written(
    folder: Path, splits: Sequence[str | None], protocols: Sequence[str | None] = (), frames: Sequence[int] = ()
) -> RecordingSet:
    """Write blocks that slide along x, each as far as its number says."""
    write_scene(folder, config().known_scene())
    height = config().true_scene().bodies[0].size[2] / 2
    for index, split in enumerate(splits):
        count = frames[index] if frames else 12
        pose = np.zeros((count, 1, 7))
        pose[..., 2], pose[..., 6] = height, 1.0
        pose[:, 0, 0] = (index + 1) * np.linspace(0, 0.1, count)
        wrench = np.zeros((count, 1, 6))
        wrench[..., 3] = index + 1
        protocol = protocols[index] if protocols else "rich"
        write_trajectory(trajectory_path(folder, index), Recording(pose, wrench, split=split, protocol=protocol))
    write_sums(folder)
    return RecordingSet(folder)


@pytest.mark.parametrize(
    ("splits", "roles"),
    [
        ([None] * 7, ["fit", "select", "same", "fit", "select", "same", "fit"]),
        (["train", "val", "test"], ["fit", "select", "same"]),
        (["fit", "select", "report_same", "report_transfer"], ["fit", "select", "same", "transfer"]),
        (["train"] * 7, ["fit", "fit", "select", "fit", "fit", "select", "fit"]),
        (["train", "test", "train", "train"], ["fit", "same", "fit", "select"]),
        (["train", None, "val", None], ["fit", "fit", "select", "select"]),
    ],
)
def test_a_split_says_which_part_a_trajectory_plays_and_without_one_they_take_turns(
    splits: list[str | None], roles: list[str], tmp_path: Path
) -> None:
    found = load_observations(written(tmp_path / "set", splits))
    assert list(found.roles) == roles
    fitted = [role in ("fit", "select", "probe") for role in roles]
    assert found.fitted.tolist() == fitted
    same, transfer = found.reported
    shown = "same" if "same" in roles else "select"
    assert same.tolist() == [role == shown for role in roles]
    assert transfer.tolist() == [role == "transfer" for role in roles]


@pytest.mark.parametrize("every", [2, 3, 4])
def test_of_so_many_fitted_ones_the_last_selects(every: int, tmp_path: Path) -> None:
    found = load_observations(written(tmp_path / "set", ["fit"] * 8), roles=RoleSettings(select_every=every))
    assert [k + 1 for k, role in enumerate(found.roles) if role == "select"] == list(range(every, 9, every))


def test_held_out_trajectories_of_another_protocol_than_most_fitted_ones_are_for_the_transfer(tmp_path: Path) -> None:
    splits = ["fit", "fit", "select", "fit", "report_same", "report_same", "report_same"]
    protocols = ["paper", "rich", "rich", "rich", "rich", "paper", "steps"]
    found = load_observations(written(tmp_path / "set", splits, protocols), roles=MOST)
    assert found.roles[4:] == ("same", "transfer", "transfer")
    assert found.roles[:4] == ("fit", "fit", "select", "fit"), "fitted ones stay"
    splits[-1] = "report_transfer"
    said = load_observations(written(tmp_path / "said", splits, protocols), roles=MOST)
    assert said.roles[4:] == ("same", "same", "transfer"), "a split that is given decides"


@pytest.mark.parametrize("count", [3, 4, 5])
def test_every_second_trajectory_of_the_other_protocol_joins_the_fit_where_there_are_enough(
    count: int, tmp_path: Path
) -> None:
    splits = ["fit", "select", "report_same", *["report_transfer"] * count]
    found = load_observations(written(tmp_path / "set", splits), roles=RoleSettings(probes_from=4))
    expected = ["transfer"] * count if count < 4 else ["probe", "transfer", "probe", "transfer", "probe"][:count]
    assert list(found.roles[3:]) == expected
    assert found.fitted[3:].tolist() == [role == "probe" for role in expected]


def test_a_second_set_is_for_the_transfer_and_shorter_trajectories_end_in_frames_that_nobody_saw(
    tmp_path: Path,
) -> None:
    first = written(tmp_path / "one", ["fit", "select", "report_same"], frames=[9, 12, 10])
    second = written(tmp_path / "two", ["fit", "fit"], frames=[14, 8])
    found = load_observations(first, second)
    assert found.roles == ("fit", "select", "same", "transfer", "transfer")
    assert found.indices == (0, 1, 2, 3, 4)
    assert [(each.folder.name, index) for each, index in found.sources] == [
        ("one", 0), ("one", 1), ("one", 2), ("two", 0), ("two", 1)
    ]  # fmt: skip
    assert found.folder == tmp_path / "one"
    assert found.title == "one"
    assert found.error is None
    counts, grid = [9, 12, 10, 14, 8], found.timeline.grid
    assert found.pose.shape == (5, 14, 1, 7)
    assert found.present[..., 0].sum(1).tolist() == counts
    assert bool(found.present.diff(dim=1).le(0).all()), "what nobody saw is at the end"
    for row, count in enumerate(counts):
        own = row if row < 3 else row - 3
        assert torch.equal(found.pose[row, count:], found.pose[row, count - 1 : count].expand(14 - count, 1, 7))
        assert float(found.pose[row, count - 1, 0, 0]) == pytest.approx((own + 1) * 0.1)
        steps = int(grid.count[row])
        assert steps == count - 1
        assert grid.wrench[row, :steps, 0, 3].tolist() == [own + 1] * steps
        assert grid.frame_step[row, :count].tolist() == list(range(count))
        assert found.timeline.time[row].diff()[count - 1 :].tolist() == [0.0] * (14 - count)
    few = load_observations(first, second, limit=2)
    assert few.roles == ("fit", "select", "transfer", "transfer")
    assert [index for _, index in few.sources] == [0, 1, 0, 1]
    assert torch.equal(few.pose[:2, :12], found.pose[:2, :12])


def test_a_transfer_set_is_of_the_same_bodies_ground_gravity_and_rate(tmp_path: Path) -> None:
    one = written(tmp_path / "one", ["fit", "select", "report_same"])
    other = written(tmp_path / "two", ["fit"])
    require_same_scene(one, other)
    scene = one.scene
    write_scene(tmp_path / "two", replace(scene, unknown=()))
    require_same_scene(one, RecordingSet(tmp_path / "two"))
    for name, value in (("gravity", (0.0, 0.0, -9.8)), ("time_step", 0.01)):
        write_scene(tmp_path / "two", replace(scene, **{name: value}))
        with pytest.raises(ValueError, match=f"expected the {name} of"):
            require_same_scene(one, RecordingSet(tmp_path / "two"))
    heavier = replace(scene.bodies[0], mass=2 * scene.bodies[0].mass)
    write_scene(tmp_path / "two", replace(scene, bodies=(heavier,)))
    require_same_scene(one, RecordingSet(tmp_path / "two"))


def test_what_a_diagnosis_starts_from_is_read_together(tmp_path: Path) -> None:
    recordings = written(tmp_path / "set", ["fit", "fit", "select", "report_same"], frames=[40] * 4)
    settings = Settings().changed({"roles.select_every": 2})
    found = read_inputs(recordings, None, None, [], 3, settings)
    assert found.observations.roles == ("fit", "fit", "select")
    assert found.model.unknown == recordings.scene.unknown
    names = [kind.name for kind in found.candidates]
    assert "viscous_drag" in names
    known = {"model": {"engine": {"effects": {"viscous_drag": {"coefficient": 0.3}}}}}
    beside = read_inputs(recordings, None, known, [], None, settings)
    assert [effect.name for effect in beside.model.effects] == ["viscous_drag"]
    assert [kind.name for kind in beside.candidates] == [name for name in names if name != "viscous_drag"]


@pytest.mark.parametrize("lacks", [FILE, ECHO])
def test_poses_of_films_and_poses_of_a_sensor_are_not_diagnosed_together(lacks: str, tmp_path: Path) -> None:
    sets = [written(tmp_path / name, ["fit", "select", "report_same"]) for name in ("one", "two")]
    for one in sets:
        write_reading(one.folder, Reading("films", "tracker", "", 0.0, 1e-3, "key"))
        written(one.folder / ECHO, ["fit", "select", "report_same"])
    path = tmp_path / "two" / lacks
    path.rename(tmp_path / "aside")
    with pytest.raises(ValueError, match=r"two: expected poses that were read from films, as in the other set"):
        load_observations(*sets)
    (tmp_path / "one" / FILE).unlink()
    (tmp_path / "two" / FILE).unlink(missing_ok=True)
    assert load_observations(*sets).error is None
