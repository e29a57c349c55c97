"""Files and folders that are there whole or not at all."""

from __future__ import annotations

import hashlib
import io
import json
import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from physid.data.tensors import require_modest_tensors
from physid.one_writer import LOCK, one_writer
from physid.strict import shown
from physid.yaml_files import kind_of, open_regular, read_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PAGES, YAML = (".html", ".htm"), (".yaml", ".yml")
"""How names of files end that hold a page, or a description."""
PART = ".part"
"""How the name of a file or a folder ends that is being written."""
UNFINISHED = ".physid_unfinished"
"""Marks a folder that is being filled, which the next run may clear."""
ANYBODY = 0o666  # may read and write a new file, as far as the umask allows
DOTS = 130  # of pictures, to an inch


def require_ending(out: Path, *endings: str) -> None:
    """Refuse a file to write whose name does not say what will be in it.

    Raises:
        ValueError: If it ends in none of the endings.
    """
    if out.suffix.lower() not in endings:
        raise ValueError(f"--out must end in {', '.join(endings)}, got {out.name}")


def write_whole(path: Path, write: Callable[[Path], None]) -> None:
    """Write a file under a temporary name, flush it to the disk, then rename it.

    A run that is killed leaves the old file or none, and a `.part` that the next run overwrites; one that fails, say
    because the disk is full, leaves no `.part` either. What lies under the temporary name, say a link that came with a
    stranger's folder, is not written to but replaced; and so is `path`, if it is a link.

    Args:
        path: Where the file shall be.
        write: Writes the content to the path that it is given.

    Raises:
        OSError: If it cannot be written; the error names `path`, not its temporary name, unless a folder has that.
    """
    if not path.parent.is_dir():
        path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(path.name + PART)
    try:
        _begin(part)
        write(part)
        with part.open("rb+") as file:
            os.fsync(file.fileno())
    except BaseException as error:
        with suppress(OSError):  # a folder, or none of ours to delete: why it failed is said below
            part.unlink(missing_ok=True)
        if isinstance(error, OSError) and error.errno and error.filename in (None, str(part)):
            raise OSError(error.errno, os.strerror(error.errno), str(path)) from error
        raise
    part.replace(path)  # the folder is not flushed: should the power fail now, the file is simply not there


def _begin(part: Path) -> None:
    """Make the file that is to be written: a new one, that is no other by a second name."""
    if part.is_dir() and not part.is_symlink():
        raise OSError(f"{part}: expected the name of a file that is being written, found a folder; rename or delete it")
    part.unlink(missing_ok=True)
    os.close(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, ANYBODY))


def finish(folder: Path) -> None:
    """Take the mark from a folder that `whole_folder` had named, before it was killed, as the last of its steps."""
    with suppress(OSError):
        (folder / UNFINISHED).unlink()


def holds_anything(folder: Path) -> bool:
    """Return whether anything stands where a folder shall be filled; an empty folder is nothing."""
    return folder.exists() and (not folder.is_dir() or any(folder.iterdir()))


@contextmanager
def whole_folder(folder: Path, *, overwrite: bool = False) -> Iterator[Path]:
    """Give a folder to fill under a temporary name; once all of it is there, it takes its own.

    A run that is killed leaves a `.part` with a mark in it, which the next run clears; one that fails leaves none.

    Args:
        folder: Where the result shall be.
        overwrite: Whether what is there then is deleted; ask first whose it is. An empty folder is in any case.

    Yields:
        The folder to write into.

    Raises:
        OSError: If nothing can be written there, or a link stands for the folder.
        FileExistsError: If the temporary name is that of something else, which would be deleted.
        FolderInUseError: If another process is filling the folder.
    """
    part = folder.with_name(folder.name + PART)
    for each, remedy in ((folder, "name what it points to"), (part, "delete it, or choose another --out")):
        if each.is_symlink():
            raise OSError(f"{each}: expected a new folder, or none, found a symbolic link; {remedy}")
    if part.exists() and not part.is_dir():
        found = "a file" if part.is_file() else kind_of(part.lstat().st_mode)
        raise FileExistsError(f"{part}: expected a folder, or none, found {found}; rename it, or choose another --out")
    with one_writer(part):
        _mark(part)
        clear_folder(part, keep=(LOCK, UNFINISHED))
        try:
            yield part
            if folder.exists():
                (shutil.rmtree if overwrite else os.rmdir)(folder)
            (part / LOCK).unlink()
            part.replace(folder)
        except BaseException:
            shutil.rmtree(part, ignore_errors=True)
            raise
        finish(folder)  # last: until then a run that is killed has to leave the mark


def _mark(part: Path) -> None:
    """Mark a folder as one that is being filled, unless it is, or holds what nobody has said may be deleted."""
    if (part / UNFINISHED).is_file():
        return
    others = sorted(path.name for path in part.iterdir() if path.name != LOCK)
    if others:
        raise FileExistsError(
            f"{part}: expected what an earlier run left unfinished, or nothing, found {shown(others[0])} and no file "
            f"{UNFINISHED}; rename or delete the folder, or choose another --out"
        )
    (part / UNFINISHED).touch(exist_ok=False)


def clear_folder(folder: Path, keep: Iterable[str] = (LOCK,)) -> None:
    """Delete everything in a folder but what has some names; of links, only the link."""
    kept = frozenset(keep)
    for path in folder.iterdir():
        if path.name in kept:
            continue
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink()


def write_text(path: Path, text: str) -> None:
    """Write a text file, whole or not at all."""
    write_whole(path, lambda part: _ignore(part.write_text(text, encoding="utf-8", newline="")))


def read_json(path: Path, what: str, remedy: str = "delete it", *, lines: bool = False) -> Any:
    """Read a JSON file.

    Args:
        path: The file.
        what: What it should hold, for the message.
        remedy: What to do if it does not.
        lines: Whether each line is a value of its own; they are returned as a list.

    Raises:
        OSError: If it cannot be read.
        ValueError: If it is damaged.
    """
    try:
        text = read_text(path)
        return [json.loads(line) for line in text.split("\n") if line.strip()] if lines else json.loads(text)
    except (ValueError, RecursionError) as error:
        reason = str(error).splitlines()[0] if path.stat().st_size else "an empty file"
        raise ValueError(f"{path}: expected {what} as JSON, found a damaged file ({reason}); {remedy}") from None


def write_tensors(path: Path, state: Mapping[str, Any]) -> None:
    """Write a mapping of tensors and plain values, whole or not at all.

    Raises:
        OSError: If it cannot be written; torch itself says of a full disk that a position is unexpected.
    """
    import torch

    content = io.BytesIO()
    torch.save(dict(state), content)
    write_whole(path, lambda part: _ignore(part.write_bytes(content.getbuffer())))


def write_picture(path: Path, figure: Figure) -> bytes:
    """Write a figure of matplotlib as PNG, whole or not at all.

    Returns:
        What was written; the same for the same figure.
    """
    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=DOTS, metadata={"Software": None})
    data = content.getvalue()
    write_whole(path, lambda part: _ignore(part.write_bytes(data)))
    return data


def read_tensors(path: Path, keys: Iterable[str] = ()) -> dict[str, Any]:
    """Read a mapping that `torch.save` wrote: tensors and plain values, nothing that could run.

    Args:
        path: The file.
        keys: What it must have.

    Returns:
        The mapping, its tensors on the CPU.

    Raises:
        OSError: If it cannot be read.
        ValueError: If it is damaged, holds something else, or lacks a key.
    """
    import torch

    if not path.is_file():
        raise FileNotFoundError(f"{path}: expected a checkpoint, found no such file")
    try:
        require_modest_tensors(path)
        state = torch.load(path, map_location="cpu", weights_only=True)
    except MemoryError:
        raise
    except Exception as error:  # zipfile, pickle and torch have many errors for what is no file of theirs
        reason = (str(error).splitlines() or [type(error).__name__])[0][:160]
        raise ValueError(f"{path}: expected a checkpoint, found a damaged file ({reason})") from None
    if not isinstance(state, dict):
        raise ValueError(f"{path}: expected a checkpoint, found a {type(state).__name__}")
    if missing := [key for key in keys if key not in state]:
        raise ValueError(f"{path}: expected a checkpoint with {', '.join(missing)}, found none")
    if not isinstance(state.get("state_dict", {}), dict):
        raise ValueError(
            f"{path}: expected a checkpoint whose state_dict is a mapping, found {shown(state['state_dict'])}"
        )
    return state


def sha256(path: Path) -> str:
    """Return the SHA-256 of a file in hexadecimal digits.

    Raises:
        OSError: If it cannot be read, or is no regular file.
    """
    with open_regular(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _ignore(value: object) -> None:
    """Drop a value that nobody needs."""
