"""The likeliest mistakes of who imports a log: each is answered with file, line and remedy, and nothing is left."""

from __future__ import annotations

import gzip
import re
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation
from tests.data.logs import Truth, write_csv

from physid.cli import main
from physid.data import RecordingSet
from physid.data.importers.convert import import_logs
from physid.data.importers.guessing import guess_mapping
from physid.data.importers.mapping_files import read_mapping
from physid.data.importers.tables.files import read_table
from physid.data.importers.units import canonical, split_header

GOOD: dict[str, Any] = {
    "time": "t",
    "position": ["x", "y", "z"],
    "quaternion": ["qx", "qy", "qz", "qw"],
    "size": [0.1, 0.1, 0.05],
    "mass": 0.4,
    "friction": 0.3,
    "force": ["fx", "fy", "fz"],
}
TRUTH = Truth.of()
FRAMES = len(TRUTH.time)
COLUMNS = dict(
    zip(
        ["t", "x", "y", "z", "qx", "qy", "qz", "qw", "fx", "fy", "fz"],
        [TRUTH.time, *TRUTH.place.T, *TRUTH.turn.as_quat().T, *np.ones((3, FRAMES))],
        strict=True,
    )
)


def changed(name: str, row: int, value: float) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return a column with one other value."""
    values = COLUMNS[name].copy()
    values[row] = value
    return values


# What is wrong, other columns, other keys of the mapping (None leaves one out), and the answer.
MISTAKES: list[tuple[str, dict[str, Any], dict[str, Any], str]] = [
    ("a column that is not there", {}, {"position": ["x", "y", "height"]}, 'no column "height"'),
    ("a renamed column", {}, {"time": "tt"}, 'no column "tt"; did you mean "t"'),
    (
        "a renamed column that looks like another",
        {"pos_x": COLUMNS["x"], "pos_z": COLUMNS["z"]},
        {"position": ["position_x", "y", "z"]},
        r'no column "position_x"; did you mean "pos_.*"\? There are t, x, y, z, .*, pos_x, pos_z',
    ),
    ("a list without brackets", {}, {"position": "x,y,z"}, r'no column "x,y,z"; .* in brackets: \[x, y, z\]'),
    (
        "degrees without a unit",
        {"yaw": np.linspace(-170.0, 170.0, FRAMES)},
        {"quaternion": None, "euler": ["yaw"], "euler_order": "z"},
        r"log.csv:2: expected angles in radians, .* found 170, .* units.angle=deg, if they are radians .*=rad",
    ),
    ("capital letters", {}, {"position": ["X", "y", "z"]}, 'no column "X"; did you mean "x"'),
    ("an unknown key", {}, {"positon": ["x", "y", "z"]}, 'unknown key "positon"; did you mean "position"'),
    ("no position", {}, {"position": None}, r"missing position: the columns of its centre"),
    ("no size", {}, {"size": None}, r"missing size: its edges, say \[0.1, 0.1, 0.05\]"),
    ("no mass", {}, {"mass": None}, "missing mass: in kg; a first guess where it is unknown"),
    ("no clock", {}, {"time": None}, "missing time, the column of stamps; .* give rate"),
    ("a rate and a time step", {}, {"rate": 100, "time_step": 0.01}, "expected rate or time_step, found both"),
    ("no orientation", {}, {"quaternion": None}, "expected one of quaternion, .* orientation: none"),
    ("two orientations", {}, {"matrix": ["x"] * 9}, "expected one of .* found quaternion and matrix"),
    ("three columns of a quaternion", {}, {"quaternion": ["qx", "qy", "qz"]}, "quaternion: expected 4 columns, got 3"),
    ("two of a position", {}, {"position": ["x", "y"]}, "position: expected 3 columns, got 2"),
    ("an order against the names", {}, {"order": "wxyz"}, "order says wxyz, but the columns are qx, qy, qz, qw"),
    (
        "names without an order",
        dict.fromkeys("abcd", np.full(FRAMES, 0.5)),
        {"quaternion": list("abcd")},
        "expected order: xyzw or wxyz",
    ),
    ("an order that is none", {}, {"order": "wxzy"}, "order: expected 'xyzw' or 'wxyz', found 'wxzy'"),
    (
        "angles for a quaternion",
        {"qx": np.full(FRAMES, 30.0)},
        {},
        r"log.csv:2: expected a unit quaternion .* are these angles",
    ),
    (
        "zeros for a lost body",
        {n: changed(n, 7, 0.0) for n in ("qx", "qy", "qz", "qw")},
        {},
        r"log.csv:9: .* found zeros; .* lost: zeros",
    ),
    (
        "euler angles without an order",
        {},
        {"quaternion": None, "euler": ["qx", "qy", "qz"]},
        "euler_order: expected one letter",
    ),
    ("an unknown unit", {}, {"units": {"position": "milimeter"}}, 'units.position: unknown unit "milimeter"'),
    ("a unit of something else", {}, {"units": {"time": "mm"}}, 'units.time: unknown unit "mm"'),
    ("a quantity that has no unit", {}, {"units": {"length": "mm"}}, 'units: unknown key "length"'),
    (
        "units that contradict each other",
        {"x [mm]": COLUMNS["x"]},
        {"position": ["x [mm]", "y", "z"], "units": {"position": "m"}},
        "says mm, the mapping says units.position: m; correct",
    ),
    (
        "a column of another quantity",
        {"x [deg]": COLUMNS["x"]},
        {"position": ["x [deg]", "y", "z"]},
        r'column "x \[deg\]" is in deg, which is no unit of position',
    ),
    ("axes that are none", {}, {"axes": "x y y"}, "axes: expected the log's axes that are the world's x, y and z"),
    ("a frame that nobody knows", {}, {"axes": "yup"}, 'did you mean "y-up"'),
    (
        "time that runs back",
        {"t": changed("t", 50, 0.0)},
        {},
        r"log.csv:52: expected increasing time stamps, found time that runs .* trajectory=",
    ),
    ("a doubled stamp", {"t": changed("t", 50, COLUMNS["t"][49])}, {}, r"log.csv:52: .* the same stamp again"),
    ("a stamp that is missing", {"t": changed("t", 50, np.nan)}, {}, r"log.csv:52: expected a time stamp, found none"),
    (
        "milliseconds for seconds",
        {"t": COLUMNS["t"] * 1000},
        {"rate": 100},
        "these are milliseconds: divide the stamps by 1000",
    ),
    (
        "numbers of frames for seconds",
        {"t": np.arange(float(FRAMES))},
        {"rate": 100},
        "these count frames: leave `time` out",
    ),
    (
        "another rate",
        {},
        {"rate": 60},
        r"expected about 60 frames per second .* found 100.* write time_step: 0.0099993 into",
    ),
    ("half a force", {"fy": changed("fy", 3, np.nan)}, {}, r"log.csv:5: expected all components of the forces or none"),
    (
        "a log of forces that is not there",
        {},
        {"forces": {"file": "forces.csv"}},
        r"forces.csv: expected a log of forces \(forces.file\), found no such file",
    ),
    (
        "a parameter of no body",
        {},
        {"unknown": ["box.friction"]},
        'unknown parameter "box.friction"; did you mean "block.friction"',
    ),
    ("a size of zero", {}, {"size": [0.1, 0.1, 0.0]}, "block.size must be positive edge lengths"),
    (
        "a mapping that is not filled in",
        {},
        {"mass": "FILL_IN"},
        "mass: expected a finite number, found 'FILL_IN'",
    ),
    ("a split that is none", {}, {"split": {"training": 1}}, 'unknown split "training"; did you mean "train"'),
    (
        "a body beside bodies",
        {},
        {"bodies": [{"name": "a"}]},
        "expected what is of a body under bodies, found .*position",
    ),
    ("a ground that is not of length one", {}, {"ground": {"normal": [0, 0, 2]}}, "ground.normal must have length 1"),
    ("a key of lost that is none", {}, {"lost": "-1"}, "lost: expected 'nan' or 'zeros', found '-1'"),
    ("a line before the first", {}, {"header": 0}, "mapping: header: expected a number of at least 1, found 0"),
    ("a rate of zero", {}, {"time": None, "rate": 0}, "mapping: rate: expected a number above 0, found 0"),
    ("an unknown key of forces", {}, {"forces": {"ofset": 1}}, 'forces: unknown key "ofset"; did you mean "offset"'),
    ("a unit that is a number", {}, {"units": {"time": 3}}, "units.time: expected a text, found 3"),
    (
        "bodies that are no list",
        {},
        {**dict.fromkeys(GOOD), "bodies": 3, "time": "t"},
        "bodies: expected a list, found",
    ),
    (
        "angles of joints for a position",
        {f"joint[{n}]": COLUMNS["x"] for n in range(6)},
        {"position": ["joint"]},
        r"expected 3 columns for joint, found 6: joint\[0\], .* list the 3 .* not angles of joints",
    ),
    (
        "bodies on several clocks and no column of stamps",
        {},
        {"time": None, "rate": 100, "clock": "t"},
        "expected time",
    ),
    (
        "a header with a unit that is none",
        {"x [cubits]": COLUMNS["x"]},
        {"position": ["x [cubits]", "y", "z"]},
        r'expected a unit of position in "x \[cubits\]", found "cubits".*; say which it is: units.position=m',
    ),
    (
        "angles in another order than the one that is said",
        {"roll": COLUMNS["x"], "pitch": COLUMNS["x"], "yaw": COLUMNS["x"]},
        {"quaternion": None, "euler": ["roll", "pitch", "yaw"], "euler_order": "ZYX"},
        "euler_order says ZYX, but the columns are roll, pitch, yaw",
    ),
    ("constants only", {}, {"position": [0.0, 0.0, 0.0]}, "expected a column among .* found constants only"),
]


@pytest.mark.parametrize(
    ("columns", "values", "message"), [one[1:] for one in MISTAKES], ids=[one[0] for one in MISTAKES]
)
def test_a_mistake_is_answered(tmp_path: Path, columns: dict[str, Any], values: dict[str, Any], message: str) -> None:
    there = COLUMNS | columns
    log = write_csv(tmp_path / "log.csv", list(there), list(there.values()))
    mapping = {name: one for name, one in (GOOD | values).items() if one is not None}
    with pytest.raises((ValueError, FileNotFoundError), match=message):
        import_logs([log], mapping, tmp_path / "out")
    assert [one.name for one in tmp_path.iterdir()] == ["log.csv"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "log.csv: expected rows of numbers, found an empty file"),
        ("t,x,y,z\n", "log.csv: expected rows of numbers under the header, found none"),
        ("t,x,x,z\n1,2,3,4\n", 'expected each column once, found "x" twice; rename one in line 1'),
        ("t,x,y,z\n0,0,0,0\n1,a,0,0\n", 'log.csv:3: expected a number in column "x", found "a"'),
        (
            "t,x,y,z\n0,0,0,0\n1,0,0\n",
            "log.csv:3: expected 4 cells as in the header, found 3; is the last line cut off",
        ),
        ("t,x,y,z\n0,0,0,0\n", "log.csv: expected at least 2 rows with poses, found 1"),
        ("t,x,y,z\n0,,,\n1,,,\n", "log.csv: expected at least 2 rows with poses, found 0"),
    ],
)
def test_a_log_that_holds_nothing_is_answered_with_its_line(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "log.csv").write_text(text)
    body = {"size": [1, 1, 1], "mass": 1, "orientation": "none", "time": "t", "position": ["x", "y", "z"], "rate": 1.0}
    del body["rate"]
    with pytest.raises(ValueError, match=message):
        import_logs([tmp_path / "log.csv"], body, tmp_path / "out")


@pytest.mark.parametrize(
    ("cell", "dated"),
    [("2026-11-27T10:00:00.5", True), ("10:00:01.5", True), ("27.11.2026 10:00", True), ("late", False)],
)
def test_dates_for_stamps_are_answered_with_how_they_become_seconds(tmp_path: Path, cell: str, dated: bool) -> None:
    (tmp_path / "log.csv").write_text(f"t,x,y,z\n{cell},0,0,0\n1,0,0,0\n")
    body = {"size": [1, 1, 1], "mass": 1, "orientation": "none", "time": "t", "position": ["x", "y", "z"]}
    with pytest.raises(ValueError, match=r'log.csv:2: expected a number in column "t"') as said:
        import_logs([tmp_path / "log.csv"], body, tmp_path / "out")
    assert ("convert dates to seconds" in str(said.value)) == dated


@pytest.mark.parametrize(("code", "named"), [("utf-16", "UTF-16"), ("latin1", "LATIN1")])
def test_text_in_another_code_is_answered_with_how_to_convert_it(tmp_path: Path, code: str, named: str) -> None:
    (tmp_path / "log.csv").write_bytes("t,größe\n0,1\n".encode(code))
    with pytest.raises(ValueError, match=f"log.csv: expected text in UTF-8, .*iconv -f {named} -t UTF-8 IN"):
        import_logs([tmp_path / "log.csv"], GOOD, tmp_path / "out")


@pytest.mark.parametrize("unit", ["rad", "deg"])
def test_angles_beyond_a_turn_are_read_in_the_unit_that_is_given(tmp_path: Path, unit: str) -> None:
    yaw = np.linspace(0.0, 20.0, FRAMES)
    there = COLUMNS | {"yaw": yaw if unit == "rad" else np.rad2deg(yaw)}
    log = write_csv(tmp_path / "log.csv", list(there), list(there.values()))
    known = {key: one for key, one in GOOD.items() if key != "quaternion"}
    known |= {"euler": ["yaw"], "euler_order": "z", "units": {"angle": unit}}
    pose = RecordingSet(import_logs([log], known, tmp_path / "out").folder).read(0).pose
    assert pose is not None
    assert np.allclose(np.abs(pose[:, 0, 5]), np.abs(np.sin(yaw / 2)))


def test_forces_in_a_log_beside_that_the_mapping_does_not_name_are_pointed_at(tmp_path: Path) -> None:
    poses = {name: one for name, one in COLUMNS.items() if not name.startswith("f")}
    forces = {name: COLUMNS[name] for name in ("t", "fx", "fy", "fz")}
    log = write_csv(tmp_path / "run_1.csv", list(poses), list(poses.values()))
    beside = write_csv(tmp_path / "run_1_load.csv", list(forces), list(forces.values()))
    with pytest.raises(ValueError, match=r'no column "fx".*run_1_load.csv beside it has it: forces.file={stem}'):
        import_logs([log], GOOD, tmp_path / "out")
    without = {key: one for key, one in GOOD.items() if key != "force"}
    with pytest.raises(
        ValueError,
        match=r'load.csv: no column "x".* looks like a log of something else beside run_1.csv.*alone',
    ):
        import_logs([log, beside], without, tmp_path / "out")
    with pytest.raises(ValueError, match='no column "height"') as said:
        import_logs([log], GOOD | {"position": ["x", "y", "height"]}, tmp_path / "out")
    assert "beside it" not in str(said.value), "no log has it"


@pytest.mark.parametrize(("rate", "noted"), [(100, False), (75, False), (50, True), (400, True)])
def test_poses_without_stamps_that_last_much_longer_than_their_forces_are_noted(
    tmp_path: Path, rate: float, noted: bool
) -> None:
    known = {key: one for key, one in GOOD.items() if key != "time"}
    log = write_csv(tmp_path / "log.csv", list(COLUMNS), list(COLUMNS.values()))
    time = np.arange(FRAMES) / 100
    write_csv(tmp_path / "f.csv", ["t", "fx", "fy", "fz"], [time, *np.ones((3, FRAMES))])
    known |= {"rate": rate, "forces": {"file": "f.csv", "time": "t"}}
    notes = [one for one in import_logs([log], known, tmp_path / "out").notes if "of forces; if both" in one]
    assert len(notes) == noted
    assert all(re.search(r"the true rate is (99|100)", one) for one in notes), notes


@pytest.mark.parametrize(("cells", "decimal"), [(";", ","), (";", "."), ("\t", ","), (" ", ".")])
def test_other_separators_and_decimal_commas_are_no_mistake(tmp_path: Path, cells: str, decimal: str) -> None:
    log = write_csv(tmp_path / "log.csv", list(COLUMNS), list(COLUMNS.values()))
    straight = RecordingSet(import_logs([log], GOOD, tmp_path / "one").folder).read(0)
    log.write_text(log.read_text().replace(",", cells).replace(".", decimal))
    again = RecordingSet(import_logs([log], GOOD, tmp_path / "two").folder).read(0)
    assert straight.pose is not None
    assert again.pose is not None
    assert np.array_equal(straight.pose, again.pose)


def test_a_log_without_the_line_that_names_its_columns_is_answered(tmp_path: Path) -> None:
    log = write_csv(tmp_path / "log.csv", list(COLUMNS), list(COLUMNS.values()))
    log.write_text("".join(log.read_text().splitlines(keepends=True)[1:]))
    with pytest.raises(
        ValueError, match='no column "x"; no line names them, so that they are numbered from 0 to 10: use'
    ):
        import_logs([log], GOOD, tmp_path / "out")


def test_two_clocks_that_never_overlap_are_answered_with_the_offset(tmp_path: Path) -> None:
    log = write_csv(tmp_path / "log.csv", list(COLUMNS), list(COLUMNS.values()))
    write_csv(tmp_path / "f.csv", ["t", "fx", "fy", "fz"], [np.arange(100) / 500 + 1.7e9, *np.ones((3, 100))])
    with pytest.raises(ValueError, match=r"the two never overlap; .* adds forces.offset=SECONDS"):
        import_logs([log], GOOD | {"forces": {"file": "f.csv", "time": "t"}}, tmp_path / "out")
    shift = {"forces": {"file": "f.csv", "time": "t", "offset": -1.7e9}}
    assert import_logs([log], GOOD | shift, tmp_path / "out").trajectories == 1


def test_files_that_do_not_pair_are_answered_with_the_stem(tmp_path: Path) -> None:
    logs = [write_csv(tmp_path / f"log{n}.csv", list(COLUMNS), list(COLUMNS.values())) for n in range(2)]
    write_csv(tmp_path / "f0.csv", ["t", "fx", "fy", "fz"], [np.arange(100) / 500, *np.ones((3, 100))])
    with pytest.raises(ValueError, match=r"one log of forces for each of 2 logs of poses, found 1 like f\*.csv; use"):
        import_logs(logs, GOOD | {"forces": {"file": "f*.csv", "time": "t"}}, tmp_path / "out")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["cvs", "log.csv"], 'unknown kind "cvs"; did you mean "csv"'),
        (["csv"], "expected files or a folder after csv, found none"),
        (["csv", "absent.csv"], "absent.csv: expected logs to import, found no such file or folder"),
        (["csv", "empty"], "empty: expected logs to import, found no .csv"),
        (["csv", "none_*.csv"], "none_*.csv: expected logs to import, found nothing like it"),
        (["csv", "log.csv", "--mapping", "absent.yaml"], "absent.yaml"),
        (["csv", "log.csv", "--mapping", "broken.yaml"], "broken.yaml:2: no valid YAML"),
        (["csv", "log.csv", "--map", "position"], "--map: expected key=value, say position=[x,y,z]"),
        (["csv", "log.csv", "position=[x,y"], "--map position: expected a list such as [x, y, z]"),
        (["csv", "log.csv", "time=t", "time.unit=ms"], "time is a value of its own, and holds no unit"),
        (["log.xlsx"], 'unknown kind "log.xlsx"'),
    ],
)
def test_a_mistake_on_the_command_line_ends_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, words: list[str], message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("empty").mkdir()
    Path("log.csv").write_text("t,x,y,z\n0,0,0,0\n")
    Path("broken.yaml").write_text("position: [")
    assert main(["import", *words]) == 2
    said = capsys.readouterr().err
    assert message in said
    assert said.count("\n") == 1
    assert {one.name for one in tmp_path.iterdir()} == {"empty", "log.csv", "broken.yaml"}


@pytest.mark.parametrize(
    ("name", "module", "message"),
    [
        ("run.mcap", "rosbags.highlevel", "need rosbags, which is not installed: pip install 'physid[mcap]'"),
        ("run.bag", "rosbags.highlevel", "need rosbags, which is not installed: pip install 'physid[mcap]'"),
        ("run.parquet", "pyarrow.parquet", "need pyarrow, which is not installed: pip install 'physid[lerobot]'"),
    ],
)
def test_a_reader_that_is_not_installed_is_named_with_its_extra(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    name: str,
    module: str,
    message: str,
) -> None:
    (tmp_path / name).write_bytes(b"anything")
    monkeypatch.setitem(sys.modules, module, None)
    assert main(["import", str(tmp_path / name), "--guess"]) == 2
    assert message in capsys.readouterr().err


def test_an_archive_of_a_million_columns_is_refused(tmp_path: Path) -> None:
    np.savez_compressed(tmp_path / "log.npz", a=np.zeros((1, 1 << 20), dtype=np.bool_))
    with pytest.raises(ValueError, match=r"log.npz: expected arrays .* 10000 columns at most, found 1048576"):
        read_table(tmp_path / "log.npz")


def test_separators_of_thousands_are_no_decimal_marks(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("t;x\n0.00;1,000\n0.01;1,010\n")
    table = read_table(tmp_path / "log.csv")
    assert table.values("t").tolist() == [0.0, 0.01]
    with pytest.raises(ValueError, match=r'log.csv:2: expected a number in column "x", found "1,000"; is the mark'):
        table.values("x")


def test_points_separate_thousands_where_commas_are_decimal(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("t;x;y;z;w\n0,00;999,5;0.5;0,010;0,5\n0,01;1.001;1.751;0,020;1,751\n")
    table = read_table(tmp_path / "log.csv")
    assert table.values("t").tolist() == [0.0, 0.01]
    assert table.values("y").tolist() == [0.5, 1.751], "a mark of decimals in one cell of a column is one in all"
    assert table.values("z").tolist() == [0.01, 0.02], "no thousands begin with a zero"
    assert table.values("w").tolist() == [0.5, 1.751]
    with pytest.raises(ValueError, match=r'log.csv:3: expected a number in column "x", found "1.001"; is the mark one'):
        table.values("x")


def test_a_packed_table_is_answered_with_how_to_unpack_it(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_bytes(gzip.compress(b"t,x\n0,1\n"))
    with pytest.raises(ValueError, match=r"log.csv: expected a table, found one that gzip has packed; unpack it"):
        read_table(tmp_path / "log.csv")


def test_a_log_that_the_memory_has_no_room_for_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    log = write_csv(tmp_path / "log.csv", list(COLUMNS), list(COLUMNS.values()))

    def fail(*_: object, **__: object) -> None:
        raise MemoryError("Unable to allocate 72.8 TiB for an array with shape (10000000000000,)")

    monkeypatch.setattr(np, "loadtxt", fail)
    assert main(["import", str(log), "rate=1", "--out", str(tmp_path / "out"), "--guess"]) == 1
    said = capsys.readouterr().err
    assert f"{log}: expected room in memory for all of it, found none; split it" in said
    assert "batch_size" not in said


def test_arrays_that_come_to_one_name_are_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "log.npz", **{"pos": np.zeros((9, 3)), "pos[0]": np.ones(9)})
    with pytest.raises(ValueError, match=r'expected each column once, found two that are called "pos\[0\]"; rename'):
        read_table(tmp_path / "log.npz")


def test_an_archive_that_declares_more_than_it_holds_is_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "log.npz", t=np.arange(9.0))
    with zipfile.ZipFile(tmp_path / "log.npz") as packed:
        content = packed.read("t.npy")
    content = content.replace(b"'shape': (9", b"'shape': (9" + b"9" * 10, 1).replace(b" " * 10, b"", 1)
    with zipfile.ZipFile(tmp_path / "log.npz", "w") as packed:
        packed.writestr("t.npy", content)
    with pytest.raises(
        ValueError, match=r"log.npz: expected a NumPy archive of numbers, found what cannot be read .*declares"
    ):
        guess_mapping(tmp_path / "log.npz")


def test_infinite_numbers_are_named_with_their_line(tmp_path: Path) -> None:
    columns = COLUMNS | {"x": changed("x", 4, np.nan)}
    log = write_csv(tmp_path / "log.csv", list(columns), list(columns.values()))
    lines = log.read_text().splitlines()
    cells = lines[5].split(",")
    cells[1] = "inf"
    log.write_text("\n".join([*lines[:5], ",".join(cells), *lines[6:]]))
    with pytest.raises(ValueError, match=r"log.csv:6: expected finite numbers, found inf; leave the cell empty"):
        import_logs([log], GOOD, tmp_path / "out")


def test_a_guess_finds_the_log_of_forces_that_is_named_like_the_log(tmp_path: Path) -> None:
    time = np.arange(60) / 100
    for run in ("1", "10"):
        write_csv(tmp_path / f"run_{run}.csv", ["t", "x", "y", "z"], [time, time, 0 * time, 0 * time + 0.1])
    write_csv(tmp_path / "run_10_wrench.csv", ["stamp", "fx", "fy", "fz"], [time * 1e3, time, 0 * time, 0 * time])
    assert "force" not in yaml.safe_load(guess_mapping(tmp_path / "run_1.csv")), "that of run 10 is not its"
    write_csv(tmp_path / "run_1_wrench.csv", ["stamp", "fx", "fy", "fz"], [time * 1e3, time, 0 * time, 0 * time])
    said = yaml.safe_load(guess_mapping(tmp_path / "run_1.csv"))
    assert said["force"] == ["fx", "fy", "fz"]
    assert said["forces"] == {"file": "{stem}_wrench.csv", "time": "stamp"}
    assert said["units"] == {"time": "s", "position": "m", "forces_time": "ms"}
    said |= {"size": [0.1, 0.1, 0.2], "mass": 1.0}
    import_logs([tmp_path / "run_1.csv"], said, tmp_path / "out")
    assert np.allclose(RecordingSet(tmp_path / "out").read(0).wrench_time, time)


@pytest.mark.parametrize("clock", ["\x07", 't "raw"', "t\\1", "t: 1", "été", "\x85t"])
def test_a_guess_is_a_mapping_whatever_columns_and_files_are_called(tmp_path: Path, clock: str) -> None:
    time = np.arange(60) / 100
    names, values = ["x", "y", "z"], [time, 0 * time, 0 * time + 0.1]
    poses = dict(zip([clock, *names, clock + "2"], [time, *values, 0 * time], strict=True))
    np.savez(tmp_path / 'a "run".npz', **poses)
    forces = dict(zip([clock, "fx", "fy", "fz"], [time, *values], strict=True))
    np.savez(tmp_path / 'a "run"_wrench.npz', **forces)
    said = yaml.safe_load(guess_mapping(tmp_path / 'a "run".npz'))
    assert said["time"] == said["forces"]["time"] == clock
    assert said["position"] == names
    said |= {"size": [0.1, 0.1, 0.2], "mass": 1.0}
    import_logs([tmp_path / 'a "run".npz'], said, tmp_path / "out")


def test_a_guess_is_yaml_where_a_comment_names_columns_that_cannot_be_printed(tmp_path: Path) -> None:
    time = np.arange(60) / 100
    write_csv(tmp_path / "run_\x07.csv", ["t", "x", "\x00", "fx", "fy", "fz"], [time, time, *(0 * time,) * 4])
    text = guess_mapping(tmp_path / "run_\x07.csv")
    assert yaml.safe_load(text)["force"] == ["fx", "fy", "fz"]
    assert "run_\\x07.csv" in text
    assert "there are t, x, \\x00, fx" in text


@pytest.mark.parametrize(
    ("names", "torque"),
    [
        (["fx", "fy", "fz", "tx", "ty", "tz"], ["tx", "ty", "tz"]),
        (["ft_Fx", "ft_Fy", "ft_Fz", "ft_Tx", "ft_Ty", "ft_Tz"], ["ft_Tx", "ft_Ty", "ft_Tz"]),
        (["fx", "fy", "fz", "mx", "my", "mz"], ["mx", "my", "mz"]),
        (["fx", "fy", "fz", "ax", "ay", "az"], None),
    ],
)
@pytest.mark.parametrize("beside", [False, True])
def test_torques_are_guessed_and_no_column_is_left_out_without_a_word(
    tmp_path: Path, names: list[str], torque: list[str] | None, beside: bool
) -> None:
    time = np.arange(60) / 100
    columns = {name: (index + 1) * time for index, name in enumerate(names)}
    poses = {"t": time, "x": time, "y": 0 * time, "z": 0 * time + 0.1, "quality": 0 * time}
    here = poses if beside else poses | columns
    write_csv(tmp_path / "run.csv", list(here), list(here.values()))
    if beside:
        write_csv(tmp_path / "run_ft.csv", ["t", *names], [time, *columns.values()])
    said = guess_mapping(tmp_path / "run.csv")
    assert yaml.safe_load(said).get("torque") == torque
    left = {line.partition(": ")[0]: line.partition(": ")[2] for line in said.splitlines() if "# not read" in line}
    others = [] if torque else names[3:]
    expected = {"# not read, of run.csv": ", ".join(["quality", *([] if beside else others)])}
    assert left == expected | ({"# not read, of run_ft.csv": ", ".join(others)} if beside and others else {})


def test_a_position_that_is_called_a_translation_is_no_torque(tmp_path: Path) -> None:
    time = np.arange(60) / 100
    names = ["time", "tx", "ty", "tz", "fx", "fy", "fz"]
    write_csv(tmp_path / "run.csv", names, [time, *[(index + 1) * time for index in range(6)]])
    said = yaml.safe_load(guess_mapping(tmp_path / "run.csv"))
    assert said["position"] == ["tx", "ty", "tz"]
    assert "torque" not in said


def test_a_guess_with_its_blanks_filled_in_is_the_motion(tmp_path: Path) -> None:
    log = write_csv(tmp_path / "log.csv", list(COLUMNS), list(COLUMNS.values()))
    said = guess_mapping(log)
    assert "position: [x, y, z]" in said
    assert "quaternion: [qx, qy, qz, qw]" in said
    assert "force: [fx, fy, fz]" in said
    (tmp_path / "map.yaml").write_text(said)
    words = ["size=[0.1, 0.1, 0.05]", "mass=0.4", "axes=z-up"]
    assert import_logs([log], read_mapping(tmp_path / "map.yaml", words), tmp_path / "out").trajectories == 1
    with pytest.raises(ValueError, match="expected a finite number, found 'FILL_IN'"):
        import_logs([log], read_mapping(tmp_path / "map.yaml"), tmp_path / "again")


@pytest.mark.parametrize(
    ("names", "scale", "line"),
    [
        (["stamp", "pos_x", "pos_y", "pos_z"], 1.0, "position: [pos_x, pos_y, pos_z]"),
        (["timestamp", "X", "Y", "Z"], 1000.0, "position: mm"),
        (["time [ms]", "px", "py", "pz"], 1.0, 'time: "time [ms]"'),
        (["t", "object.position.x", "object.position.y", "object.position.z"], 1.0, "object.position.x"),
    ],
)
def test_names_of_many_kinds_are_guessed(tmp_path: Path, names: list[str], scale: float, line: str) -> None:
    log = write_csv(tmp_path / "log.csv", names, [TRUTH.time, *(scale * 10 * TRUTH.place.T)])
    said = guess_mapping(log)
    assert line in said
    assert "orientation: none" in said
    assert "lines are not sure" in said


def test_bodies_are_guessed_by_what_their_names_begin_with(tmp_path: Path) -> None:
    names = [f"{body}_{one}" for body in ("cup", "lid") for one in ("x", "y", "z", "qw", "qx", "qy", "qz")]
    x, y, z, w = TRUTH.turn.as_quat().T
    log = write_csv(tmp_path / "log.csv", ["t", *names], [TRUTH.time, *(2 * [*TRUTH.place.T, w, x, y, z])])
    said = guess_mapping(log)
    assert "order:" not in said, "the names tell it"
    text = said.replace("[FILL_IN, FILL_IN, FILL_IN]", "[0.1, 0.1, 0.1]").replace("FILL_IN", "0.5")
    (tmp_path / "map.yaml").write_text(text.replace("axes: ", "axes: z-up #"))
    done = import_logs([log], read_mapping(tmp_path / "map.yaml"), tmp_path / "out")
    one = RecordingSet(done.folder)
    assert [body.name for body in one.scene.bodies] == ["cup", "lid"]
    pose = one.read(0).pose
    assert pose is not None
    assert np.allclose(pose[:, 1, :3], TRUTH.place)
    assert np.allclose(np.abs((pose[:, 1, 3:] * TRUTH.turn.as_quat()).sum(1)), 1)


def test_an_array_of_seven_numbers_is_guessed_as_a_pose(tmp_path: Path) -> None:
    np.savez(tmp_path / "log.npz", t=TRUTH.time, pose=np.concatenate([TRUTH.place, TRUTH.turn.as_quat()], 1))
    said = guess_mapping(tmp_path / "log.npz")
    assert 'position: ["pose[0]", "pose[1]", "pose[2]"]' in said
    assert 'quaternion: ["pose[3]", "pose[4]", "pose[5]", "pose[6]"]' in said
    assert "order: xyzw" in said


def test_a_mapping_is_guessed_from_a_log_of_a_single_row(tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    log.write_text("t,x,y,z,qx,qy,qz,qw\n0,1,2,3,0,0,0,1\n")
    assert "FILL_IN" in guess_mapping(log)


def test_lines_are_those_of_the_file_after_blank_lines_and_comments(tmp_path: Path) -> None:
    rows = ["t,x,y,z", "0,0,0,1", "", "# a note", "0.01,0,0,1", "0.02,inf,0,1", "0.03,0,0,1", "", "0.01,0,0,1", ""]
    (tmp_path / "log.csv").write_text("\n".join(rows))
    known = {key: one for key, one in GOOD.items() if key not in ("quaternion", "force")} | {"orientation": "none"}
    with pytest.raises(ValueError, match=r"log.csv:6: expected finite numbers, found inf"):
        import_logs([tmp_path / "log.csv"], known, tmp_path / "out")
    text = (tmp_path / "log.csv").read_text()
    (tmp_path / "log.csv").write_text(text.replace("inf", "0"))
    with pytest.raises(ValueError, match=r"log.csv:9: expected increasing time stamps, found time that runs back"):
        import_logs([tmp_path / "log.csv"], known, tmp_path / "out")


@pytest.mark.parametrize(
    ("unit", "quantity", "known"),
    [
        ("N-m", "torque", "N m"), ("N⋅m", "torque", "N m"), ("newton meters", "torque", "N m"),
        ("º", "angle", "deg"), ("radian", "angle", "rad"), ("Deg", "angle", "deg"), ("MN", "force", None),
        ("lbs", "force", None), ("grad", "angle", None), ("m/s", "position", None), ("hours", "time", "h"),
    ],
)  # fmt: skip
def test_units_are_known_however_they_are_written(unit: str, quantity: str, known: str | None) -> None:
    assert canonical(unit, quantity) == known


def test_a_suffix_in_capitals_may_be_a_name_of_its_own() -> None:
    assert split_header("x_CM") == ("x_CM", None)
    assert split_header("yaw_DEG") == ("yaw", "DEG")


@pytest.mark.parametrize(
    ("names", "order"),
    [
        (["roll", "pitch", "yaw"], "xyz"),
        (["yaw", "pitch", "roll"], "ZYX"),
        (["rz", "ry", "rx"], "ZYX"),
        (["roll", "yaw", "pitch"], "xzy"),
        (["a", "b", "yaw"], "zyx"),
    ],
)
def test_angles_may_be_listed_and_named_as_they_are_meant(tmp_path: Path, names: list[str], order: str) -> None:
    angles = [COLUMNS["x"], 0.5 * COLUMNS["x"], -COLUMNS["x"]]
    there = COLUMNS | dict(zip(names, angles, strict=True))
    log = write_csv(tmp_path / "log.csv", list(there), list(there.values()))
    mapping = {key: value for key, value in GOOD.items() if key != "quaternion"}
    found = import_logs([log], mapping | {"euler": names, "euler_order": order}, tmp_path / "out")
    pose = RecordingSet(found.folder).read(0).pose
    assert pose is not None
    meant = Rotation.from_euler(order, np.stack(angles, 1))
    assert (Rotation.from_quat(pose[:, 0, 3:]) * meant.inv()).magnitude().max() < 1e-9


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"euler": ["yaw"], "euler_order": "x"}, "euler_order says x, but the columns are yaw"),
        ({"euler": ["yaw", "roll", "pitch"], "euler_order": "xyz"}, "euler_order says xyz, but .* yaw, roll, pitch"),
        ({"euler": ["pitch", "roll", "yaw"], "euler_order": "xyz"}, "euler_order says xyz, but .* pitch, roll, yaw"),
        ({"euler": ["rx", "rz"], "euler_order": "ZX"}, "euler_order says ZX, but the columns are rx, rz"),
        ({"quaternion": ["qx", "qw", "qy", "qz"], "order": "xyzw"}, "order says xyzw, but .* qx, qw, qy, qz; list"),
        ({"quaternion": ["qx", "qw", "qy", "qz"]}, "order says nothing, .* but the columns are qx, qw, qy, qz; list"),
        ({"quaternion": ["qi", "qr", "qj", "qk"], "order": "wxyz"}, "order says wxyz, but .* qi, qr, qj, qk; list"),
    ],
)
def test_names_that_say_an_order_say_the_one_that_is_given(tmp_path: Path, keys: dict[str, Any], said: str) -> None:
    names = {
        "rx": "x",
        "rz": "z",
        "roll": "x",
        "pitch": "y",
        "yaw": "z",
        "qi": "qx",
        "qj": "qy",
        "qk": "qz",
        "qr": "qw",
    }
    there = COLUMNS | {name: COLUMNS[like] for name, like in names.items()}
    log = write_csv(tmp_path / "log.csv", list(there), list(there.values()))
    with pytest.raises(ValueError, match=said):
        import_logs([log], {**GOOD, "quaternion": None} | keys, tmp_path / "out")


def test_yaw_may_be_about_another_axis_where_z_is_not_upright(tmp_path: Path) -> None:
    there = COLUMNS | {"yaw": COLUMNS["x"]}
    log = write_csv(tmp_path / "log.csv", list(there), list(there.values()))
    keys = {"quaternion": None, "euler": ["yaw"], "euler_order": "y", "axes": "y-up"}
    assert import_logs([log], GOOD | keys, tmp_path / "out").trajectories == 1


def test_a_guess_says_the_unit_where_brackets_hold_another_word(tmp_path: Path) -> None:
    there = {f"{name} (world)" if name in "xyz" else name: one for name, one in COLUMNS.items()}
    log = write_csv(tmp_path / "log.csv", list(there), list(there.values()))
    said = yaml.safe_load(guess_mapping(log))
    assert said["units"]["position"] == "m"


def test_a_unit_that_the_mapping_says_goes_before_a_word_in_brackets(tmp_path: Path) -> None:
    there = {f"{name} (hand)" if name in "xyz" else name: one for name, one in COLUMNS.items()}
    log = write_csv(tmp_path / "log.csv", list(there), list(there.values()))
    found = import_logs([log], GOOD | {"units": {"position": "mm"}}, tmp_path / "out")
    pose = RecordingSet(found.folder).read(0).pose
    assert pose is not None
    assert np.allclose(pose[:, 0, 0], 1e-3 * COLUMNS["x"])


@pytest.mark.parametrize(
    "text",
    [
        "0,1,2\n0.0,0.5,1.5\n0.1,2.5,3.5\n",
        ",0,1,2\n0,0.0,0.5,1.5\n1,0.1,2.5,3.5\n",
        "0;1;2\n0,0;0,5;1,5\n0,1;2,5;3,5\n",
    ],
)
def test_a_line_that_numbers_columns_is_no_row(tmp_path: Path, text: str) -> None:
    """As pandas writes it where columns have no names, with its index and without."""
    (tmp_path / "log.csv").write_text(text)
    table = read_table(tmp_path / "log.csv")
    assert table.values("0").tolist() == [0.0, 0.1]
    assert table.values("2").tolist() == [1.5, 3.5]


def test_a_line_of_many_names_is_read(tmp_path: Path) -> None:
    names = ["t", *(f"column_{number}" for number in range(20_000))]
    rows = [",".join([f"{row / 10:g}", *["0"] * 20_000]) for row in range(2)]
    (tmp_path / "log.csv").write_text("\n".join([",".join(names), *rows, ""]))
    assert list(read_table(tmp_path / "log.csv").columns) == names


def test_a_name_that_never_ends_is_cut_in_messages(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text(f"x,y,{'z' * 10_000}\n1,2,3\n4,5,6\n")
    for name in ("height", "Y"):
        with pytest.raises(ValueError, match=f'no column "{name}"') as caught:
            read_table(tmp_path / "log.csv").find(name)
        assert len(str(caught.value)) < 500


def test_units_that_names_alone_say_are_noted_unless_the_mapping_says_them(tmp_path: Path) -> None:
    """A name that ends in _cm may mean a centre of mass."""
    names = {"t": "t_ms", "x": "x_cm", "y": "y_cm", "z": "z [cm]", "fx": "fx_N"}
    there = {names.get(name, name): values for name, values in COLUMNS.items()}
    there["t_ms"] = 1e3 * there["t_ms"]
    log = write_csv(tmp_path / "log.csv", list(there), list(there.values()))
    mapping = GOOD | {"time": "t_ms", "position": ["-x_cm", "y_cm", "z"], "force": ["fx_N", "fy", "fz"]}
    notes = import_logs([log], mapping, tmp_path / "out").notes
    assert "x_cm, y_cm: taken in cm, as the name ends; if it does not mean that, rename the column" in notes
    assert [note.partition(":")[0] for note in notes if "as the name ends" in note] == ["t_ms", "x_cm, y_cm", "fx_N"]
    units = {"position": "cm", "time": "ms", "force": "N"}
    notes = import_logs([log], mapping | {"units": units}, tmp_path / "more").notes
    assert not [note for note in notes if "as the name ends" in note]


@pytest.mark.parametrize("empty", ["-", "null", "N/A", "nan"])
def test_a_first_row_in_which_nothing_was_measured_is_a_row(tmp_path: Path, empty: str) -> None:
    """Dashes stand for no unit beside units, and for nothing measured without."""
    rows = [f"{empty},{empty},{empty}", *(f"{0.01 * row:g},0.5,0.025" for row in range(1, 40))]
    (tmp_path / "log.csv").write_text("\n".join(["x,y,z", *rows, ""]))
    assert len(read_table(tmp_path / "log.csv").values("x")) == 40
    (tmp_path / "log.csv").write_text("\n".join(["x,y,q", "mm,mm,-", *rows[1:], ""]))
    table = read_table(tmp_path / "log.csv")
    assert len(table.values("x")) == 39
    assert table.units["x"] == "mm"


def test_underscores_are_no_part_of_numbers(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("a,b\n1_000,2\n1_001,3\n")
    with pytest.raises(ValueError, match=r'log.csv:2: expected a number in column "a", found "1_000"'):
        read_table(tmp_path / "log.csv").values("a")


@pytest.mark.parametrize("text", ["0,0;;1,5\n0,1;2,5;3,5\n0,2;4,5;5,5\n", "0.0,,1.5\n0.1,2.5,3.5\n0.2,4.5,5.5\n"])
def test_a_table_without_a_header_keeps_its_first_row_where_a_cell_of_it_is_empty(tmp_path: Path, text: str) -> None:
    (tmp_path / "log.csv").write_text(text)
    table = read_table(tmp_path / "log.csv")
    assert list(table.columns) == ["0", "1", "2"]
    assert table.values("0").tolist() == [0.0, 0.1, 0.2]
    assert np.isnan(table.values("1")).tolist() == [True, False, False]
