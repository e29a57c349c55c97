"""One writer for each folder: a lock that the kernel takes back when the process that holds it dies."""

from __future__ import annotations

import errno
import fcntl
import os
import shlex
import socket
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path

LOCK = ".lock"
MOST_SHOWN = 300
"""Letters of what a lock file says; another program may have written it."""
UNSUPPORTED = (errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS)


class FolderInUseError(ValueError):
    """A folder that another process is writing into; the message names the process."""


@contextmanager
def one_writer(folder: Path) -> Iterator[None]:
    """Be the only process that writes into a folder; the folder is made if it is not there.

    The lock is flock(2) on the file .lock in the folder. Its holder's name in the file is for people: a process that
    was killed leaves the file, and the next one takes the lock all the same. Of processes that are parts of one job,
    say the ranks of a distributed fit, only the first comes here.

    Args:
        folder: The folder.

    Raises:
        FolderInUseError: If another process writes into it.
        OSError: If nothing can be written there.
    """
    made = not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    lock = _locked(folder)
    try:
        yield
    finally:
        # The file goes before the lock: who opened it meanwhile finds that it lies nowhere and opens another.
        (folder / LOCK).unlink(missing_ok=True)
        os.close(lock)
        if made:
            with suppress(OSError):  # a folder in which something has been written stays
                folder.rmdir()


def _locked(folder: Path) -> int:
    """Return the descriptor of a lock file that this process has locked, and that still lies in the folder."""
    path = folder / LOCK
    while True:
        file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o644)
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if _still_lies(path, file):
                os.ftruncate(file, 0)
                os.pwrite(file, _myself().encode(), 0)
                return file
        except BlockingIOError:
            holder = os.pread(file, MOST_SHOWN, 0).decode(errors="replace").strip()
            os.close(file)
            raise FolderInUseError(
                f"{folder} is being written by {holder or 'another process'}; wait until it has ended, stop it, or "
                "choose another folder"
            ) from None
        except OSError as error:
            if error.errno not in UNSUPPORTED:
                os.close(file)
                raise
            warnings.warn(f"{folder}: its file system has no locks; let no second process write there", stacklevel=4)
            return file
        os.close(file)


def _still_lies(path: Path, file: int) -> bool:
    """Tell whether an open file is the one that a path names: its last holder may have taken it away."""
    try:
        return os.path.samestat(os.fstat(file), path.lstat())
    except FileNotFoundError:
        return False


def _myself() -> str:
    """Name this process: number, machine, command and time."""
    command = shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]])
    started = datetime.now(UTC).isoformat(timespec="seconds")
    return f"process {os.getpid()} on {socket.gethostname()} since {started} ({command})\n"[:MOST_SHOWN]
