"""What a terminal shows: colours (not in a pipe, nor where NO_COLOR asks for none), and how to go on after Ctrl-C."""

from __future__ import annotations

import os
import signal
import sys
from _thread import interrupt_main
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from io import TextIOWrapper
from threading import Timer, current_thread, main_thread
from types import FrameType
from typing import TYPE_CHECKING, Literal, TextIO

from physid.progress.bar import on_terminal, progress_bar
from physid.strict import one_line

if TYPE_CHECKING:
    from sys import UnraisableHookArgs

    from physid.diagnosis.progress import Progress, Stage

SOON = 0.01  # [s]
BAR, LONGEST = "{desc} {percentage:3.0f}% {bar:20} {elapsed}", 44  # of the stages of a diagnosis
LINE = "{desc}, {percentage:.0f} %"  # of one in a log
CODES = {"bold": 1, "red": 31, "green": 32}


def styled(text: str, style: Literal["bold", "red", "green"], stream: TextIO) -> str:
    """Return a text as a stream can show it: with ECMA-48's escape sequences on a terminal, else unchanged."""
    plain = os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb" or not stream.isatty()
    return text if plain else f"\x1b[{CODES[style]}m{text}\x1b[0m"


def write_any_sign() -> None:
    """Let a stream that cannot write a sign, say the mu of micrometres in ASCII, write how it is escaped."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            with suppress(OSError):  # of a stream that another has taken the place of
                stream.reconfigure(errors="backslashreplace")


def say(*lines: object) -> None:
    """Print lines; what is not seen is escaped, since names in them may be a stranger's."""
    print(*(one_line(str(each)) for each in lines), sep="\n")


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
def stoppable() -> Iterator[list[int]]:
    """Let SIGTERM do what Ctrl-C does, and remember both: what runs is left in order.

    Lightning catches SIGTERM and looks for it between the epochs of a fit alone; under SLURM the signal is left to
    Lightning, which puts a job back into the queue. A library that is interrupted while it is imported may turn the
    KeyboardInterrupt into an error of its own.

    Yields:
        A list of the signals that have come.
    """
    came: list[int] = []
    if current_thread() is not main_thread():
        yield came
        return

    def stop(number: int, _: FrameType | None) -> None:
        first = number not in came
        came.append(number)
        if first or number == signal.SIGINT:  # the second SIGTERM would interrupt the tidying up after the first
            raise KeyboardInterrupt

    usual = {signal.SIGINT: signal.default_int_handler, signal.SIGTERM: signal.SIG_DFL}
    if "SLURM_JOB_ID" in os.environ:
        del usual[signal.SIGTERM]
    # A signal that is ignored, say after nohup, stays so.
    before = {each: signal.signal(each, stop) for each, handler in usual.items() if signal.getsignal(each) == handler}
    try:
        yield came
    finally:
        for each, handler in before.items():
            signal.signal(each, handler)


@contextmanager
def stage_bar(quiet: bool) -> Iterator[Progress]:
    """Show the stages of a diagnosis, and about how far it is; gives what takes the stages."""
    seen = on_terminal()
    with progress_bar(quiet=quiet, total=100, desc="starting", bar_format=BAR if seen else LINE) as bar:

        def say(stage: Stage, what: str = "") -> None:
            if bar.disable:  # a bar that is not shown has hardly an attribute
                return
            bar.n = max(bar.n, stage.share)
            said = stage.about(what)
            bar.set_description_str(said[:LONGEST].ljust(LONGEST) if seen else said)

        yield say


@contextmanager
def frame_bar(quiet: bool) -> Iterator[Callable[[str, int, int], None]]:
    """Show a progress bar over frames; gives what takes the task, how many frames are done, and of how many."""
    with progress_bar(quiet=quiet, unit="frame") as bar:
        shown = ""

        def say(task: str, done: int, total: int) -> None:
            nonlocal shown
            if bar.disable:  # a bar that is not shown has hardly an attribute
                return
            if task != shown:
                bar.set_description_str(task, refresh=False)
            if total != bar.total:
                bar.reset(total)
            if task != shown:  # what it finds done took none of the time of this bar
                shown = task
                bar.initial += done - bar.n
                bar.n = bar.last_print_n = done
                bar.refresh()
            bar.update(done - bar.n)

        yield say
