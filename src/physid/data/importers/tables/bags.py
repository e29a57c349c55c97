"""Bags of ROS 1 and ROS 2 as named columns, read by the package rosbags, which is an extra."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from operator import attrgetter
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from physid.data.importers.tables.databases import UnsoundDatabaseError, require_plain_tables
from physid.data.importers.tables.packed import OPENERS, TooTightlyPackedError, Unpacking
from physid.data.importers.tables.table import STAMP, Table, named_once
from physid.yaml_files import read_yaml

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader

Array = NDArray[np.float64]
Getter = Callable[[Any], float]
Row = tuple[float, ...]
RECEIVED = "received"
TIMES = ("builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration")
TRANSFORMS, TRANSFORM = "tf2_msgs/msg/TFMessage", "geometry_msgs/msg/TransformStamped"
BYTES, TEXTS = ("uint8", "int8", "byte", "char", "octet"), ("string", "wstring")
MOST_ELEMENTS = 16  # of an array of fixed length that become columns; covariances do not
METADATA, DATABASE, FORMAT = "metadata.yaml", ".db3", "zstd"
PARTS = (DATABASE, ".mcap")
"""Endings of the files that hold messages, beside which `.zstd` says that they are packed."""
DAMAGED = "expected a bag of ROS, found what cannot be read"


class UnlistedPartError(ValueError):
    """A sound bag, beside files that may be parts of it."""


def read_bag(path: Path) -> Table:
    """Read a .bag, .mcap or .db3 file, or the folder of a ROS 2 bag.

    A number within a message is the column `TOPIC/field/...`, as in `/block/pose/position/x`; a stamp is one column of
    seconds, `TOPIC/header/stamp`; `TOPIC/received` is when the message was logged. Transforms become columns for each
    child frame: `/tf/CHILD/transform/translation/x`. Messages are put in the order of their stamps, and what was sent
    twice is taken once. Images, clouds of points and arrays of changing length are left out, one message is in memory
    at a time.

    Raises:
        ValueError: If rosbags is not installed, or the bag is damaged, holds no numbers, unpacks to more than its size
            promises, or lies beside files that it does not list.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise ValueError(
            f"{path}: bags of ROS need rosbags, which is not installed: pip install 'physid[mcap]'"
        ) from None
    topics: dict[str, _Topic] = {}
    try:
        with _storages(path) as (files, unpacking, mode):
            for file in files:
                if file.suffix == DATABASE:
                    require_plain_tables(file)
            with _unpacked_by(unpacking), AnyReader(files, default_typestore=get_typestore(Stores.LATEST)) as reader:
                unpack = partial(unpacking.unpack, FORMAT) if mode == "message" else None
                for name, kind, row, frame, names in _rows(reader, unpack):
                    topics.setdefault(name, _Topic(name, kind, names)).add(kind, row, frame)
    except (PermissionError, TooTightlyPackedError, UnsoundDatabaseError, UnlistedPartError):
        raise
    except Exception as error:  # what a foreign file makes a foreign parser raise is of many kinds
        remedy = "; was the recording cut off? try: mcap recover FILE" if path.suffix == ".mcap" else ""
        spent = isinstance(error, MemoryError)  # as of a length that is damaged
        reason = "it asks for more memory than there is" if spent else " ".join(str(error).split())[:200]
        raise ValueError(f"{path}: {DAMAGED} ({reason}){remedy}") from None
    each = [(name, one, values) for name, topic in topics.items() for one, values in topic.columns().items()]
    refused = {name: topic.refused for name, topic in topics.items() if topic.refused}
    if not each:
        wanted = "expected topics with numbers, such as geometry_msgs/PoseStamped, found none"
        raise ValueError(f"{path}: {next(iter(refused.values()), wanted)}")
    columns = named_once(path, ((f"{name}/{one}", values) for name, one, values in each))
    frames = {name: topic.frames() for name, topic in topics.items()}
    named = {f"{name}/{one}": name for name, one, _ in each}
    return Table(path, columns, {}, {}, 0, named, frames, refused=refused)


@contextmanager
def _storages(path: Path) -> Iterator[tuple[list[Path], Unpacking, str]]:
    """Give the files that hold the messages of a bag, what measures them, and whether messages are packed one by one.

    Files that were packed whole are unpacked into a folder of their own, for as long as they are read.
    """
    if path.is_file():
        yield [path], Unpacking(path, path.stat().st_size), ""
        return
    described: Any = read_yaml(path / METADATA)
    try:
        about = described["rosbag2_bagfile_information"]
        listed = [path / name for name in dict.fromkeys(Path(str(one)).name for one in about["relative_file_paths"])]
        packed, mode = about.get("compression_format"), str(about.get("compression_mode") or "").lower()
    except (KeyError, TypeError, AttributeError):
        raise ValueError(f"{METADATA} lists no files") from None
    if missing := [one.name for one in listed if not one.is_file()]:
        raise ValueError(f"no file {', '.join(missing)}, which {METADATA} lists")
    seen = [one.name for one in path.iterdir() if not one.name.startswith(".")]  # macOS leaves ._NAME beside NAME
    beside = {name for name in seen if name.removesuffix(f".{FORMAT}").endswith(PARTS)}
    known = {one.name.removesuffix(f".{FORMAT}") for one in listed}  # players leave what they have unpacked
    if unlisted := sorted(name for name in beside if name.removesuffix(f".{FORMAT}") not in known):
        raise UnlistedPartError(
            f"{path}: expected the files that {METADATA} lists ({', '.join(one.name for one in listed)}), "
            f"found {', '.join(unlisted)} beside them; list them all (ros2 bag reindex), or move away what is no part"
        )
    if mode in ("file", "message") and packed != FORMAT:
        raise ValueError(f"compression {packed!r}, expected {FORMAT}")
    unpacking = Unpacking(path, sum(one.stat().st_size for one in listed))
    if mode != "file":
        yield listed, unpacking, mode
        return
    with TemporaryDirectory() as folder:
        files = [Path(folder) / one.stem for one in listed]
        for one, whole in zip(listed, files, strict=True):
            with one.open("rb") as source, whole.open("wb") as target:
                target.writelines(unpacking.blocks(FORMAT, source))
        yield files, unpacking, mode


@contextmanager
def _unpacked_by(unpacking: Unpacking) -> Iterator[None]:
    """Let rosbags unpack the chunks of .mcap and .bag files by what measures them: its own way knows no limit."""
    from rosbags.rosbag1 import reader
    from rosbags.rosbag2 import storage_mcap

    tables: list[dict[str, Any]] = [reader.decompressors, storage_mcap.DECOMPRESSORS]
    before = [dict(one) for one in tables]
    for one in tables:
        one.update({kind: _unpacker(unpacking, kind) for kind in one.keys() & OPENERS.keys()})
    try:
        yield
    finally:
        for one, old in zip(tables, before, strict=True):
            one.update(old)


def _unpacker(unpacking: Unpacking, kind: str) -> Callable[..., bytes]:
    """Return what unpacks a chunk; of the size that a chunk promises nothing is believed."""
    return lambda data, *_: unpacking.unpack(kind, data)


class _Topic:
    """The rows of one topic, or of one child frame."""

    def __init__(self, name: str, kind: str, names: Sequence[str]) -> None:
        self._name, self._kind, self.refused = name, kind, ""
        self._names, self._rows, self._frames = [*names, RECEIVED], list[Row](), dict[str, None]()

    def add(self, kind: str, row: Row, frame: str) -> None:
        """Take a row of a message of some type, and the frame that it is in.

        Where those before are of another type, numbers have several meanings, and none can be used: `refused` says so.
        """
        if kind != self._kind and not self.refused:
            self._rows.clear()
            self.refused = (
                f"expected messages of one type on {self._name}, found {self._kind} and {kind}; write the topic into a "
                "bag of its own with one of them"
            )
        if self.refused:
            return
        self._rows.append(row)
        if frame.strip("/"):
            self._frames[frame.strip("/")] = None

    def frames(self) -> tuple[str, ...]:
        """Return the frames of all rows."""
        return tuple(self._frames)

    def columns(self) -> dict[str, Array]:
        """Return values by name, in the order of stamps, what was sent twice once.

        Stamps that are alike in all messages were never set: what was sent says nothing of when it was measured.
        """
        if self.refused:
            return {}
        values = np.array(self._rows, dtype=np.float64)
        if STAMP in self._names and np.ptp(values[:, self._names.index(STAMP)]) > 0:
            values = values[np.argsort(values[:, self._names.index(STAMP)], kind="stable")]
            again = np.append(False, (values[1:, :-1] == values[:-1, :-1]).all(1))
            values = values[~again]
        return dict(zip(self._names, values.T, strict=True))


def _rows(
    reader: AnyReader, unpack: Callable[[bytes], bytes] | None
) -> Iterator[tuple[str, str, Row, str, Sequence[str]]]:
    """Yield name of the topic (and child frame), type, values, frame, and names of values, message by message."""
    kinds = {one.msgtype for one in reader.connections}
    leaves = {
        kind: dict(_leaves(reader, TRANSFORM if kind == TRANSFORMS else kind))
        for kind in kinds
        if kind == TRANSFORMS or not _is_bulk(reader, kind)
    }
    wanted = [one for one in reader.connections if leaves.get(one.msgtype)]
    for connection, logged, raw in reader.messages(wanted) if wanted else ():
        message: Any = reader.deserialize(unpack(raw) if unpack else raw, connection.msgtype)
        own, topic = leaves[connection.msgtype], connection.topic
        for one in message.transforms if connection.msgtype == TRANSFORMS else [message]:
            name = f"{topic}/{one.child_frame_id.strip('/')}" if connection.msgtype == TRANSFORMS else topic
            frame = getattr(getattr(one, "header", None), "frame_id", "")
            yield name, connection.msgtype, (*(get(one) for get in own.values()), 1e-9 * logged), frame, list(own)


def _is_bulk(reader: AnyReader, kind: str) -> bool:
    """Tell whether messages are images or clouds: whether a sequence of bytes stands in them."""
    from rosbags.interfaces import Nodetype

    fields = [described for _, described in reader.typestore.get_msgdef(kind).fields]
    inside: list[Any] = [described[1][0] for described in fields if described[0] == Nodetype.SEQUENCE]
    return any(one[0] == Nodetype.BASE and one[1][0] in BYTES for one in inside)


def _leaves(reader: AnyReader, kind: str, before: tuple[str, ...] = ()) -> Iterator[tuple[str, Getter]]:
    """Yield each number within a message: its name, and what gets it."""
    from rosbags.interfaces import Nodetype

    fields: list[tuple[str, Any]] = list(reader.typestore.get_msgdef(kind).fields)
    for name, (sort, inside) in fields:
        place = (*before, name)
        written, get = "/".join(place), attrgetter(".".join(place))
        if sort == Nodetype.BASE and inside[0] not in TEXTS:
            yield written, get
        elif sort == Nodetype.NAME and inside in TIMES:
            yield written, _seconds(get)
        elif sort == Nodetype.NAME:
            yield from _leaves(reader, inside, place)
        elif sort == Nodetype.ARRAY and inside[1] <= MOST_ELEMENTS and _is_number(inside[0]):
            yield from ((f"{written}[{index}]", _element(get, index)) for index in range(inside[1]))


def _is_number(described: Any) -> bool:
    """Tell whether the elements of an array are numbers, and no bytes or texts."""
    from rosbags.interfaces import Nodetype

    return bool(described[0] == Nodetype.BASE and described[1][0] not in (*BYTES, *TEXTS))


def _seconds(get: Callable[[Any], Any]) -> Getter:
    """Return what gets a stamp as seconds."""
    return lambda message: float(get(message).sec) + 1e-9 * float(get(message).nanosec)


def _element(get: Callable[[Any], Any], index: int) -> Getter:
    """Return what gets an element of an array."""
    return lambda message: float(get(message)[index])
