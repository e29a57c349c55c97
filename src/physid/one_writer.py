"""One writer for each folder, who writes through no link: a lock that the kernel takes back when its holder dies."""

from __future__ import annotations

import errno
import fcntl
import os
import shlex
import socket
import stat
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path

from physid.yaml_files import kind_of

LOCK = ".lock"
CHECKPOINT = Path("checkpoints", "last.ckpt")
"""In the folder of a run: from where it goes on."""
MOST_SHOWN = 300
"""Letters of what a lock file says; another program may have written it."""
UNSUPPORTED = (errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS)
EARLIER, UNFINISHED_MOVE = ".physid_earlier", ".physid_earlier.part"
"""Folders, in that of a run, of the run that it takes the place of; the latter while it is filled or emptied."""
LINKS_OF_ITS_OWN = ("wandb", f"{EARLIER}/wandb", f"{UNFINISHED_MOVE}/wandb")
"""The folders of Weights & Biases, which links to its latest run, and replaces such links whole."""


class FolderInUseError(ValueError):
    """A folder that another process is writing into; the message names the process."""


@contextmanager
def one_writer(folder: Path) -> Iterator[None]:
    """Be the only process that writes into a folder; the folder is made if it is not there.

    The lock is flock(2) on the file .lock in the folder. Its holder's name in the file is for people: a process that
    was killed leaves the file, and the next one takes the lock all the same. Of processes that are parts of one job,
    say the ranks of a distributed fit, only the first comes here.

    Args:
        folder: The folder; may itself be a link.

    Raises:
        FolderInUseError: If another process writes into it.
        OSError: If nothing can be written there, or it holds what `refuse_links` refuses.
    """
    made = not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    _require_lock_file(folder / LOCK)
    refuse_links(folder)
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


def refuse_links(folder: Path) -> None:
    """Refuse to write into a folder that holds a symbolic link out of it, a pipe, a socket or a device, however deep.

    Whoever sends a folder could lead what is written there to any file with a link, and let it wait with a pipe. The
    folder itself is named by the user, and may be a link; one that is not there holds nothing. A link to a file of the
    folder itself, as Lightning makes of its last checkpoint where it is asked to, leads nowhere else.

    Args:
        folder: Where something shall be written.

    Raises:
        OSError: If it holds one, or cannot be read; names it.
    """
    for path, mode in _entries(folder):
        if stat.S_ISLNK(mode) and _leads_to_file_of(folder, path):
            continue
        if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):
            raise OSError(
                f"{path}: expected nothing but files and folders where physid writes, found {kind_of(mode)}; "
                "nothing is written through links: put what it stands for in its place, delete it, or choose another "
                "folder"
            )


def _leads_to_file_of(folder: Path, link: str) -> bool:
    """Return whether a link leads to a regular file of a folder, whatever links lie on the way."""
    target = os.path.realpath(link)
    return Path(target).is_relative_to(os.path.realpath(folder)) and os.path.isfile(target)


def _entries(folder: Path) -> Iterator[tuple[str, int]]:
    """Yield path and mode of everything in a folder, however deep, but for what lies in `LINKS_OF_ITS_OWN`."""
    waiting, aside = [str(folder)], [os.path.join(folder, each) for each in LINKS_OF_ITS_OWN]
    while waiting:
        entries = list[os.DirEntry[str]]()
        with suppress(FileNotFoundError), os.scandir(waiting.pop()) as found:
            entries += found
        for entry in entries:
            with suppress(FileNotFoundError):  # another process may take one away meanwhile
                mode = entry.stat(follow_symlinks=False).st_mode
                yield entry.path, mode
                if stat.S_ISDIR(mode) and entry.path not in aside:
                    waiting.append(entry.path)


def _require_lock_file(path: Path) -> None:
    """Refuse what stands where the lock file should be, if it is none."""
    with suppress(FileNotFoundError):
        mode = path.lstat().st_mode
        if not stat.S_ISREG(mode):
            raise OSError(
                f"{path}: expected the file with which physid locks the folder, found {kind_of(mode)}; delete it"
            )


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
                raise OSError(error.errno, os.strerror(error.errno or 0), str(path)) from error
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
