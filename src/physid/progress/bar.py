"""A bar on a terminal; where there is none, in a log, a line of it from time to time."""

from __future__ import annotations

import io
import sys
import time
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, TextIO

if TYPE_CHECKING:
    from tqdm import tqdm

EVERY = 10.0  # [s] from one line of a log to the next at least, and to the first one: what is over sooner needs none


class LogLines(io.TextIOBase):
    """A stream that keeps what is drawn over itself, with carriage returns, as lines of their own, not too often.

    Args:
        stream: Where the lines go.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream, self._last = stream, time.monotonic()

    def write(self, text: str) -> int:
        """Write a line of what is drawn, unless it is blank or the last one is less than `EVERY` ago."""
        drawn = " ".join(text.split())
        if drawn and time.monotonic() - self._last >= EVERY:
            self._stream.write(drawn + "\n")
            self._stream.flush()
            self._last = time.monotonic()
        return len(text)


def progress_bar(tasks: Iterable[Any] | None = None, *, quiet: bool, **options: Any) -> tqdm[Any]:
    """Return tqdm's bar on standard error, over tasks if there are any; in a log it is lines (see `LogLines`).

    Args:
        tasks: What it counts as they are done.
        quiet: Whether to show nothing.
        options: More options of tqdm.
    """
    import tqdm

    if not sys.stderr.isatty():
        options |= {"file": LogLines(sys.stderr), "leave": False}
    return tqdm.tqdm(tasks, disable=quiet, **options)
