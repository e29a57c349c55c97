"""Logs with other units, axes, orders and clocks become the motion that they are logs of."""

import dataclasses
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from tests.data.logs import Truth, write_csv, write_y_up

from physid.cli import main
from physid.data import Recording, RecordingSet
from physid.data.files import UNFINISHED
from physid.data.importers.convert import import_logs
from physid.data.importers.finding import find_logs
from physid.data.importers.guessing import guess_mapping
from physid.data.importers.mapping_files import read_mapping
from physid.data.observations.trajectories import load_trajectories
from physid.inspection.kinematics import lowest_corner

BODY = {"size": [0.1, 0.1, 0.05], "mass": 0.4, "friction": 0.3}
COLUMNS = {"time": "t", "position": ["x", "y", "z"], "quaternion": ["qx", "qy", "qz", "qw"]} | BODY


def same(recording: Recording, truth: Truth, within: float = 1e-9) -> bool:
    """Return whether a recording is that motion; q and -q are the same rotation."""
    assert recording.pose is not None
    assert recording.time is not None
    turn = Rotation.from_quat(recording.pose[:, 0, 3:])
    return bool(
        np.allclose(recording.time, truth.time, atol=within)
        and np.allclose(recording.pose[:, 0, :3], truth.place, atol=within)
        and (turn * truth.turn.inv()).magnitude().max() < 1e-7
    )


def imported(folder: Path, files: list[Path], **values: Any) -> Recording:
    """Import and read the first trajectory."""
    import_logs(files, COLUMNS | values, folder / "out")
    return RecordingSet(folder / "out").read(0)


def plain(folder: Path, truth: Truth, **changed: Any) -> Path:
    """Write a log in SI, z up; columns may be changed."""
    columns = dict(
        zip(
            ["t", "x", "y", "z", "qx", "qy", "qz", "qw"],
            [truth.time, *truth.place.T, *truth.turn.as_quat().T],
            strict=True,
        )
    )
    columns |= changed
    return write_csv(folder / "log.csv", list(columns), list(columns.values()))


def test_one_command_converts_millimetres_w_first_y_up_jitter_gaps_and_forces_at_500_hz(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    truths = [Truth.of(seed) for seed in range(3)]
    for index, truth in enumerate(truths):
        write_y_up(tmp_path / "logs", truth, f"run_{index}")
    words = [
        "import", "csv", str(tmp_path / "logs"), "--out", str(tmp_path / "set"), "time=t", "position=[x, y, z]",
        "quaternion=[qw, qx, qy, qz]", "units.position=mm", "axes=y-up", "size=[0.1, 0.1, 0.05]", "mass=0.4",
        "force=[fx, fy, fz]", "forces.file={stem}_forces.csv", "forces.time=t",
    ]  # fmt: skip
    assert main(words) == 0
    said = capsys.readouterr().out
    assert "3 trajectories" in said
    assert "time_step: 0.01 s (100 frames per second), as the stamps show" in said
    found = RecordingSet(tmp_path / "set")
    assert found.scene.time_step == pytest.approx(0.01)
    assert found.scene.unknown == ("block.friction",)
    for truth, recording in zip(truths, found, strict=True):
        assert same(recording, truth)
        assert recording.wrench is not None
        assert recording.wrench_time is not None
        assert np.allclose(recording.wrench[:, 0, 3:], truth.force, atol=1e-12)
        assert np.allclose(recording.wrench_time, truth.force_time, atol=1e-12)
    load_trajectories(found)
    assert not caplog.records


def test_logs_of_forces_that_a_pattern_matches_are_no_logs_of_poses(tmp_path: Path) -> None:
    for index in (2, 10):
        write_y_up(tmp_path, Truth.of(index), f"run_{index}")
    for sources in ([tmp_path], [tmp_path / "run_*.csv"], sorted(tmp_path.glob("*.csv"))):
        found = find_logs(sources, "csv", "{stem}_forces.csv")
        assert {one.name for one in found} == {"run_2.csv", "run_10.csv"}
    assert [one.name for one in find_logs([tmp_path], "csv", "*_forces.csv")] == ["run_2.csv", "run_10.csv"]


@pytest.mark.parametrize("kind", ["euler", "EULER", "matrix", "rotation_vector", "wxyz"])
def test_orientations_may_be_written_in_any_way(tmp_path: Path, kind: str) -> None:
    truth = Truth.of()
    columns = {
        "euler": (
            np.rad2deg(truth.turn.as_euler("xyz")),
            {"euler": list("abc"), "euler_order": "xyz", "units": {"angle": "deg"}},
        ),
        "EULER": (truth.turn.as_euler("ZYX"), {"euler": list("abc"), "euler_order": "ZYX"}),
        "matrix": (truth.turn.as_matrix().reshape(-1, 9), {"matrix": list("abcdefghi")}),
        "rotation_vector": (truth.turn.as_rotvec(), {"rotation_vector": list("abc")}),
        "wxyz": (np.roll(truth.turn.as_quat(), 1, 1), {"quaternion": list("abcd"), "order": "wxyz"}),
    }
    values, mapping = columns[kind]
    log = plain(tmp_path, truth, **dict(zip("abcdefghi", values.T, strict=False)))
    assert same(imported(tmp_path, [log], **{"quaternion": None} | mapping), truth, 1e-9)


@pytest.mark.parametrize("sequence", ["z", "zx"])
def test_few_angles_are_enough_for_a_body_that_turns_about_few_axes(tmp_path: Path, sequence: str) -> None:
    truth = Truth.of()
    angles = np.stack([truth.time, 0.3 * truth.time**2], 1)[:, : len(sequence)]
    turned = dataclasses.replace(truth, turn=Rotation.from_euler(sequence, angles))
    log = plain(tmp_path, truth, **dict(zip("ab", angles.T, strict=False)))
    found = imported(tmp_path, [log], quaternion=None, euler=list("ab")[: len(sequence)], euler_order=sequence)
    assert same(found, turned)


def test_a_left_handed_frame_is_mirrored_with_its_torques(tmp_path: Path) -> None:
    truth = Truth.of()
    matrix = truth.turn.as_matrix()
    swap = np.array([[1.0, 0, 0], [0, 0, 1], [0, 1, 0]])  # y and z change places: left-handed, y up
    mirrored = swap @ matrix @ np.diag([1, 1, -1.0])  # the same box, whose own z axis is mirrored, too
    quaternion = Rotation.from_matrix(mirrored).as_quat()
    columns = dict(zip(["qx", "qy", "qz", "qw"], quaternion.T, strict=True))
    columns |= dict(zip("xyz", (truth.place @ swap.T).T, strict=True))
    force, arm = np.stack([truth.time, truth.time**2, -truth.time], 1), np.array([0.1, 0.2, 0.3])
    columns |= dict(zip(["fx", "fy", "fz"], (force @ swap.T).T, strict=True))
    columns |= dict(zip(["mx", "my", "mz"], np.cross(swap @ arm, force @ swap.T).T, strict=True))
    found = imported(
        tmp_path,
        [plain(tmp_path, truth, **columns)],
        axes="left-handed-y-up",
        force=["fx", "fy", "fz"],
        torque=["mx", "my", "mz"],
    )
    assert same(found, truth)
    assert found.wrench is not None
    assert np.allclose(found.wrench[:, 0], np.concatenate([np.cross(arm, force), force], 1))


def test_a_tracked_point_beside_the_centre_is_moved_to_it(tmp_path: Path) -> None:
    truth, point = Truth.of(), np.array([0.02, 0.0, 0.04])
    marker = truth.place + truth.turn.apply(point)
    found = imported(
        tmp_path, [plain(tmp_path, truth, **dict(zip("xyz", marker.T, strict=True)))], tracked_point=[0.02, 0, 0.04]
    )
    assert same(found, truth)


def test_npz_arrays_of_several_bodies_and_clocks(tmp_path: Path) -> None:
    truth = Truth.of()
    place = np.stack([truth.place, truth.place + np.array([1.0, 0, 0])], 1)
    turn = np.stack([truth.turn.as_quat()] * 2, 1)
    np.savez(tmp_path / "log.npz", t=truth.time * 1e6, pos=place, quat=turn, f=truth.force, ft=truth.force_time)
    bodies = [
        BODY
        | {
            "name": name,
            "position": [f"pos[{n},{k}]" for k in range(3)],
            "quaternion": [f"quat[{n},{k}]" for k in range(4)],
            "order": "xyzw",
        }
        for n, name in enumerate("ab")
    ]
    bodies[1]["force"] = "f"
    import_logs(
        [tmp_path / "log.npz"],
        {"time": "t", "units": {"time": "us", "forces_time": "s"}, "bodies": bodies, "forces": {"time": "ft"}},
        tmp_path / "out",
    )
    found = RecordingSet(tmp_path / "out").read(0)
    assert found.pose is not None
    assert np.allclose(found.pose[..., :3], place)
    assert found.wrench is not None
    assert np.array_equal(found.wrench[:, 1, 3:], truth.force)
    assert not found.wrench[:, 0].any()


@pytest.mark.parametrize(
    ("header", "units", "step"),
    [
        ("t", {"time": "ms"}, 1e-3),
        ("t_us", {"time": "ms"}, 1e-6),
        ("t [us]", {"time": "ms"}, 1e-6),
        ("t", {"time": "ms", "forces_time": "s"}, 1.0),
    ],
)
def test_stamps_of_forces_are_in_the_unit_of_the_poses_unless_something_says_otherwise(
    tmp_path: Path, header: str, units: dict[str, str], step: float
) -> None:
    time = np.arange(60) / 100
    write_csv(tmp_path / "log.csv", ["t", "x", "y", "z"], [time * 1e3, time, 0 * time, 0 * time + 0.1])
    write_csv(tmp_path / "log_forces.csv", [header, "fx", "fy", "fz"], [time / step, time, 0 * time, 0 * time])
    forces = {"file": "{stem}_forces.csv", "time": header.partition(" ")[0]}
    body = BODY | {"position": ["x", "y", "z"], "orientation": "none", "force": ["fx", "fy", "fz"]}
    import_logs([tmp_path / "log.csv"], {"time": "t", "units": units, "forces": forces, **body}, tmp_path / "out")
    found = RecordingSet(tmp_path / "out").read(0)
    assert found.wrench_time is not None
    assert np.allclose(found.wrench_time, time)


def test_rows_of_one_file_may_hold_poses_or_forces_or_both(tmp_path: Path) -> None:
    every, posed = np.arange(250) / 500, np.arange(250) % 5 == 0
    place = np.where(posed[:, None], np.stack([every, 0 * every, 0 * every + 0.1], 1), np.nan)
    force = np.where((np.arange(250) % 2 == 0)[:, None], np.stack([every, every**2, every**3], 1), np.nan)
    log = write_csv(tmp_path / "log.csv", ["t", "x", "y", "z", "fx", "fy", "fz"], [every, *place.T, *force.T])
    found = imported(tmp_path, [log], quaternion=None, orientation="none", force=["fx", "fy", "fz"])
    assert found.length == 50
    assert found.wrench is not None
    assert found.wrench_time is not None
    assert np.allclose(found.wrench_time, every[::2])
    assert np.allclose(found.wrench[:, 0, 3:], force[::2])


def test_empty_cells_lost_zeros_and_invisible_rows_are_bodies_unseen(tmp_path: Path) -> None:
    truth = Truth.of(missing=0.0)
    place, turn, shown = truth.place.copy(), truth.turn.as_quat(), np.ones(len(truth.time))
    place[10], turn[20], place[20], shown[30] = np.nan, 0.0, 0.0, 0.0
    columns = dict(zip("xyz", place.T, strict=True)) | dict(zip(["qx", "qy", "qz", "qw"], turn.T, strict=True))
    log = plain(tmp_path, truth, **columns, shown=shown)
    found = imported(tmp_path, [log], lost="zeros", visible="shown")
    assert np.flatnonzero(~found.seen[:, 0]).tolist() == [10, 20, 30]


def test_one_file_may_hold_several_trajectories_and_be_dealt_to_splits(tmp_path: Path) -> None:
    truth = Truth.of()
    three = np.repeat(np.arange(3.0), len(truth.time))
    columns = {
        name: np.tile(values, 3)
        for name, values in zip(
            ["t", "x", "y", "z", "qx", "qy", "qz", "qw"],
            [truth.time, *truth.place.T, *truth.turn.as_quat().T],
            strict=True,
        )
    }
    log = write_csv(tmp_path / "log.csv", [*columns, "episode"], [*columns.values(), three])
    import_logs([log], COLUMNS | {"trajectory": "episode", "split": {"train": 2, "test": 1}}, tmp_path / "out")
    found = RecordingSet(tmp_path / "out")
    assert len(found) == 3
    assert sorted(found.splits()) == ["test", "train", "train"]  # type: ignore[type-var]
    assert all(same(one, truth) for one in found)


@pytest.mark.parametrize("offset", [0.0, 0.01])
def test_forces_of_several_trajectories_without_stamps_begin_with_each(tmp_path: Path, offset: float) -> None:
    time = np.arange(30.0)
    columns = dict.fromkeys(("x", "y", "z", "fy", "fz"), 0 * time) | {"fx": time, "trial": (time >= 10) * 1.0}
    log = write_csv(tmp_path / "log.csv", list(columns), list(columns.values()))
    mapping = {"rate": 100, "position": ["x", "y", "z"], "orientation": "none", "force": ["fx", "fy", "fz"], **BODY}
    forces = {"rate": 100, "offset": offset}
    import_logs([log], mapping | {"trajectory": "trial", "forces": forces}, tmp_path / "out")
    found = RecordingSet(tmp_path / "out")
    for one, first in ((found.read(0), 0), (found.read(1), 10)):
        assert one.wrench is not None
        assert np.allclose(one.wrench_stamps(0.01), 0.01 * np.arange(len(one.wrench)) + offset)
        assert one.wrench[0, 0, 3] == first


@pytest.mark.parametrize("kind", ["csv", "npz"])
def test_rows_without_a_number_are_of_no_trajectory_and_said_to_be_left_out(tmp_path: Path, kind: str) -> None:
    truth = Truth.of()
    count = len(truth.time)
    pause = np.arange(1, 21) / 60
    names = ["t", "x", "y", "z", "qx", "qy", "qz", "qw", "push", "fx", "fy", "fz"]
    one = [truth.time, *truth.place.T, *truth.turn.as_quat().T]
    start, columns = 0.0, [[] for _ in names]  # type: ignore[var-annotated]
    for number in (4.0, 2.0):
        hand = [np.full(20, value) for value in (0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 1.0, np.nan, 9.0, 9.0, 9.0)]
        rows = [start + one[0], *one[1:], *(np.full(count, value) for value in (number, number, 0.0, 0.0))]
        for column, part, beside in zip(columns, rows, [start + truth.time[-1] + pause, *hand], strict=True):
            column += [part, beside]
        start += float(truth.time[-1]) + 0.5
    columns = [np.concatenate(each) for each in columns]
    log = tmp_path / f"log.{kind}"
    if kind == "csv":
        write_csv(log, names, columns)
    else:
        np.savez(log, **dict(zip(names, columns, strict=True)))
    mapping = COLUMNS | {"trajectory": "push", "force": ["fx", "fy", "fz"]}
    notes = import_logs([log], mapping, tmp_path / "out").notes
    assert any("40 rows belong to no trajectory, for push is empty there: left out" in one for one in notes)
    found = RecordingSet(tmp_path / "out")
    assert [one.length for one in found] == [count, count]
    assert all(same(one, truth) for one in found)
    assert [set(one.wrench[..., 3].ravel().tolist()) for one in found] == [{4.0}, {2.0}]  # type: ignore[union-attr]


def test_a_column_of_numbers_that_is_empty_is_refused(tmp_path: Path) -> None:
    truth = Truth.of()
    values = [truth.time, *truth.place.T, *truth.turn.as_quat().T, np.full(len(truth.time), np.nan)]
    log = write_csv(tmp_path / "log.csv", ["t", "x", "y", "z", "qx", "qy", "qz", "qw", "push"], values)
    with pytest.raises(ValueError, match="expected numbers of trajectories in push, found nothing but empty cells"):
        import_logs([log], COLUMNS | {"trajectory": "push"}, tmp_path / "out")


def episodes(folder: Path, rows: tuple[int, int], named: bool, stamped: bool = True) -> list[Path]:
    """Write two episodes, one after the other, and their forces (1 N and 9 N) in a log of their own."""
    frames = np.arange(30) / 100
    place = np.tile(np.stack([frames, 0 * frames, 0 * frames + 0.025], 1), (2, 1))
    which = np.repeat([3.0, 7.0], len(frames))
    upright = [0 * which] * 3 + [0 * which + 1]
    names = ["t", "x", "y", "z", "qx", "qy", "qz", "qw", "episode"]
    log = write_csv(folder / "log.csv", names, [np.tile(frames, 2), *place.T, *upright, which])
    push, time = np.repeat([1.0, 9.0], rows), np.concatenate([np.arange(count) / 100 for count in rows])
    columns = ({"t": time} if stamped else {}) | {"fx": push, "fy": 0 * push, "fz": 0 * push}
    columns |= {"episode": np.repeat([3.0, 7.0], rows)} if named else {}
    write_csv(folder / "log_forces.csv", list(columns), list(columns.values()))
    return [log]


FORCES = {"force": ["fx", "fy", "fz"], "trajectory": "episode"}


@pytest.mark.parametrize("forces", [{"time": "t"}, {"rate": 100.0}], ids=str)
@pytest.mark.parametrize("header", ["episode", "episode [1]"])
@pytest.mark.parametrize("rows", [(20, 20), (25, 20), (20, 40)], ids=str)
def test_a_log_of_forces_that_numbers_trajectories_gives_each_its_own(
    rows: tuple[int, int], header: str, forces: dict[str, Any], tmp_path: Path
) -> None:
    logs, where = episodes(tmp_path, rows, named=True, stamped="time" in forces), {"file": "{stem}_forces.csv"}
    for log in tmp_path.glob("*.csv"):
        log.write_text(log.read_text().replace("episode", header))
    import_logs(logs, COLUMNS | FORCES | {"forces": where | forces}, tmp_path / "out")
    for index, (count, push) in enumerate(zip(rows, (1.0, 9.0), strict=True)):
        found = RecordingSet(tmp_path / "out").read(index)
        assert found.wrench is not None
        assert found.wrench[:, 0, 3].tolist() == [push] * count
        assert found.wrench_time == pytest.approx(np.arange(count) / 100)


@pytest.mark.parametrize("rows", [(20, 20), (25, 20), (20, 40)], ids=str)
def test_stamps_of_forces_that_begin_anew_without_a_number_of_the_trajectory_are_refused(
    rows: tuple[int, int], tmp_path: Path
) -> None:
    """Which forces belong to which trajectory cannot be known: both had got those of one."""
    logs, forces = episodes(tmp_path, rows, named=False), {"file": "{stem}_forces.csv", "time": "t"}
    line = rows[0] + 2
    with pytest.raises(ValueError, match=f"log_forces.csv:{line}: expected increasing time stamps, .* runs back"):
        import_logs(logs, COLUMNS | FORCES | {"forces": forces}, tmp_path / "out")


def test_a_trajectory_without_forces_in_the_log_that_numbers_them_is_named(tmp_path: Path) -> None:
    logs = episodes(tmp_path, (20, 20), named=True)
    text = (tmp_path / "log_forces.csv").read_text()
    (tmp_path / "log_forces.csv").write_text(text.replace("7.0\n", "8.0\n"))
    forces = {"file": "{stem}_forces.csv", "time": "t"}
    with pytest.raises(ValueError, match="expected forces of trajectory 7, found none"):
        import_logs(logs, COLUMNS | FORCES | {"forces": forces}, tmp_path / "out")


@pytest.mark.parametrize(
    "text",
    [
        "t,x,y,z\n\nms,cm,cm,cm\n0,50,0,100\n10,60,0,100\n20,70,0,100\n",
        "t,x,y,z\n# a comment\nms,cm,cm,cm\n0,50,0,100\n10,60,0,100\n20,70,0,100\n",
        "# a comment\nt;x;y;z\n0;0,5;0;1\n0,01;0,6;0;1\n0,02;0,7;0;1\n",
        "t\tx\ty\tz\n0\t0.5\t0\t1\n0.01\t0.6\t0\t1\n0.02\t0.7\t0\t1\n",
        "t x y z\n0 0.5 0 1\n0.01 0.6 0 1\n0.02 0.7 0 1\n",
        "\ufefft,x,y,z,\n0,0.5,0,1,\n0.01,0.6,0,1,\n0.02,0.7,0,1,\n",
        "t [ms],x [mm],y [mm],z [mm],note\n0,500,0,1000,a\n10,600,0,1000,b\n20,700,0,1000,\n",
        "t,x,y,z\nms,cm,cm,cm\n0,50,0,100\n10,60,0,100\n20,70,0,100\n",
        "# t x y z\n0 0.5 0 1\n0.01 0.6 0 1\n0.02 0.7 0 1\n",
        "t [MS],x [Mm],y (MM),z_MM\n0,500,0,1000\n10,600,0,1000\n20,700,0,1000\n",
        "t [\N{MICRO SIGN}s],x,y,z\n0,0.5,0,1\n10000,0.6,0,1\n20000,0.7,0,1\n",
        "t [\N{GREEK SMALL LETTER MU}s],x,y,z\n0,0.5,0,1\n10000,0.6,0,1\n20000,0.7,0,1\n",
    ],
)
def test_tables_of_many_kinds_are_read(tmp_path: Path, text: str) -> None:
    (tmp_path / "log.csv").write_text(text, encoding="utf-8")
    found = imported(tmp_path, [tmp_path / "log.csv"], quaternion=None, orientation="none")
    assert found.pose is not None
    assert found.time is not None
    assert np.allclose(found.pose[:, 0, :3], [[0.5, 0, 1], [0.6, 0, 1], [0.7, 0, 1]])
    assert np.allclose(found.time, [0, 0.01, 0.02])


def test_a_mapping_file_and_words_over_it_say_the_same(tmp_path: Path) -> None:
    (tmp_path / "map.yaml").write_text("position: [x, y, z]\nunits: {position: m}\nbodies: [{name: a}, {name: b}]\n")
    found = read_mapping(tmp_path / "map.yaml", ["units.position=mm", "units.time=ms", "bodies.1.mass=2", "time=t"])
    assert found == {
        "position": ["x", "y", "z"],
        "units": {"position": "mm", "time": "ms"},
        "bodies": [{"name": "a"}, {"name": "b", "mass": 2}],
        "time": "t",
    }


def test_an_import_that_fails_leaves_nothing_and_a_corrected_one_runs(tmp_path: Path) -> None:
    good, bad = plain(tmp_path / "a", Truth.of()), plain(tmp_path / "b", Truth.of())
    bad.write_text("\n".join([*bad.read_text().splitlines()[:50], "0.1,2"]))
    with pytest.raises(ValueError, match=r"log.csv:51: expected 8 cells as in the header, found 2"):
        import_logs([good, bad], COLUMNS, tmp_path / "out")
    assert {one.name for one in tmp_path.iterdir()} == {"a", "b"}
    import_logs([good], COLUMNS, tmp_path / "out")
    with pytest.raises(FileExistsError, match="expected a new or an empty folder"):
        import_logs([good], COLUMNS, tmp_path / "out")


def test_an_import_clears_what_a_killed_one_has_left_and_no_folder_of_ones_own(tmp_path: Path) -> None:
    log, part = plain(tmp_path / "a", Truth.of()), tmp_path / "out.part"
    part.mkdir()
    (part / "thesis.txt").touch()
    with pytest.raises(FileExistsError, match=r"out\.part: .*found 'thesis\.txt' and no file .*; rename or delete"):
        import_logs([log], COLUMNS, tmp_path / "out")
    assert (part / "thesis.txt").exists()
    (part / UNFINISHED).touch()
    import_logs([log], COLUMNS, tmp_path / "out")
    names = {"SHA256SUMS", "import.yaml", "recording.yaml", "trajectories"}
    assert {path.name for path in (tmp_path / "out").iterdir()} == names
    assert {path.name for path in tmp_path.iterdir()} == {"a", "out"}


def test_a_long_log_is_read_fast(tmp_path: Path) -> None:
    import time

    rows = 100_000
    table = np.column_stack([np.arange(rows) / 100, np.random.default_rng(0).normal(size=(rows, 3))])
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header="t,x,y,z", comments="", fmt="%.6f")
    start = time.perf_counter()
    found = imported(tmp_path, [tmp_path / "log.csv"], quaternion=None, orientation="none")
    assert found.length == rows
    assert time.perf_counter() - start < 5.0  # [s]; half a second where nothing else runs


def motion(count: int = 60) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return times [s] and places [mm] of a body that slides along x and z, y up."""
    time = np.arange(count) / 100
    return time, np.stack([100 * np.sin(2 * time), np.full(count, 30.0), 50 * time], -1)


def test_columns_that_a_line_names_twice_are_told_apart_by_the_lines_above(tmp_path: Path) -> None:
    """As Motive writes a rigid body: a preamble, what kind of body it is, its name, what is measured, the axes."""
    time, place = motion()
    lines = [
        "Format Version,1.23,Take Name,Take 1,Export Frame Rate,100.000000,Rotation Type,Quaternion",
        "",
        ",Type," + ",".join(["Rigid Body"] * 8),
        ",Name," + ",".join(["block"] * 8),
        ",," + ",".join(["Rotation"] * 4 + ["Position"] * 3 + ["Mean Marker Error"]),
        "Frame,Time (Seconds),X,Y,Z,W,X,Y,Z,",
    ]
    turn = "0,0.099833,0,0.995004"
    rows = [
        f"{100 * t:.0f},{t:.6f},{turn},{x:.4f},{y:.4f},{z:.4f},0.00012"
        for t, (x, y, z) in zip(time, place, strict=True)
    ]
    (tmp_path / "take.csv").write_text("\n".join([*lines, *rows]))
    said = yaml.safe_load(guess_mapping(tmp_path / "take.csv"))
    assert said["time"] == "Time (Seconds)"
    assert said["position"] == ["Position X", "Position Y", "Position Z"]
    assert said["quaternion"] == ["Rotation X", "Rotation Y", "Rotation Z", "Rotation W"]
    assert said["units"]["position"] == "mm"
    known = said | {"size": [0.1, 0.06, 0.1], "mass": 1.0, "unknown": []}
    done = import_logs([tmp_path / "take.csv"], known, tmp_path / "set")
    pose = RecordingSet(done.folder).read(0).pose
    assert pose is not None
    assert np.allclose(pose[:, 0, :3], place[:, [0, 2, 1]] * [1e-3, -1e-3, 1e-3], atol=1e-6)


def test_a_preamble_is_passed_over_and_the_number_of_a_frame_is_no_time(tmp_path: Path) -> None:
    """As Vicon writes a segment: the rate alone in a line, names of bodies over their first column, units below."""
    _, place = motion()
    lines = ["Segments", "100", ",,Lab:Block,,,,,", "Frame,Sub Frame,RX,RY,RZ,TX,TY,TZ", ",,deg,deg,deg,mm,mm,mm"]
    rows = [f"{i + 1},0,0,0,11.46,{x:.4f},{z:.4f},{y:.4f}" for i, (x, y, z) in enumerate(place)]
    (tmp_path / "trial.csv").write_text("\n".join([*lines, *rows]))
    said = yaml.safe_load(guess_mapping(tmp_path / "trial.csv"))
    assert said["rate"] == "FILL_IN"
    assert "time" not in said
    assert said["position"] == ["TX", "TY", "TZ"]
    assert said["euler"] == ["RX", "RY", "RZ"]


@pytest.mark.parametrize(("axes", "up"), [("z-up", 2), ("y-up", 1), ("x-up", 0), ("left-handed-y-up", 1)])
@pytest.mark.parametrize("turned", [False, True])
def test_edges_are_along_the_axes_of_the_body_in_the_log(tmp_path: Path, axes: str, up: int, turned: bool) -> None:
    """A box that is not turned in its log is as high as the edge along the log's axis that is up."""
    time, size = np.arange(20) / 100, (0.1, 0.2, 0.3)
    place = np.zeros((20, 3))
    place[:, up] = size[up] / 2
    columns = {"t": time, "x": place[:, 0], "y": place[:, 1], "z": place[:, 2]}
    words: dict[str, object] = {"time": "t", "position": ["x", "y", "z"], "size": list(size), "mass": 1.0, "axes": axes}
    if turned:
        columns |= {"qx": 0 * time, "qy": 0 * time, "qz": 0 * time, "qw": 0 * time + 1}
    write_csv(tmp_path / "log.csv", list(columns), list(columns.values()))
    words |= {"quaternion": ["qx", "qy", "qz", "qw"]} if turned else {"orientation": "none"}
    import_logs([tmp_path / "log.csv"], words, tmp_path / "out")
    found = RecordingSet(tmp_path / "out")
    pose = found.read(0).pose
    assert pose is not None
    assert np.allclose(lowest_corner(pose[:, 0], found.scene, 0), 0, atol=1e-9)


@pytest.mark.parametrize("names", [("Fx_N", "Fy_N", "Fz_N"), ("force_x_N", "force_y_N", "force_z_N")], ids=str)
def test_a_guess_finds_forces_in_a_log_beside_whose_headers_say_newtons(names: tuple[str, ...], tmp_path: Path) -> None:
    truth = Truth.of()
    plain(tmp_path, truth)
    write_csv(tmp_path / "log_forces.csv", ["t", *names], [truth.force_time, *truth.force.T])
    said = yaml.safe_load(guess_mapping(tmp_path / "log.csv"))
    assert said["forces"]["file"] == "{stem}_forces.csv"
    assert said["force"] == list(names)


@pytest.mark.parametrize("axes", ["z-up", "y-up", "left-handed-z-up"])
@pytest.mark.parametrize("beside", [True, False])
def test_forces_of_a_sensor_that_turns_with_the_body_are_turned_into_the_world(
    beside: bool, axes: str, tmp_path: Path
) -> None:
    """As if each had been logged in the log's world, at its own stamp; of a box that turns steadily."""
    time = np.arange(60) / 60
    turn = Rotation.from_rotvec(np.outer(time, [0.3, -0.4, 2.0]))
    stamps = np.arange(5, 55) / 60 + 0.004 if beside else time
    there = Rotation.from_rotvec(np.outer(stamps, [0.3, -0.4, 2.0]))
    force = np.stack([1 + stamps, 2 - stamps, 0 * stamps + 0.5], 1)
    torque = 0.1 * force[:, [1, 2, 0]]
    place = {name: 0.1 * k + time for k, name in enumerate("xyz")}
    quaternion = dict(zip(["qx", "qy", "qz", "qw"], turn.as_quat().T, strict=True))
    found = []
    for name, one in (("body", Rotation.identity()), ("world", there)):
        pushed = {f"f{c}": v for c, v in zip("xyz", one.apply(force).T, strict=True)}
        pushed |= {f"t{c}": v for c, v in zip("xyz", one.apply(torque).T, strict=True)}
        log = {"t": time, **place, **quaternion} | ({} if beside else pushed)
        write_csv(tmp_path / name / "log.csv", list(log), list(log.values()))
        if beside:
            write_csv(tmp_path / name / "log_forces.csv", ["t", *pushed], [stamps, *pushed.values()])
        forces = {"axes": name} | ({"file": "{stem}_forces.csv", "time": "t"} if beside else {})
        mapping = COLUMNS | {"force": ["fx", "fy", "fz"], "torque": ["tx", "ty", "tz"], "forces": forces, "axes": axes}
        found.append(RecordingSet(import_logs([tmp_path / name / "log.csv"], mapping, tmp_path / f"set_{name}").folder))
    one, other = (each.read(0).wrench for each in found)
    assert one is not None
    assert other is not None
    assert np.allclose(one, other, atol=1e-6)
    assert not np.allclose(one, np.concatenate([torque, force], 1)[:, None], atol=0.1)


@pytest.mark.parametrize("own_rate", [True, False])
def test_forces_of_a_sensor_that_turns_meet_their_attitudes_though_rates_stand_for_stamps(
    own_rate: bool, tmp_path: Path
) -> None:
    time, stamps = np.arange(100) / 100, (np.arange(500) / 500 if own_rate else np.arange(100) / 100)
    turn = Rotation.from_rotvec(np.outer(time, [0.0, 0.0, 2.0]))
    quaternion = dict(zip(["qx", "qy", "qz", "qw"], turn.as_quat().T, strict=True))
    log = {"t": time, **dict.fromkeys("xyz", 0.1 * time), **quaternion}
    write_csv(tmp_path / "log.csv", list(log), list(log.values()))
    write_csv(tmp_path / "log_forces.csv", ["fx", "fy", "fz"], [1 + 0 * stamps, 0 * stamps, 0 * stamps])
    forces: dict[str, object] = {"axes": "body", "file": "{stem}_forces.csv"} | ({"rate": 500} if own_rate else {})
    mapping = COLUMNS | {"time": None, "rate": 100, "force": ["fx", "fy", "fz"], "forces": forces}
    wrench = RecordingSet(import_logs([tmp_path / "log.csv"], mapping, tmp_path / "out").folder).read(0).wrench
    assert wrench is not None
    wanted = np.stack([np.cos(2 * stamps), np.sin(2 * stamps)], 1)[stamps <= time[-1]]
    assert np.allclose(wrench[: len(wanted), 0, 3:5], wanted, atol=1e-9)


def filled_in(folder: Path, log: Path) -> tuple[str, RecordingSet]:
    """Guess a mapping, fill in what no log holds, and import by it; return the text of the mapping and the set."""
    text = guess_mapping(log)
    said = yaml.safe_load(text)
    for one in said.get("bodies", [said]):
        one |= {"size": [0.1, 0.1, 0.05], "mass": 0.4}
    return text, RecordingSet(import_logs([log], said | {"axes": "z-up"}, folder / "out").folder)


def vectors(names: str, shift: float, time: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    """Return three columns, of names that are joined by commas."""
    return dict(zip(names.split(","), (shift + time, 2 * shift - time, shift + 0 * time), strict=True))


UPRIGHT = "qw,qx,qy,qz"


@pytest.mark.parametrize(
    ("place", "torque", "unit"),
    [
        ("x,y,z", "tx,ty,tz", 1.0),
        ("pos_x,pos_y,pos_z", "tx,ty,tz", 1.0),
        ("x [mm],y [mm],z [mm]", "tx [N mm],ty [N mm],tz [N mm]", 1e-3),
        ("tx [mm],ty [mm],tz [mm]", "mx [N mm],my [N mm],mz [N mm]", 1e-3),
    ],
)
@pytest.mark.parametrize("torque_first", [False, True])
def test_torques_that_are_called_as_translations_are_no_place(
    place: str, torque: str, unit: float, torque_first: bool, tmp_path: Path
) -> None:
    time = np.arange(60) / 100
    here = [vectors(place, 0.4, time), vectors(torque, 0.7, time)]
    columns = {"t": time, **(here[1] | here[0] if torque_first else here[0] | here[1])}
    columns |= vectors("fx [N],fy [N],fz [N]" if "[" in place else "fx,fy,fz", 0.9, time)
    columns |= dict(zip(UPRIGHT.split(","), (0 * time + 1, *(0 * time,) * 3), strict=True))
    text, found = filled_in(tmp_path, write_csv(tmp_path / "log.csv", list(columns), list(columns.values())))
    assert "not read" not in text
    one = found.read(0)
    assert one.pose is not None
    assert one.wrench is not None
    assert np.allclose(one.pose[:, 0, :3], unit * np.stack(list(here[0].values()), 1))
    pushed = [*(unit * values for values in here[1].values()), *vectors("a,b,c", 0.9, time).values()]
    assert np.allclose(one.wrench[:, 0], np.stack(pushed, 1))


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("forces", ["fx,fy,fz", "ax,ay,az"])
def test_a_translation_beside_forces_is_a_place_with_a_doubt_where_there_is_no_other(
    forces: str, turned: bool, tmp_path: Path
) -> None:
    time = np.arange(60) / 100
    columns = {"t": time} | vectors("tx,ty,tz", 0.4, time) | vectors(forces, 0.9, time)
    columns |= dict(zip(UPRIGHT.split(","), (0 * time + 1, *(0 * time,) * 3), strict=True)) if turned else {}
    text = guess_mapping(write_csv(tmp_path / "log.csv", list(columns), list(columns.values())))
    assert yaml.safe_load(text)["position"] == ["tx", "ty", "tz"]
    assert ("or are they torques, beside fx, fy, fz?" in text) == (forces == "fx,fy,fz")
    assert "torque" not in yaml.safe_load(text)


@pytest.mark.parametrize("beside", [True, False])
@pytest.mark.parametrize(
    ("names", "seen"),
    [
        ("Fx,Fy,Mz", [0, 1, 5]),
        ("fx,fy", [0, 1]),
        ("force_x", [0]),
        ("ft_fx,ft_fy,ft_tz", [0, 1, 5]),
        ("fx,tau_z", [0, 5]),
    ],
)
def test_forces_in_a_plane_are_those_of_a_log_with_columns_of_zeros(
    names: str, seen: list[int], beside: bool, tmp_path: Path
) -> None:
    time = np.arange(60) / 100
    poses = {"t": time} | vectors("x,y,z", 0.4, time)
    poses |= dict(zip(UPRIGHT.split(","), (0 * time + 1, *(0 * time,) * 3), strict=True))
    wanted = np.zeros((60, 6))  # force and torque, as the names are ordered
    wanted[:, seen] = np.outer(time + 1, np.arange(1, len(seen) + 1))
    forces = dict(zip(names.split(","), wanted[:, seen].T, strict=True))
    parts = {"log": poses, "log_ft": {"ft_stamp": time} | forces} if beside else {"log": poses | forces}
    for name, columns in parts.items():
        write_csv(tmp_path / f"{name}.csv", list(columns), list(columns.values()))
    _, found = filled_in(tmp_path, tmp_path / "log.csv")
    assert np.allclose(found.read(0).wrench[:, 0, [3, 4, 5, 0, 1, 2]], wanted)


def test_a_guess_names_the_logs_beside_in_which_it_finds_no_forces(tmp_path: Path) -> None:
    plain(tmp_path, Truth.of())
    write_csv(tmp_path / "log_load.csv", ["t", "load_1"], [np.arange(3.0), np.arange(3.0)])
    assert "no columns of forces here, nor in log_load.csv; in another file" in guess_mapping(tmp_path / "log.csv")


def test_columns_in_newtons_are_no_place(tmp_path: Path) -> None:
    time = np.arange(60) / 100
    columns = {"t": time} | vectors("x [N],y [N],z [N]", 0.4, time) | vectors("tx [N m],ty [N m],tz [N m]", 0.5, time)
    said = yaml.safe_load(guess_mapping(write_csv(tmp_path / "log.csv", list(columns), list(columns.values()))))
    assert said["position"] == ["FILL_IN"] * 3
    assert said["force"] == ["x [N]", "y [N]", "z [N]"]
    assert said["torque"] == ["tx [N m]", "ty [N m]", "tz [N m]"]


def two_bodies(time: NDArray[np.float64], between: str) -> dict[str, NDArray[np.float64]]:
    """Return poses of A and B."""
    columns = {"t": time}
    for shift, body in enumerate("AB"):
        columns |= vectors(",".join(f"{body}{between}{one}" for one in "xyz"), 0.1 + shift, time)
        columns |= {f"{body}{between}q{one}": (one == "w") + 0 * time for one in "wxyz"}
    return columns


@pytest.mark.parametrize("beside", [False, True])
@pytest.mark.parametrize(
    ("between", "force", "torque"),
    [
        ("_", "A_fx,A_fy,A_fz", "A_tx,A_ty,A_tz"),
        ("_", "A_force_x,A_force_y,A_force_z", "A_torque_x,A_torque_y,A_torque_z"),
        (".", "A.force.x,A.force.y,A.force.z", "A.tau.x,A.tau.y,A.tau.z"),
        ("_", "A_Fx_N,A_Fy_N,A_Fz_N", "A_Mx,A_My,A_Mz"),
        ("_", "A_ft_fx,A_ft_fy,A_ft_fz", "A_ft_tx,A_ft_ty,A_ft_tz"),
    ],
)
@pytest.mark.parametrize("pushed", ["AB", "B", "A"])
def test_each_of_several_bodies_gets_its_own_forces(
    between: str, force: str, torque: str, pushed: str, beside: bool, tmp_path: Path
) -> None:
    """Of the second body, too, and in a log of forces alone; a body without columns gets none."""
    time = np.arange(60) / 100
    poses, forces = two_bodies(time, between), dict[str, NDArray[np.float64]]()
    for body in pushed:
        forces |= vectors(force.replace("A", body), 3.0 + ord(body), time)
    forces |= vectors(torque.replace("A", "B"), 7.0, time) if "B" in pushed else {}
    here = poses if beside else poses | forces
    log = write_csv(tmp_path / "run_00.csv", list(here), list(here.values()))
    if beside:
        write_csv(tmp_path / "run_00_forces.csv", ["t", *forces], [time, *forces.values()])
    text, found = filled_in(tmp_path, log)
    assert "not read" not in text
    assert "on which body" not in text
    assert found.scene.unknown == ("a.friction", "b.friction")
    one = found.read(0)
    assert one.pose is not None
    assert one.wrench is not None
    for index, body in enumerate("AB"):
        assert np.allclose(one.pose[:, index, :3], np.stack([poses[f"{body}{between}{axis}"] for axis in "xyz"], 1))
        acts = np.stack([forces.get(name, 0 * time) for name in force.replace("A", body).split(",")], 1)
        turns = np.stack([forces.get(name, 0 * time) for name in torque.replace("A", body).split(",")], 1)
        assert np.allclose(one.wrench[:, index], np.concatenate([turns, acts], 1))
    said = yaml.safe_load(text)
    assert [("force" in each, "torque" in each) for each in said["bodies"]] == [
        ("A" in pushed, False),
        ("B" in pushed,) * 2,
    ]
    assert said.get("forces") == ({"file": "{stem}_forces.csv", "time": "t"} if beside else None)


@pytest.mark.parametrize("beside", [False, True])
@pytest.mark.parametrize("names", ["fx,fy,fz", "hand_fx,hand_fy,hand_fz"])
def test_forces_of_no_body_in_particular_go_to_the_first_with_a_doubt(names: str, beside: bool, tmp_path: Path) -> None:
    time = np.arange(60) / 100
    forces = vectors(names, 3.0, time)
    poses = two_bodies(time, "_") | ({} if beside else forces)
    log = write_csv(tmp_path / "run.csv", list(poses), list(poses.values()))
    if beside:
        write_csv(tmp_path / "run_forces.csv", ["t", *forces], [time, *forces.values()])
    text, found = filled_in(tmp_path, log)
    assert "force: on which body? no name says" in text
    assert "force" not in yaml.safe_load(text)
    wrench = found.read(0).wrench
    assert wrench is not None
    assert np.allclose(wrench[:, 0, 3:], np.stack(list(forces.values()), 1))
    assert not wrench[:, 1].any()


@pytest.mark.parametrize(
    ("name", "numbers", "stamps", "doubt"),
    [
        ("push", [0, 1, 2], "rise", ""),
        ("Trial #", [4, 7], "rise", ""),
        ("trajectory_index", [2, 1, 0], "rise", ""),
        ("run_id", [0, 1, 2], "run back", ""),
        ("push", [0, 1], "rise", "does it say whether something happens"),
        ("segment", [0, np.nan, 1, np.nan, 2], "rise", "40 rows hold no number"),
        ("rep", [-1, 1, -1, 2, -1, 3], "rise", "one number comes back"),
        ("push", [1], "rise", None),
        ("push", [0, 1, 0, 1], "rise", None),
        ("sequence", list(range(100)), "rise", None),
        ("test", [0.5, 1.5], "rise", None),
        ("status", [0, 1, 2], "rise", None),
        ("trial", [1, 1, 1], "run back", None),
    ],
)
def test_a_column_that_numbers_trajectories_is_guessed(
    name: str, numbers: list[float], stamps: str, doubt: str | None, tmp_path: Path
) -> None:
    """By its name and by long runs of rows of one number; None where it numbers none."""
    rows = 1 if len(numbers) > 20 else 20
    which = np.repeat(np.array(numbers, dtype=float), rows)
    time = np.arange(len(which)) / 100
    time = np.tile(time[:rows], len(numbers)) if stamps == "run back" else time
    columns = {"t": time} | vectors("x,y,z", 0.4, np.arange(len(which)) / 100) | {name: which}
    log = write_csv(tmp_path / "log.csv", list(columns), list(columns.values()))
    text = guess_mapping(log)
    said = yaml.safe_load(text)
    assert said.get("trajectory") == (None if doubt is None else name)
    line = next((one for one in text.splitlines() if one.startswith("trajectory:")), "")
    assert ("not sure" in line) == bool(doubt)
    assert (doubt or "") in line
    if stamps == "run back" and doubt is None:
        assert "# trajectory: FILL_IN" in text
        return
    _, found = filled_in(tmp_path, log)
    known = which[~np.isnan(which)]
    assert len(found) == (len(np.unique(known)) if doubt is not None else 1)
    assert sum(one.length for one in found) == len(known)


def test_of_two_columns_that_number_trajectories_the_finer_one_is_guessed_with_a_doubt(tmp_path: Path) -> None:
    time = np.arange(80) / 100
    columns = {"t": time, "trial": time // 0.4, "push": np.repeat(np.arange(4.0), 20)} | vectors("x,y,z", 0.4, time)
    text = guess_mapping(write_csv(tmp_path / "log.csv", list(columns), list(columns.values())))
    assert yaml.safe_load(text)["trajectory"] == "push"
    assert "or is it trial?" in text


def test_bodies_of_like_names_are_all_kept_and_keep_their_forces(tmp_path: Path) -> None:
    time = np.arange(60) / 60
    columns = {"t": time}
    for number, body in enumerate(("left/cup", "right/cup", "top/cup")):
        columns |= vectors(f"{body}/x,{body}/y,{body}/z", 0.1 * number, time)
        columns |= {f"{body}/q{letter}": np.full(60, letter == "w", dtype=float) for letter in "xyzw"}
    columns |= {f"right/cup/f{letter}": time for letter in "xyz"}
    said = yaml.safe_load(guess_mapping(write_csv(tmp_path / "log.csv", list(columns), list(columns.values()))))
    assert [one["name"] for one in said["bodies"]] == ["cup", "cup_2", "cup_3"]
    assert ["force" in one for one in said["bodies"]] == [False, True, False]
    assert said["unknown"] == ["cup.friction", "cup_2.friction", "cup_3.friction"]


def test_the_unit_of_positions_is_that_of_the_body_that_moves(tmp_path: Path) -> None:
    time = np.arange(60) / 60
    columns = {"t": time}
    for body, size in (("a", 300.0), ("b", 0.5), ("c", np.nan)):
        columns |= {f"{body}_{letter}": size * time for letter in "xyz"}
        columns |= {f"{body}_q{letter}": np.full(60, letter == "w", dtype=float) for letter in "xyzw"}
    text = guess_mapping(write_csv(tmp_path / "log.csv", list(columns), list(columns.values())))
    assert yaml.safe_load(text)["units"]["position"] == "mm"
    assert "positions spread over 295" in text
    assert "nan" not in text


@pytest.mark.filterwarnings("error")
def test_a_guess_looks_at_what_was_seen_and_not_at_frames_or_columns_that_are_empty(tmp_path: Path) -> None:
    steps = np.arange(20)
    known: dict[str, Any] = {"t": steps / 60, "x": 0.01 * steps, "y": 0.02 * steps, "z": np.full(20, np.nan)}
    turned = np.tile([0.99, 0.05, 0.0, np.sqrt(1 - 0.99**2 - 0.05**2)], (20, 1))
    turned[:3] = np.nan  # w comes first, but is lost in the first frames
    columns = {**known, **{f"pose[{k}]": turned[:, k] for k in range(4)}}
    said = yaml.safe_load(guess_mapping(write_csv(tmp_path / "log.csv", list(columns), list(columns.values()))))
    assert said["order"] == "wxyz"
    assert said["axes"] == "x-up", "of those that were seen, x moves least"
    angles = dict.fromkeys(("roll", "pitch", "yaw"), np.full(20, np.nan))
    text = guess_mapping(write_csv(tmp_path / "empty.csv", [*known, *angles], [*known.values(), *angles.values()]))
    assert "nan" not in text


def test_names_in_the_remarks_of_a_proposed_mapping_end_no_line(tmp_path: Path) -> None:
    turns = np.random.default_rng(0).normal(size=(20, 4))
    columns = {
        "t\nmass: 1": np.arange(20) / 100,
        "position\nmass: 2": np.random.default_rng(1).normal(size=(20, 3)),
        "orientation\x1b[2J\nmass: 3": turns / np.linalg.norm(turns, axis=1, keepdims=True),
        "other\r\u2028mass: 4": np.ones(20),
    }
    for name in ("log.npz", "log\nmass: 5 #.npz"):
        np.savez(tmp_path / name, **columns)  # type: ignore[arg-type]
        text = guess_mapping(tmp_path / name)
        assert not [each for each in text.replace("\n", "") if not each.isprintable()]
        assert r"\nmass: 2" in text.partition("lines are not sure")[2], "the remark is there, in one line"
        assert not [line for line in text.splitlines() if re.match(r"\s*mass: \d", line)]
        assert yaml.safe_load(text)["mass"] == "FILL_IN"


def test_whole_forces_of_a_log_beside_come_before_two_columns_that_may_be_something_else(tmp_path: Path) -> None:
    time = np.arange(60) / 100
    poses = {"t": time} | vectors("x,y,z", 0.4, time) | {"fx": 0 * time + 600, "fy": 0 * time + 610}
    poses |= dict(zip(UPRIGHT.split(","), (0 * time + 1, *(0 * time,) * 3), strict=True))
    write_csv(tmp_path / "log.csv", list(poses), list(poses.values()))
    forces = {"ft_stamp": time} | vectors("force_x,force_y,force_z", 0.2, time)
    write_csv(tmp_path / "log_ft.csv", list(forces), list(forces.values()))
    text = guess_mapping(tmp_path / "log.csv")
    assert yaml.safe_load(text)["force"] == ["force_x", "force_y", "force_z"]
