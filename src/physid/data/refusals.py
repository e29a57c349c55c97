"""What the system refuses, in words: which file or folder, and what to do about it."""

from __future__ import annotations

import errno
import os
import re
from pathlib import Path

from physid.data.files import PART, UNFINISHED
from physid.one_writer import LOCK
from physid.strict import shown

DENIED = (errno.EACCES, errno.EPERM, errno.EROFS)
SPENT = ("can't allocate memory", "not enough memory", "out of memory")
"""What torch says where memory is short: on Linux, on Windows, and on an accelerator."""
FULL = (errno.ENOSPC, errno.EDQUOT)


class NoRoomError(MemoryError):
    """Memory that is short for one file; the message names it."""


def out_of_memory(error: Exception) -> bool:
    """Return whether an error says that the memory of the machine, or of its accelerator, is spent.

    Python and NumPy have an error of their own for it, torch has one for accelerators only.
    """
    if isinstance(error, OSError):
        return error.errno == errno.ENOMEM
    spent = isinstance(error, RuntimeError) and any(word in str(error) for word in SPENT)
    return spent or isinstance(error, MemoryError)


def worded(error: Exception) -> str:
    """Say what the system has refused.

    Args:
        error: What came: of the system, or of who wanted more memory than there is; an error that says in its own words
            what it expected is left as it is.

    Returns:
        The message. Names of files that are physid's own business, such as `.part`, are not in it.
    """
    if out_of_memory(error) and not isinstance(error, NoRoomError):
        wanted = re.search(r"(?:allocate|allocating) ([\d.]+ ?\w*)", str(error))
        return (
            f"memory: expected room for {wanted[1] if wanted else 'what was asked for'}, found none; ask for less at "
            "once, by what the command has of limit, trajectories, steps, batch_size, substeps and workers (its --help)"
        )
    if isinstance(error, UnicodeEncodeError):
        return f"expected names of files and folders in UTF-8, found {shown(error.object)}; rename what is called so"
    if not isinstance(error, OSError) or error.errno is None or not isinstance(error.filename, str | os.PathLike):
        return str(error)
    path = Path(error.filename)
    path = path.parent if path.name in (LOCK, UNFINISHED) else path
    path = path.with_name(path.name.removesuffix(PART)) if path.name else path
    reason = (error.strerror or type(error).__name__).lower()
    if error.errno in DENIED:
        return _denied(path, reason)
    if error.errno in FULL:
        return f"{path}: expected room on the disk, found none ({reason}); free some, or choose another folder"
    return f"{path}: {reason}"


def _denied(path: Path, reason: str) -> str:
    """Say what may not be read or written: a file that is there, or the folder that it should be in."""
    # os.path answers where Path.exists raises: in a folder that may not be looked into.
    folder = next((each for each in (path, *path.parents) if os.path.isdir(each)), path.parent)
    shut = folder if not os.access(folder, os.R_OK | os.X_OK) else path
    if os.path.exists(shut) and not os.access(shut, os.R_OK):
        right = "u+rx" if shut == folder else "u+r"
        whose = "it" if shut == path else str(shut)
        return (
            f"{path}: expected what may be read, found that {whose} may not be ({reason}); change its permissions "
            f"(chmod {right} {shut}), or name another"
        )
    return (
        f"{path}: expected a place that may be written to, found that {folder} may not be ({reason}); choose another "
        f"folder, or change the permissions of {folder} (chmod u+rwx {folder})"
    )
