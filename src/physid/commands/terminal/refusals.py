"""What the system refuses, in words: which file or folder, and what to do about it."""

from __future__ import annotations

import errno
import os
from pathlib import Path

from physid.one_writer import LOCK

DENIED = (errno.EACCES, errno.EPERM, errno.EROFS)
FULL = (errno.ENOSPC, errno.EDQUOT)


def worded(error: OSError) -> str:
    """Say what the system has refused.

    Args:
        error: What came; an error that says in its own words what it expected is left as it is.

    Returns:
        The message. Names of files that are physid's own business, such as `.part`, are not in it.
    """
    if error.errno is None or not isinstance(error.filename, str | os.PathLike):
        return str(error)
    from physid.data.files import PART

    path = Path(error.filename)
    path = path.with_name(path.name.removesuffix(PART))
    path = path.parent if path.name == LOCK else path
    reason = (error.strerror or type(error).__name__).lower()
    if error.errno in DENIED:
        return _denied(path, reason)
    if error.errno in FULL:
        return f"{path}: expected room on the disk, found none ({reason}); free some, or choose another --out"
    return f"{path}: {reason}"


def _denied(path: Path, reason: str) -> str:
    """Say what may not be read or written: a file that is there, or the folder that it should be in."""
    if path.exists() and not os.access(path, os.R_OK):
        right = "u+rx" if path.is_dir() else "u+r"
        return (
            f"{path}: expected one that may be read, found that it may not be ({reason}); change its permissions "
            f"(chmod {right} {path}), or name another"
        )
    folder = next((each for each in (path, *path.parents) if each.is_dir()), path.parent)
    return (
        f"{path}: expected a place that may be written to, found that {folder} may not be ({reason}); choose another "
        f"--out, or change the permissions of {folder} (chmod u+rwx {folder})"
    )
