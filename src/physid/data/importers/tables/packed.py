"""What packed logs unpack to: measured as it comes, so that a small file never fills the memory or the disk."""

from __future__ import annotations

import hashlib
import importlib
import io
import sys
from collections import OrderedDict
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

from physid.data.hdf5 import most_unpacked

OPENERS = {
    "zstd": "compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd",
    "lz4": "lz4.frame",
    "bz2": "bz2",
}
"""The modules whose `open` unpacks, by the names that bags have for them; rosbags brings those of others."""
BLOCK = 1 << 20  # bytes
CHUNKS = 8  # unpacked last, which readers go back to; each is no more than all may be


class TooTightlyPackedError(ValueError):
    """A log that unpacks to far more than motion does."""


class Unpacking:
    """Unpacks a log, as long as all of it together is no more than its size promises (see `most_unpacked`)."""

    def __init__(self, path: Path, held: int) -> None:
        """Begin.

        Args:
            path: The log, for the message.
            held: Its bytes on the disk.
        """
        self._path, self._held, self._taken = path, held, 0
        self._counted: set[bytes] = set()
        self._kept: OrderedDict[bytes, bytes] = OrderedDict()

    def blocks(self, kind: str, file: IO[bytes]) -> Iterator[bytes]:
        """Yield what a file unpacks to, block by block.

        Raises:
            ValueError: If it is more than may be.
        """
        most = most_unpacked(self._held)
        stream: Any
        with importlib.import_module(OPENERS[kind]).open(file) as stream:
            while block := stream.read(BLOCK):
                self._taken += len(block)
                if self._taken > most:
                    raise TooTightlyPackedError(
                        f"{self._path}: expected a log that unpacks to {most} bytes at most, found more "
                        f"in its {self._held}; if it is sound, unpack it first: mcap decompress, rosbag "
                        "decompress, zstd -d, or ros2 bag convert"
                    )
                yield block

    def unpack(self, kind: str, data: bytes) -> bytes:
        """Return what bytes unpack to; a chunk that is asked for again and again, as by topics in turn, counts once.

        Raises:
            ValueError: If it is more than may be.
        """
        key, before = hashlib.sha256(data).digest(), self._taken
        if key in self._kept:
            self._kept.move_to_end(key)
            return self._kept[key]
        self._kept[key] = b"".join(self.blocks(kind, io.BytesIO(data)))
        if key in self._counted:
            self._taken = before
        self._counted.add(key)
        if len(self._kept) > CHUNKS:
            self._kept.popitem(last=False)
        return self._kept[key]
