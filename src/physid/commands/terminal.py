"""What a terminal shows: colours (not in a pipe, nor where NO_COLOR asks for none), and how to go on after Ctrl-C."""

from __future__ import annotations

import os
import signal
import sys
from _thread import interrupt_main
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Timer, current_thread, main_thread
from types import FrameType
from typing import TYPE_CHECKING, Literal, TextIO

if TYPE_CHECKING:
    from sys import UnraisableHookArgs

SOON = 0.01  # [s]
CODES = {"bold": 1, "red": 31, "green": 32}


def styled(text: str, style: Literal["bold", "red", "green"], stream: TextIO) -> str:
    """Return a text as a stream can show it: with ECMA-48's escape sequences on a terminal, else unchanged."""
    plain = os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb" or not stream.isatty()
    return text if plain else f"\x1b[{CODES[style]}m{text}\x1b[0m"


@contextmanager
def resumable() -> Iterator[None]:
    """Let Ctrl-C say that the same command goes on where it stopped.

    Raises:
        KeyboardInterrupt: If it was pressed.
    """
    try:
        yield
    except KeyboardInterrupt:
        raise KeyboardInterrupt("the same command goes on where it stopped") from None


@contextmanager
def interruptible() -> Iterator[None]:
    """Let no Ctrl-C be lost: Python ignores what is raised in a destructor, or as a weak reference dies.

    Raises:
        KeyboardInterrupt: If it was pressed.
    """
    before = sys.unraisablehook

    def again(ignored: UnraisableHookArgs) -> None:
        if isinstance(ignored.exc_value, KeyboardInterrupt):
            Timer(SOON, interrupt_main).start()
        else:
            before(ignored)

    sys.unraisablehook = again
    try:
        yield
    finally:
        sys.unraisablehook = before


@contextmanager
def terminable() -> Iterator[list[int]]:
    """Let SIGTERM do what Ctrl-C does: what runs is left in order, and nothing waits for a loop that does not look.

    Lightning catches SIGTERM and looks for it between the epochs of a fit alone. Under SLURM the signal is left to
    Lightning, which puts a job back into the queue.

    Yields:
        A list that holds the signal once it has come.
    """
    came: list[int] = []
    if "SLURM_JOB_ID" in os.environ or current_thread() is not main_thread():
        yield came
        return

    def stop(number: int, _: FrameType | None) -> None:
        if not came:  # the second of two would interrupt the tidying up after the first
            came.append(number)
            raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield came
    finally:
        signal.signal(signal.SIGTERM, before)


@contextmanager
def frame_bar(quiet: bool) -> Iterator[Callable[[str, int, int], None]]:
    """Show a progress bar over frames; gives what is to be told the task, how many frames are done, and of how many."""
    from tqdm import tqdm

    with tqdm(unit="frame", disable=quiet or None) as bar:
        shown = ""

        def say(task: str, done: int, total: int) -> None:
            nonlocal shown
            if task != shown:
                shown = task
                bar.reset(total)
                bar.set_description(task)
            bar.update(done - bar.n)

        yield say
