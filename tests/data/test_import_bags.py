"""Bags of ROS, written by the writers of rosbags, come out as the motion that was written."""

from __future__ import annotations

import bz2
import re
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from tests.data.logs import Truth

from physid.cli import main
from physid.data import RecordingSet
from physid.data.importers.convert import import_logs
from physid.data.importers.guessing import guess_mapping
from physid.data.importers.tables.files import read_table
from physid.data.importers.tables.packed import CHUNKS, TooTightlyPackedError, Unpacking
from physid.data.importers.tables.table import MissingColumnError, Table

pytest.importorskip("rosbags", reason="needs physid[mcap]")
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

PACKED = {
    "BZ2": (Writer1.CompressionFormat.BZ2,),
    "LZ4": (Writer1.CompressionFormat.LZ4,),
} | {one: (CompressionMode[one], CompressionFormat.ZSTD) for one in ("FILE", "MESSAGE", "STORAGE")}
TRUTH, EPOCH = Truth.of(), 1.7e9
STAMP = 1e-6  # [s] that a double keeps of seconds since 1970
MAPPING: dict[str, Any] = {
    "time": "/block/pose/header/stamp",
    "position": "/block/pose/pose/position",
    "quaternion": "/block/pose/pose/orientation",
    "force": "/hand/wrench/force",
    "forces": {"time": "/hand/header/stamp"},
    "size": [0.1, 0.1, 0.05],
    "mass": 0.4,
    "friction": 0.3,
}


class Bag:
    """Writes messages of geometry_msgs as a robot would."""

    def __init__(self, path: Path, kind: str, packed: str | None = None) -> None:
        self.first = kind == "bag"
        self.store = get_typestore(Stores.ROS1_NOETIC if self.first else Stores.ROS2_HUMBLE)
        plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
        self.writer: Any = Writer1(path) if self.first else Writer2(path, version=9, storage_plugin=plugin)
        if packed:
            self.writer.set_compression(*PACKED[packed])
        self.connections: dict[tuple[str, str], Any] = {}

    def __enter__(self) -> Bag:
        self.writer.open()
        return self

    def __exit__(self, *_: object) -> None:
        self.writer.close()

    def make(self, name: str, **fields: Any) -> Any:
        """Make a message."""
        package, kind = name.split("/")
        return self.store.types[f"{package}/msg/{kind}"](**fields)

    def header(self, time: float, frame: str = "world") -> Any:
        seconds, rest = divmod(round((EPOCH + time) * 1e9), 10**9)
        stamp = self.make("builtin_interfaces/Time", sec=seconds, nanosec=rest)
        return self.make("std_msgs/Header", **({"seq": 0} if self.first else {}), stamp=stamp, frame_id=frame)

    def pose(self, place: Any, turn: Any) -> Any:
        x, y, z, w = turn
        return self.make(
            "geometry_msgs/Pose",
            position=self.make("geometry_msgs/Point", **dict(zip("xyz", place, strict=True))),
            orientation=self.make("geometry_msgs/Quaternion", x=x, y=y, z=z, w=w),
        )

    def vector(self, values: Any) -> Any:
        return self.make("geometry_msgs/Vector3", **dict(zip("xyz", values, strict=True)))

    def write(self, topic: str, message: Any, time: float) -> None:
        kind = message.__msgtype__
        if (topic, kind) not in self.connections:
            self.connections[topic, kind] = self.writer.add_connection(topic, kind, typestore=self.store)
        to_bytes = self.store.serialize_ros1 if self.first else self.store.serialize_cdr
        self.writer.write(self.connections[topic, kind], round((EPOCH + time) * 1e9), to_bytes(message, kind))

    def write_forces(self, topic: str = "/hand") -> None:
        for time, force in zip(TRUTH.force_time, TRUTH.force, strict=True):
            wrench = self.make("geometry_msgs/Wrench", force=self.vector(force), torque=self.vector(0 * force))
            self.write(
                topic, self.make("geometry_msgs/WrenchStamped", header=self.header(time, "hand"), wrench=wrench), time
            )

    def write_poses(self, topic: str = "/block/pose") -> None:
        for time, place, turn in zip(TRUTH.time, TRUTH.place, TRUTH.turn.as_quat(), strict=True):
            pose = self.pose(place, turn)
            self.write(topic, self.make("geometry_msgs/PoseStamped", header=self.header(time), pose=pose), time + 0.003)


@pytest.mark.parametrize(("kind", "name"), [("mcap", "run"), ("db3", "run"), ("bag", "run.bag")])
def test_stamped_poses_and_wrenches_of_any_bag_are_the_motion(tmp_path: Path, kind: str, name: str) -> None:
    with Bag(tmp_path / name, kind) as bag:
        bag.write_poses()
        bag.write_forces()
    (tmp_path / "map.yaml").write_text(yaml.safe_dump(MAPPING))
    place = tmp_path / name
    for index, log in enumerate([place, next(place.glob(f"*.{kind}"))] if place.is_dir() else [place]):
        out = tmp_path / f"set{index}"
        assert main(["import", str(log), "--mapping", str(tmp_path / "map.yaml"), f"--out={out}"]) == 0
        one = RecordingSet(out).read(0)
        assert one.pose is not None
        assert one.time is not None
        assert one.wrench is not None
        assert one.wrench_time is not None
        assert np.allclose(one.time, TRUTH.time, rtol=0, atol=STAMP)
        assert np.allclose(one.pose[:, 0, :3], TRUTH.place, atol=1e-12)
        assert np.allclose(np.abs((one.pose[:, 0, 3:] * TRUTH.turn.as_quat()).sum(1)), 1, atol=1e-12)
        assert np.allclose(one.wrench_time, TRUTH.force_time, rtol=0, atol=STAMP)
        assert np.allclose(one.wrench[:, 0, 3:], TRUTH.force, atol=1e-12)


def write_mixed(path: Path) -> Path:
    """Write transforms, each sent twice and out of order, odometry beside them on another clock, and images."""
    with Bag(path, "mcap") as bag:
        rows = list(zip(TRUTH.time, TRUTH.place, TRUTH.turn.as_quat(), strict=True))
        for index in np.arange(len(rows)) ^ 1 if len(rows) % 2 == 0 else range(len(rows)):
            time, place, turn = rows[index]
            transform = bag.make(
                "geometry_msgs/Transform", translation=bag.vector(place), rotation=bag.pose(place, turn).orientation
            )
            one = bag.make(
                "geometry_msgs/TransformStamped", header=bag.header(time), child_frame_id="cup", transform=transform
            )
            for _ in range(2):
                bag.write("/tf", bag.make("tf2_msgs/TFMessage", transforms=[one]), TRUTH.time[-1])
        for time, place, turn in rows[::2]:
            pose = bag.make("geometry_msgs/PoseWithCovariance", pose=bag.pose(place + 1, turn), covariance=np.zeros(36))
            still = bag.make("geometry_msgs/Twist", linear=bag.vector(0 * place), angular=bag.vector(0 * place))
            twist = bag.make("geometry_msgs/TwistWithCovariance", twist=still, covariance=np.zeros(36))
            header = bag.header(time + 0.002)
            bag.write(
                "/cart", bag.make("nav_msgs/Odometry", header=header, child_frame_id="c", pose=pose, twist=twist), 9
            )
            image = {"height": 1, "width": 2, "encoding": "mono8", "is_bigendian": 0, "step": 2}
            bag.write("/image", bag.make("sensor_msgs/Image", header=header, data=np.zeros(2, np.uint8), **image), 9)
    return path


def test_transforms_and_odometry_are_bodies_each_on_its_clock(tmp_path: Path) -> None:
    bag = write_mixed(tmp_path / "run")
    size = {"size": [0.1, 0.1, 0.1], "mass": 1.0, "friction": 0.3}
    cup = {"name": "cup", "position": "/tf/cup/transform/translation", "quaternion": "/tf/cup/transform/rotation"}
    cart = {"name": "cart", "position": "/cart/pose/pose/position", "quaternion": "/cart/pose/pose/orientation"}
    bodies = [cup | size, cart | size | {"clock": "/cart/header/stamp"}]
    done = import_logs([bag], {"time": "/tf/cup/header/stamp", "bodies": bodies}, tmp_path / "set")
    one = RecordingSet(done.folder).read(0)
    assert one.pose is not None
    assert one.time is not None
    seen = np.isfinite(one.pose[..., 0])
    assert np.allclose(one.time[seen[:, 0]], TRUTH.time, rtol=0, atol=STAMP)
    assert np.allclose(one.pose[seen[:, 0], 0, :3], TRUTH.place)
    assert np.allclose(one.time[seen[:, 1]], TRUTH.time[::2] + 0.002, rtol=0, atol=STAMP)
    assert np.allclose(one.pose[seen[:, 1], 1, :3], TRUTH.place[::2] + 1)
    assert any("0 of" in note and "hold all of them" in note for note in done.notes)


def test_a_guess_finds_bodies_forces_their_clocks_and_their_frames(tmp_path: Path) -> None:
    with Bag(tmp_path / "run", "mcap") as bag:
        bag.write_poses()
        bag.write_forces()
    said = guess_mapping(tmp_path / "run")
    found = yaml.safe_load(said)
    assert {name: found[name] for name in ("time", "position", "quaternion", "force", "forces")} == {
        name: MAPPING[name] for name in ("time", "position", "quaternion", "force", "forces")
    }
    assert "in the frame hand: are its axes the world's, its origin the centre of the body?" in said
    several = yaml.safe_load(guess_mapping(write_mixed(tmp_path / "more")))
    assert [one["name"] for one in several["bodies"]] == ["cup", "cart"]
    assert several["bodies"][1]["clock"] == "/cart/header/stamp"


def test_images_and_covariances_are_no_columns(tmp_path: Path) -> None:
    names = list(read_table(write_mixed(tmp_path / "run")).columns)
    assert not [name for name in names if "image" in name or "covariance" in name]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"position": "/block/pose/position"}, r'no column "/block/pose/position"; did you mean "/block/pose/pose/pos'),
        (
            {"position": "/block/pose"},
            "expected 3 columns for /block/pose, found 9: /block/pose/header/stamp, .* list the 3",
        ),
        (
            {"time": "/hand/header/stamp"},
            "expected poses and their stamps in one topic, found /block/pose/pose/position of /block/pose and "
            "/hand/header/stamp of /hand",
        ),
        (
            {"forces": {"time": "/block/pose/header/stamp"}},
            "expected forces and forces.time in one topic, found /hand/wrench/force of /hand and .* of /block/pose",
        ),
        ({"force": "/hand/wrench"}, "expected 3 columns for .* found 6"),
    ],
)
def test_a_mistake_in_the_mapping_of_a_bag_is_answered(tmp_path: Path, change: dict[str, Any], message: str) -> None:
    with Bag(tmp_path / "run", "mcap") as bag:
        bag.write_poses()
        bag.write_forces()
    with pytest.raises(ValueError, match=message):
        import_logs([tmp_path / "run"], MAPPING | change, tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", ["run.mcap", "run.bag", "run.db3"])
@pytest.mark.parametrize("kept", [0.0, 0.5, 0.99])
def test_a_damaged_bag_is_named_with_a_remedy(tmp_path: Path, name: str, kept: float) -> None:
    kind = name[4:]
    with Bag(tmp_path / (name if kind == "bag" else "whole"), kind) as bag:
        bag.write_poses()
    whole = tmp_path / name if kind == "bag" else next((tmp_path / "whole").glob(f"*.{kind}"))
    content = whole.read_bytes()
    (tmp_path / name).write_bytes(content[: int(kept * len(content))])
    with pytest.raises(ValueError, match=rf"{name}: expected (a bag of ROS|rows of numbers)"):
        import_logs([tmp_path / name], MAPPING, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_bag_without_numbers_is_answered(tmp_path: Path) -> None:
    with Bag(tmp_path / "run", "mcap") as bag:
        bag.write("/said", bag.make("std_msgs/String", data="hello"), 0.0)
    with pytest.raises(ValueError, match="expected topics with numbers, such as geometry_msgs/PoseStamped, found none"):
        import_logs([tmp_path / "run"], MAPPING, tmp_path / "out")


@pytest.mark.parametrize("stamped", [True, False])
def test_poses_of_a_body_at_rest_are_kept_where_stamps_were_never_set(stamped: bool, tmp_path: Path) -> None:
    """The clock is then when messages arrived; what is sent twice is known by its stamp."""
    with Bag(tmp_path / "run", "mcap") as bag:
        for number, place in enumerate([1.0, 1.0, 1.0, 2.0]):
            header = bag.header(number / 10 if stamped else -EPOCH)
            pose = bag.pose([place, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0])
            for _ in range(1 + stamped):
                bag.write("/block", bag.make("geometry_msgs/PoseStamped", header=header, pose=pose), number / 10)
    table = read_table(tmp_path / "run")
    assert table.values("/block/pose/position/x").tolist() == [1.0, 1.0, 1.0, 2.0]


TOGETHER = np.arange(50) / 100


def write_together(path: Path, kind: str = "mcap", frames: tuple[str, ...] = ("world",), **how: Any) -> Path:
    """Write topics of as many messages each: poses, others of another rate, and forces that begin 0.2 s later."""
    with Bag(path, kind, **how) as bag:
        for number, time in enumerate(TOGETHER):
            for topic, stamp in (("/pose", time), ("/imu", 5 * time)):
                pose = bag.pose([0.5 * time, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0])
                header = bag.header(stamp, frames[number % len(frames)])
                bag.write(topic, bag.make("geometry_msgs/PoseStamped", header=header, pose=pose), stamp)
            wrench = bag.make("geometry_msgs/Wrench", force=bag.vector([time, 0, 0]), torque=bag.vector([0, 0, 0]))
            header = bag.header(time + 0.2, "hand")
            bag.write("/hand", bag.make("geometry_msgs/WrenchStamped", header=header, wrench=wrench), time + 0.2)
    return path


POSES: dict[str, Any] = {
    "time": "/pose/header/stamp",
    "position": "/pose/pose/position",
    "quaternion": "/pose/pose/orientation",
    "size": [0.1, 0.1, 0.05],
    "mass": 0.4,
    "friction": 0.3,
}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"force": "/hand/wrench/force"}, "found /pose/header/stamp of /pose and .* forces.time=/hand/header/stamp"),
        (
            {"force": "/hand/wrench/force", "forces": {"rate": 100}},
            "poses and forces without stamps of their own in one topic, .* forces.time=/hand/header/stamp",
        ),
        (
            {"force": "/hand/wrench/force", "time": None, "rate": 100},
            "found /pose/pose/position of /pose and .* forces.time=/hand/header/stamp",
        ),
        (
            {"force": "/hand/wrench/force", "forces": {"time": "/imu/received"}},
            "expected forces and forces.time in one topic, found /hand/wrench/force of /hand and /imu/received of /imu",
        ),
        (
            {"force": "/hand/wrench/force", "torque": "/imu/pose/position"},
            "expected forces and torques in one topic, found /hand/wrench/force of /hand and .* of /imu.* into a log",
        ),
        ({"quaternion": "/imu/pose/orientation"}, "expected poses and their stamps in one topic, found .* of /imu"),
        ({"time": "/imu/received"}, "expected poses and their stamps in one topic, found .* of /imu"),
        ({"trajectory": "/imu/pose/position/x"}, "expected poses and their stamps in one topic, found .* of /imu"),
    ],
)
def test_rows_of_two_topics_are_never_joined_by_their_number(
    tmp_path: Path, change: dict[str, Any], message: str
) -> None:
    """As many messages on each do not make them the same moments."""
    bag = write_together(tmp_path / "run")
    with pytest.raises(ValueError, match=message):
        import_logs([bag], POSES | change, tmp_path / "out")


def test_bodies_of_two_topics_of_one_length_need_clocks_of_their_own(tmp_path: Path) -> None:
    bag = write_together(tmp_path / "run")
    size = {"size": [0.1, 0.1, 0.1], "mass": 1.0, "friction": 0.3, "orientation": "none"}
    first, second = (size | {"name": name, "position": f"/{name}/pose/position"} for name in ("pose", "imu"))
    with pytest.raises(ValueError, match=r"one topic, found .* of /pose and .* of /imu, .* \{clock: COLUMN"):
        import_logs([bag], {"time": "/pose/header/stamp", "bodies": [first, second]}, tmp_path / "out")
    second["clock"] = "/pose/header/stamp"
    with pytest.raises(ValueError, match="expected the poses of imu and their clock in one topic"):
        import_logs([bag], {"time": "/pose/header/stamp", "bodies": [first, second]}, tmp_path / "out")


def test_forces_on_their_own_clock_act_when_they_were_stamped_and_other_frames_are_named(tmp_path: Path) -> None:
    bag = write_together(tmp_path / "run")
    forces = {"force": "/hand/wrench/force", "forces": {"time": "/hand/header/stamp"}}
    done = import_logs([bag], POSES | forces, tmp_path / "out")
    one = RecordingSet(done.folder).read(0)
    assert one.wrench is not None
    assert one.wrench_time is not None
    assert np.allclose(one.wrench_time, TOGETHER + 0.2, rtol=0, atol=STAMP)
    assert np.allclose(one.wrench[:, 0, 3], TOGETHER)
    assert any(note.startswith("poses are in the frame world, forces in hand") for note in done.notes)


def test_a_guess_names_no_clock_of_another_topic(tmp_path: Path) -> None:
    """Messages without stamps that arrive at once have none that rises; that of others is not theirs."""
    with Bag(tmp_path / "run", "mcap") as bag:
        for time in TOGETHER:
            pose = bag.pose([0.5 * time, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0])
            bag.write("/pose", bag.make("geometry_msgs/PoseStamped", header=bag.header(time), pose=pose), time)
            wrench = bag.make("geometry_msgs/Wrench", force=bag.vector([time, 0, 0]), torque=bag.vector([0, 0, 0]))
            bag.write("/pose_force", wrench, 0.0)
    assert yaml.safe_load(guess_mapping(tmp_path / "run"))["forces"] == {"time": "/pose_force/received"}


def test_poses_in_several_frames_are_refused_by_name(tmp_path: Path) -> None:
    bag = write_together(tmp_path / "run", frames=("world", "camera"))
    with pytest.raises(ValueError, match="expected /pose in one frame, found messages in world and camera; transforms"):
        import_logs([bag], POSES, tmp_path / "out")


def test_transforms_of_one_child_from_several_parents_are_refused(tmp_path: Path) -> None:
    with Bag(tmp_path / "run", "mcap") as bag:
        for number, time in enumerate(TOGETHER):
            turn = bag.pose([0, 0, 0], [0.0, 0.0, 0.0, 1.0]).orientation
            transform = bag.make("geometry_msgs/Transform", translation=bag.vector([time, 0, 0]), rotation=turn)
            header = bag.header(time, ("world", "camera")[number % 2])
            one = bag.make("geometry_msgs/TransformStamped", header=header, child_frame_id="cup", transform=transform)
            bag.write("/tf", bag.make("tf2_msgs/TFMessage", transforms=[one]), time)
    cup = {"time": "/tf/cup/header/stamp", "position": "/tf/cup/transform/translation", "orientation": "none"}
    with pytest.raises(ValueError, match="expected /tf/cup in one frame, found messages in world and camera"):
        import_logs([tmp_path / "run"], POSES | cup | {"quaternion": None}, tmp_path / "out")


@pytest.mark.parametrize("other", ["PoseStamped", "Vector3Stamped"])
def test_a_topic_of_two_types_is_refused_where_it_is_used(tmp_path: Path, other: str) -> None:
    """Points and vectors have three numbers each: their rows would fit one table."""
    with Bag(tmp_path / "run", "mcap") as bag:
        for number, time in enumerate(TOGETHER):
            pose, header = bag.pose([time, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]), bag.header(time)
            messages = {
                "PointStamped": {"point": pose.position},
                "PoseStamped": {"pose": pose},
                "Vector3Stamped": {"vector": bag.vector([time, 0.0, 0.0])},
            }
            name = ("PointStamped", other)[number % 2]
            bag.write("/p", bag.make(f"geometry_msgs/{name}", header=header, **messages[name]), time)
            bag.write("/pose", bag.make("geometry_msgs/PoseStamped", header=header, pose=pose), time)
    refused = rf"expected messages of one type on /p, found .*PointStamped and .*{other}"
    for wrong in ({"position": "/p/point"}, {"time": "/p/header/stamp"}, {"force": "/p"}):
        with pytest.raises(ValueError, match=refused):
            import_logs([tmp_path / "run"], POSES | wrong, tmp_path / "wrong")
    assert re.search(refused, guess_mapping(tmp_path / "run"))
    import_logs([tmp_path / "run"], POSES, tmp_path / "right")
    pose = RecordingSet(tmp_path / "right").read(0).pose
    assert pose is not None
    assert np.allclose(pose[:, 0, 0], TOGETHER)


def test_two_columns_of_one_name_are_refused(tmp_path: Path) -> None:
    """What is below a topic may be called as another topic is."""
    with Bag(tmp_path / "run", "mcap") as bag:
        pose = bag.pose([1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0])
        bag.write("/p", bag.make("geometry_msgs/PoseStamped", header=bag.header(0.0), pose=pose), 0.0)
        bag.write("/p/pose", pose, 0.0)
    with pytest.raises(ValueError, match='expected each column once, found two that are called "/p/pose/position/x"'):
        read_table(tmp_path / "run")


@pytest.mark.parametrize(
    ("kind", "packed"),
    [("db3", "FILE"), ("mcap", "FILE"), ("db3", "MESSAGE"), ("mcap", "MESSAGE"), ("mcap", "STORAGE"), ("bag", "BZ2"),
     ("bag", "LZ4")],
)  # fmt: skip
def test_a_packed_bag_is_read_as_long_as_it_unpacks_to_no_more_than_its_size_promises(
    tmp_path: Path, kind: str, packed: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = read_table(write_together(tmp_path / "whole.bag" if kind == "bag" else tmp_path / "whole", kind))
    small = write_together(tmp_path / ("small.bag" if kind == "bag" else "small"), kind, packed=packed)
    found = read_table(small)
    assert list(found.columns) == list(whole.columns)
    assert all(np.array_equal(found.columns[name], values) for name, values in whole.columns.items())
    monkeypatch.setattr("physid.data.importers.tables.packed.most_unpacked", lambda held: 1000)
    with pytest.raises(
        ValueError, match=r"small\S*: expected a log that unpacks to 1000 bytes at most, .* unpack it first"
    ):
        read_table(small)


@pytest.mark.parametrize(
    "change",
    [
        "DROP TABLE schema; CREATE VIEW schema AS SELECT 4 AS schema_version",
        "CREATE TRIGGER now AFTER INSERT ON messages BEGIN SELECT 1; END",
        "ALTER TABLE topics ADD COLUMN more GENERATED ALWAYS AS (zeroblob(1000000000)) VIRTUAL",
    ],
)
def test_a_database_that_computes_what_it_should_hold_is_refused(tmp_path: Path, change: str) -> None:
    """A view may count for ever, and no signal ends it."""
    with Bag(tmp_path / "run", "db3") as bag:
        bag.write_poses()
    with closing(sqlite3.connect(next((tmp_path / "run").glob("*.db3")))) as database:
        database.executescript(change)
    with pytest.raises(ValueError, match=r"run.db3: expected tables that hold what was recorded, found '"):
        read_table(tmp_path / "run")


def test_a_path_that_sqlite_reads_as_another_one_is_refused(tmp_path: Path) -> None:
    """What was looked into would not be what is read."""
    with Bag(tmp_path / "run", "db3") as bag:
        bag.write_poses()
    (tmp_path / "run").rename(tmp_path / "a%62")
    with pytest.raises(
        ValueError, match=r"a%62/run.db3: expected a path without %, which has a meaning to SQLite; rename"
    ):
        read_table(tmp_path / "a%62")


def test_a_file_that_a_bag_lists_twice_is_read_once(tmp_path: Path) -> None:
    bag = write_together(tmp_path / "run")
    about = yaml.safe_load((bag / "metadata.yaml").read_text())
    about["rosbag2_bagfile_information"]["relative_file_paths"] *= 2
    (bag / "metadata.yaml").write_text(yaml.safe_dump(about))
    assert len(read_table(bag).values("/pose/received")) == len(TOGETHER)


def test_a_part_that_a_bag_does_not_list_is_not_passed_over(tmp_path: Path) -> None:
    bag = write_together(tmp_path / "run")
    whole = read_table(bag).values("/pose/received")
    listed = yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]["relative_file_paths"]
    (bag / f"{listed[0]}.zstd").touch()  # what is packed beside what a player has unpacked
    assert list(read_table(bag).values("/pose/received")) == list(whole)
    (bag / "._run.mcap").touch()  # of macOS
    assert list(read_table(bag).values("/pose/received")) == list(whole)
    (bag / "run_1.mcap").touch()
    with pytest.raises(
        ValueError, match=r"run: expected the files that metadata.yaml lists .* found run_1.mcap beside"
    ):
        read_table(bag)


def test_a_bag_that_lacks_a_file_which_it_lists_is_answered(tmp_path: Path) -> None:
    with Bag(tmp_path / "run", "mcap") as bag:
        bag.write_poses()
    next((tmp_path / "run").glob("*.mcap")).unlink()
    with pytest.raises(
        ValueError, match=r"run: expected a bag of ROS, .* \(no file run.mcap, which metadata.yaml lists"
    ):
        read_table(tmp_path / "run")


def test_a_chunk_that_topics_in_turn_ask_for_again_counts_once(tmp_path: Path) -> None:
    """rosbags unpacks a chunk anew at every change of chunk: 528 kB of a sound bag had counted as more than 64 MiB."""
    raw = [bytes([number]) * 2**20 for number in range(2 * CHUNKS)]
    chunks = [bz2.compress(each) for each in raw]
    unpacking = Unpacking(tmp_path / "a.bag", 0)
    for _ in range(5):
        assert [unpacking.unpack("bz2", each) for each in chunks] == raw
    for number in range(64 - 2 * CHUNKS):
        unpacking.unpack("bz2", bz2.compress(bytes([100 + number]) * 2**20))
    with pytest.raises(TooTightlyPackedError, match=r"a.bag: expected a log that unpacks to 67108864 bytes at most"):
        unpacking.unpack("bz2", bz2.compress(b"one more"))


def test_below_a_topic_that_cannot_be_used_another_one_can(tmp_path: Path) -> None:
    columns, topics = {"/p/filtered/x": np.zeros(3)}, {"/p/filtered/x": "/p/filtered"}
    table = Table(tmp_path / "run", columns, {}, {}, 0, topics, {}, refused={"/p": "no"})
    assert table.components("/p/filtered") == ["/p/filtered/x"]
    with pytest.raises(ValueError, match=r"run: no$"):
        table.components("/p")
    with pytest.raises(MissingColumnError, match='did you mean "/p/filtered/x"'):
        table.find("/p/filtered/y")
