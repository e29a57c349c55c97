"""A bar on a terminal; where there is none, in a log, a line of it from time to time."""

from __future__ import annotations

import io
import sys
import time
from collections.abc import Iterable
from contextlib import suppress
from threading import Lock, Timer
from typing import TYPE_CHECKING, Any, TextIO

if TYPE_CHECKING:
    from tqdm import tqdm

EVERY = 10.0  # [s] least time between two lines of a log, and before the first: what ends sooner needs none

UP = "\x1b[A"  # ECMA-48: the cursor goes up by a line


class LogLines(io.TextIOBase):
    """A stream that turns what is redrawn with carriage returns into lines, at most one every `EVERY` seconds.

    What is drawn sooner waits, and the newest of it is written once the time has come, unless nothing is drawn any more
    by then. A log that cannot be written, say on a full disk, disturbs nothing.

    Args:
        stream: Where the lines go.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream, self._last = stream, time.monotonic()
        self._waiting, self._lock = "", Lock()
        self._timer: Timer | None = None

    def write(self, text: str) -> int:
        """Draw a text in place of the one before; a blank one takes it away."""
        if text and not text.replace(UP, "").strip("\n"):  # tqdm moves to the line of another bar
            return len(text)
        with self._lock:
            self._waiting, left = " ".join(text.split()), self._last + EVERY - time.monotonic()
            if left <= 0:
                self._put()
            if not self._waiting and self._timer is not None:
                self._timer.cancel()
                self._timer = None
            elif self._waiting and self._timer is None:
                self._timer = Timer(left, self._due)
                self._timer.daemon = True
                self._timer.start()
        return len(text)

    def _due(self) -> None:
        """Write what waits, as its time has come."""
        with self._lock:
            self._timer = None
            self._put()

    def _put(self) -> None:
        """Write what waits."""
        if self._waiting:
            with suppress(OSError, ValueError):  # a full disk, a reader that has gone, a stream that was closed
                self._stream.write(self._waiting + "\n")
                self._stream.flush()
            self._waiting, self._last = "", time.monotonic()


def on_terminal() -> bool:
    """Return whether standard error is a terminal, where a bar can be redrawn."""
    asked = getattr(sys.stderr, "isatty", None)
    return asked is not None and not _closed() and bool(asked())


def _closed() -> bool:
    return sys.stderr is None or getattr(sys.stderr, "closed", False)


def progress_bar(tasks: Iterable[Any] | None = None, *, quiet: bool, **options: Any) -> tqdm[Any]:
    """Return tqdm's bar on standard error, over tasks if there are any; in a log it is lines (see `LogLines`).

    Args:
        tasks: What it counts as they are done.
        quiet: Whether to show nothing.
        options: More options of tqdm.
    """
    import tqdm

    quiet = quiet or _closed()
    if not quiet and not on_terminal():
        options |= {"file": LogLines(sys.stderr), "leave": False}
    return tqdm.tqdm(tasks, disable=quiet, **options)
