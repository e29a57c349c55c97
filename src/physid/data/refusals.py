"""What the system refuses, in words: which file or folder, and what to do about it."""

from __future__ import annotations

import errno
import os
from pathlib import Path

from physid.data.files import PART
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
        f"--out, or change the permissions of {folder} (chmod u+rwx {folder})"
    )
