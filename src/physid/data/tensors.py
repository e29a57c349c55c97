"""What `torch.save` wrote, inspected before torch reads it: plain values and tensors that the file itself holds.

torch's own restriction (`weights_only`) keeps code out, not size: a file of some kilobytes may ask for gigabytes as a
`bytearray(n)`, as compressed zeros, as a tensor larger than its storage, or as lists of lists that are the same one.
So the pickle in the archive is first read into a skeleton in which tensors are marks, by steps that allocate nothing
beyond what they read.
"""

from __future__ import annotations

import io
import math
import pickle  # nosec B403 - the steps that are taken from it make plain values only
from collections import OrderedDict
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, ClassVar
from zipfile import ZIP_STORED, ZipFile

from physid.strict import shown
from physid.yaml_files import open_regular

LARGEST_PICKLE = 2**26
"""[bytes] of the part that says what the tensors are, and of plain values."""
ROOM = 2**26
TIMES = 4
"""What is in a file takes no more than `ROOM` bytes beside `TIMES` its own size, however often it repeats a part."""
VALUE = 8
"""[bytes] that a plain value takes at least."""
LEVELS = 64
DIMENSIONS = 64
PICKLE = "data.pkl"
WIDTHS = {
    "BoolStorage": 1, "ByteStorage": 1, "CharStorage": 1, "ShortStorage": 2, "HalfStorage": 2, "BFloat16Storage": 2,
    "IntStorage": 4, "FloatStorage": 4, "LongStorage": 8, "DoubleStorage": 8, "ComplexFloatStorage": 8,
    "ComplexDoubleStorage": 16,
}  # fmt: skip
"""[bytes] of a value of torch's storages."""
TYPES = (
    "bool", "uint8", "int8", "int16", "int32", "int64", "float16", "bfloat16", "float32", "float64", "complex64",
    "complex128",
)  # fmt: skip
STEPS = (
    "PROTO", "STOP", "MARK", "EMPTY_DICT", "EMPTY_LIST", "EMPTY_TUPLE", "TUPLE", "TUPLE1", "TUPLE2", "TUPLE3", "NONE",
    "NEWTRUE", "NEWFALSE", "BININT", "BININT1", "BININT2", "LONG1", "BINFLOAT", "BINUNICODE", "BINPUT", "LONG_BINPUT",
    "BINGET", "LONG_BINGET", "APPEND", "APPENDS", "GLOBAL", "BINPERSID",
)  # fmt: skip
"""What `torch.save` writes of the language of pickles; SETITEM, SETITEMS, REDUCE and BUILD are taken in ways of our
own."""
SCALARS = (str, int, float, type(None))
"""Kinds of names in mappings."""
Maker = Callable[..., Any]


class UnusualContentError(ValueError):
    """A file that holds what no checkpoint needs; the message says what."""


class _Mark:
    """A tensor, or a type of one, of which only the size counts."""

    def __init__(self, size: int = VALUE) -> None:
        self.size = size


class _Storage:
    """The values of tensors: how many there are, of so many bytes each."""

    def __init__(self, count: int, width: int) -> None:
        self.count, self.width = count, width


def require_modest_tensors(path: Path) -> None:
    """Check that a file that torch wrote asks for no more than it holds, before torch reads it.

    Args:
        path: An archive of `torch.save`; what torch wrote before its version 1.6 is none, and is refused.

    Raises:
        OSError: If it cannot be read, or is no regular file.
        UnusualContentError: If it is damaged, holds something else, or asks for more.
    """
    try:
        _look(path)
    except (OSError, MemoryError, UnusualContentError):
        raise
    except Exception as error:  # zipfile and pickle have many errors for what is no file of theirs
        raise UnusualContentError((str(error).splitlines() or [type(error).__name__])[0]) from None


def _look(path: Path) -> None:
    """Read the skeleton, and weigh it."""
    with open_regular(path) as file, ZipFile(file) as archive:
        size = file.seek(0, io.SEEK_END)
        entries = archive.infolist()
        if any(each.compress_type != ZIP_STORED for each in entries) or archive.comment:
            raise UnusualContentError("compressed entries")
        if sum(each.file_size for each in entries) > size:
            raise UnusualContentError("entries of more than the whole file")
        sizes = {each.filename.partition("/")[2]: each.file_size for each in entries}
        folders = {each.filename.partition("/")[0] for each in entries}
        if len(folders) != 1 or len(sizes) != len(entries) or PICKLE not in sizes:
            raise UnusualContentError("another layout than torch's")
        if sizes[PICKLE] > LARGEST_PICKLE:
            raise UnusualContentError(f"plain values of more than {LARGEST_PICKLE} bytes")
        content = archive.read(f"{folders.pop()}/{PICKLE}")
    skeleton = _Skeleton(io.BytesIO(content), sizes)
    parts = [skeleton.load(), *skeleton.beside]
    if _weigh(parts, 0, {})[0] > ROOM + TIMES * size:
        raise UnusualContentError("parts that repeat beyond any measure")
    _require_same(path, content)


def _require_same(path: Path, content: bytes) -> None:
    """Check that torch's reader of archives finds the same pickle as Python's."""
    import torch

    with open_regular(path) as file:
        found = torch._C.PyTorchFileReader(file).get_record(PICKLE)
    if found != content:
        raise UnusualContentError("two contents in one archive")


class _Skeleton(pickle._Unpickler):
    """Python's reader of pickles with the few steps of `STEPS`, whose tensors are marks and whose classes are ours.

    Args:
        content: The pickle.
        sizes: Bytes of each entry of the archive.

    Attributes:
        beside: What is kept beside the entries of mappings (`_metadata` of a state_dict).
    """

    dispatch: ClassVar[dict[int, Callable[[Any], None]]] = {
        code: step
        for code, step in pickle._Unpickler.dispatch.items()
        if code in {getattr(pickle, name)[0] for name in STEPS}
    }
    stack: list[Any]
    pop_mark: Callable[[], list[Any]]

    def __init__(self, content: io.BytesIO, sizes: Mapping[str, int]) -> None:
        super().__init__(content)
        self._sizes = sizes
        self.beside: list[Any] = []

    def find_class(self, module: str, name: str) -> Any:
        """Return what stands for a class or a function of torch."""
        if module == "torch" and name in WIDTHS:
            return WIDTHS[name]
        if module == "torch" and name in TYPES:
            return _Mark()
        if (module, name) not in MAKERS:
            raise UnusualContentError(f"{shown(f'{module}.{name}')}, which no checkpoint needs")
        return MAKERS[module, name]

    def persistent_load(self, pid: Any) -> _Storage:
        """Return the values that an entry of the archive holds."""
        _, width, key, _, count = pid
        if not _is_count(count) or count * width > self._sizes[f"data/{key}"]:
            raise UnusualContentError(f"{shown(count)} values in an entry that holds fewer")
        return _Storage(count, width)

    def set_items(self, items: list[Any]) -> None:
        """Add entries to a mapping; their names are plain, since others may take for ever to be hashed."""
        mapping = self.stack[-1]
        if not isinstance(mapping, dict):
            raise UnusualContentError("entries of what is no mapping")
        for key, value in zip(items[::2], items[1::2], strict=True):
            if not isinstance(key, SCALARS):
                raise UnusualContentError("a mapping whose names are neither texts nor numbers")
            mapping[key] = value

    def set_item(self) -> None:
        """Add one entry."""
        value, key = self.stack.pop(), self.stack.pop()
        self.set_items([key, value])

    def reduce(self) -> None:
        """Make what one of our own makers makes."""
        arguments, maker = self.stack.pop(), self.stack[-1]
        if not any(maker is each for each in MAKERS.values()):
            raise UnusualContentError("a call of what is no function of torch's")
        self.stack[-1] = maker(*arguments)

    def build(self) -> None:
        """Keep what stands beside the entries of a mapping; a tensor would be made anew."""
        state = self.stack.pop()
        if not isinstance(self.stack[-1], OrderedDict):
            raise UnusualContentError("a change of what is no mapping")
        self.beside.append(state)


_Skeleton.dispatch |= {
    pickle.SETITEM[0]: _Skeleton.set_item,
    pickle.SETITEMS[0]: lambda skeleton: skeleton.set_items(skeleton.pop_mark()),
    pickle.REDUCE[0]: _Skeleton.reduce,
    pickle.BUILD[0]: _Skeleton.build,
}


def _tensor(storage: Any, offset: Any, size: Any, stride: Any, *rest: Any) -> _Mark:
    """Return the mark of a tensor, after a look at whether its storage has all of it."""
    if not isinstance(storage, _Storage) or len(size) != len(stride) or len(size) > DIMENSIONS:
        raise UnusualContentError("a tensor without a storage")
    if not all(_is_count(each) for each in (offset, *size, *stride)):
        raise UnusualContentError("a tensor of a shape that is none")
    count = math.prod(size)
    last = offset + sum((each - 1) * step for each, step in zip(size, stride, strict=True))
    if count and last >= storage.count:
        raise UnusualContentError(f"a tensor of {shown(count)} values in a storage of {storage.count}")
    return _Mark(VALUE + count * storage.width)


def _plain(*arguments: Any) -> Any:
    """Return what an object is made of."""
    return list(arguments)


def _mapping() -> OrderedDict[Any, Any]:
    """Return a mapping, whose entries follow."""
    return OrderedDict()


def _counts(counts: Any) -> Any:
    """Return what is counted, whose names were inspected as they were set."""
    if not isinstance(counts, dict):
        raise UnusualContentError("counts of what is no mapping")
    return counts


def _set(items: Any) -> Any:
    """Return the items of a set, which are plain: others may take for ever to be hashed."""
    if not all(isinstance(each, SCALARS) for each in items):
        raise UnusualContentError("a set of what is neither texts nor numbers")
    return items


def _is_count(value: Any) -> bool:
    return type(value) is int and value >= 0


MAKERS: Mapping[tuple[str, str], Maker] = {
    ("collections", "OrderedDict"): _mapping,
    ("collections", "Counter"): _counts,
    ("__builtin__", "set"): _set,
    ("torch", "Size"): _plain,
    ("torch", "device"): _plain,
    ("__builtin__", "complex"): _plain,
    ("_codecs", "encode"): _plain,
    ("torch._utils", "_rebuild_tensor_v2"): _tensor,
    ("torch._utils", "_rebuild_parameter"): _plain,
}
"""What takes the place of the functions that checkpoints need."""


def _weigh(value: Any, level: int, known: dict[int, tuple[int, int] | None]) -> tuple[int, int]:
    """Return how many bytes a value takes where each of its parts is written out, and of how many levels it is.

    Args:
        value: The value; all parts of it stay alive, so that their identity names them.
        level: Where it stands.
        known: What was found already, by identity; None for what it stands in.
    """
    if isinstance(value, _Mark | str):
        return (value.size if isinstance(value, _Mark) else VALUE + len(value)), 0
    if not isinstance(value, dict | list | tuple):
        return VALUE, 0
    if id(value) not in known:
        known[id(value)] = None
        parts = (*value.keys(), *value.values()) if isinstance(value, dict) else value
        if level > LEVELS:
            raise UnusualContentError(f"more than {LEVELS} levels")
        found = [_weigh(each, level + 1, known) for each in parts]
        total = VALUE + sum(weight for weight, _ in found)
        known[id(value)] = total, 1 + max((depth for _, depth in found), default=0)
    weight = known[id(value)]
    if weight is None:
        raise UnusualContentError("a part that holds itself")
    if level + weight[1] > LEVELS:
        raise UnusualContentError(f"more than {LEVELS} levels")
    return weight
