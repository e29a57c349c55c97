"""The folder of a run: where it lies, and what it must not overwrite."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from physid.class_paths import load_class
from physid.configuration import Configuration, ConfigurationError, compose, flatten
from physid.one_writer import CHECKPOINT as CHECKPOINT
from physid.one_writer import EARLIER, LOCK, UNFINISHED_MOVE, one_writer
from physid.one_writer import refuse_links as refuse_links
from physid.record import RECORD, Record, recording_sets, write_record
from physid.strict import shown
from physid.typed_files import read_json_as

CONFIG = "config.yaml"
HISTORY = "metrics.csv"
LEFT_BY_A_RUN = (HISTORY, "metrics.json", "checkpoints")


def first_process() -> bool:
    """Return whether this is the first of the processes that a run is spread over, or the only one.

    Lightning, torchrun and SLURM start the same command once for each process and number them in the environment; all
    but the first leave the run folder and the terminal alone.
    """
    for name in ("RANK", "SLURM_PROCID"):
        if name in os.environ:
            return os.environ[name] == "0"
    return all(os.environ.get(name, "0") == "0" for name in ("NODE_RANK", "LOCAL_RANK"))


def folder_of(configuration: Configuration, run_dir: Path | None) -> Path:
    """Return the folder of a run: the one asked for, else runs/NAME."""
    return Path(run_dir) if run_dir else Path("runs") / configuration.name


def recorded_config(run_dir: Path | None) -> tuple[str, ...]:
    """Return the configuration that an earlier run left in a folder, if there is one."""
    path = Path(run_dir) / CONFIG if run_dir else None
    return (str(path),) if path and path.is_file() else ()


@contextmanager
def open_folder(
    configuration: Configuration, run_dir: Path | None, *, resume: bool = False, overwrite: bool = False
) -> Iterator[Path]:
    """Make the folder of a run ready, write the resolved configuration into it, and let nobody else write there.

    Args:
        configuration: What shall run.
        run_dir: The folder asked for, if any.
        resume: Whether an earlier run in it shall go on.
        overwrite: Whether an earlier run in it shall be deleted.

    Yields:
        The folder.

    Raises:
        ConfigurationError: If the folder holds a run that shall neither go on nor be deleted, or another one than shall
            go on; or the recordings.
        FolderInUseError: If another process writes there.
    """
    folder = folder_of(configuration, run_dir)
    if resume:
        _require_same_run(folder, configuration)
    if not first_process():
        yield folder
        return
    require_apart(folder, recording_sets(configuration.values), within=overwrite and not resume)
    with one_writer(folder):
        before = _described(folder) if resume else {}
        try:
            _begin(folder, configuration, resume=resume, overwrite=overwrite)
            yield folder
        except BaseException:
            _settle(folder)
            if before and _described(folder)[CHECKPOINT] == before[CHECKPOINT]:
                _describe_again(folder, before)
            raise
        shutil.rmtree(folder / EARLIER, ignore_errors=True)


def _begin(folder: Path, configuration: Configuration, *, resume: bool, overwrite: bool) -> None:
    """Clear what must go, and write configuration and record (see `open_folder`)."""
    from physid.data.files import write_text

    _settle(folder)
    earlier = any((folder / name).exists() for name in LEFT_BY_A_RUN)
    if earlier and not resume and not overwrite:
        raise ConfigurationError(
            f"{folder} holds an earlier run; --resume goes on, --overwrite deletes it, --run-dir chooses another folder"
        )
    if earlier and overwrite and not resume:
        _require_run(folder)
        _set_aside(folder)
    write_record(folder, configuration.values)
    write_text(folder / CONFIG, configuration.to_yaml())


def _require_run(folder: Path) -> None:
    """Refuse to delete a folder that is not known to be that of a run.

    Raises:
        ConfigurationError: If it lacks what every run writes; says what.
    """
    try:
        if not (folder / CONFIG).is_file():
            raise ValueError(f"it has no {CONFIG}")
        read_json_as(Record, folder / RECORD)
    except (OSError, ValueError) as error:
        raise ConfigurationError(
            f"{folder}: expected the folder of a run, which --overwrite deletes, found none that is certain to be one "
            f"({error}); delete it yourself, or choose another --run-dir"
        ) from None


def _set_aside(folder: Path) -> None:
    """Put what lies in the folder of a run aside in it, all or nothing, until the next run has something to show."""
    part = folder / UNFINISHED_MOVE
    part.mkdir()
    for path in list(folder.iterdir()):
        if path.name not in (LOCK, part.name):
            path.rename(part / path.name)
    part.rename(folder / EARLIER)


def _settle(folder: Path) -> None:
    """End an exchange of runs that has failed, or was killed: the later one stays if it has a checkpoint."""
    from physid.data.files import clear_folder

    aside, part = folder / EARLIER, folder / UNFINISHED_MOVE
    if aside.is_dir() and (folder / CHECKPOINT).is_file():
        shutil.rmtree(aside)
    elif aside.is_dir():
        clear_folder(folder, keep=(LOCK, EARLIER))
        aside.rename(part)
    if part.is_dir():
        for path in part.iterdir():
            path.rename(folder / path.name)
        part.rmdir()


def _described(folder: Path) -> dict[Path, Any]:
    """Return what is said of a run, and by what its checkpoint is known: an inode alone may come back after two."""
    texts: dict[Path, Any] = {
        Path(name): (folder / name).read_bytes() for name in (CONFIG, RECORD, HISTORY) if (folder / name).is_file()
    }
    if not (folder / CHECKPOINT).is_file():
        return texts | {CHECKPOINT: None}
    found = (folder / CHECKPOINT).stat()
    return texts | {CHECKPOINT: (found.st_ino, found.st_size, found.st_mtime_ns)}


def _describe_again(folder: Path, before: Mapping[Path, Any]) -> None:
    """Say of a run what was said before, since nothing of it has changed."""
    from physid.data.files import write_whole

    def write(content: bytes, part: Path) -> None:
        part.write_bytes(content)

    for name, content in before.items():
        if name != CHECKPOINT:
            write_whole(folder / name, partial(write, content))


def _require_same_run(folder: Path, configuration: Configuration) -> None:
    """Refuse to go on with a run as another one: what it has learned would be taken for what the other asks for.

    Raises:
        ConfigurationError: If model, data or seed are others; names the key.
    """
    if not (folder / CHECKPOINT).is_file() or not (folder / CONFIG).is_file():
        return  # nothing has been learned yet
    before = compose([folder / CONFIG], allowed=configuration.allowed).values
    was, now = (
        dict(_what_runs(before, configuration.allowed)),
        dict(_what_runs(configuration.values, configuration.allowed)),
    )
    for key in [*was, *now]:
        if (old := was.get(key)) != (new := now.get(key)):
            raise ConfigurationError(
                f"{folder}: expected the run that began there to go on, with {key}={shown(old)}, found {shown(new)}; "
                "--resume with --run-dir alone goes on as it began; begin another run in a folder of its own"
            )


def _what_runs(values: Mapping[str, Any], allowed: tuple[str, ...]) -> Iterator[tuple[str, Any]]:
    """Yield the keys that make a run what it is, with their values; of a user's own classes only which they are."""
    yield "seed_everything", values.get("seed_everything") or 0
    for group in ("model", "data"):
        section = values.get(group) or {}
        yield group, section.get("class_path")
        free = getattr(load_class(section.get("class_path"), allowed), "MAY_CHANGE", None)
        if free is None:
            continue
        for key, value in flatten(section.get("init_args") or {}):
            plain = key.replace("init_args.", "")
            if not any(plain == one or plain.startswith(f"{one}.") for one in free):
                yield f"{group}.{plain}", value


def require_apart(folder: Path, recordings: Iterable[str | Path], *, within: bool = True) -> None:
    """Refuse to write a result over the recordings that it comes from.

    Args:
        folder: Where the result shall be.
        recordings: Folders of recording sets.
        within: Whether they must not lie in the folder either, since all that is in it will be deleted.

    Raises:
        ConfigurationError: If it is one of them, or holds one.
    """
    place = folder.resolve()
    for each in recordings:
        own = Path(each).resolve()
        if own == place or (within and own.is_relative_to(place)):
            what = "the recordings themselves" if own == place else f"a folder that holds the recordings {each}"
            raise ConfigurationError(f"{folder}: expected a folder for the result, found {what}; choose another folder")


@contextmanager
def fill_folder(
    folder: Path, *, marked_by: str, overwrite: bool = False, recordings: Iterable[str | Path] = ()
) -> Iterator[Path]:
    """Give a new folder to write a result into; it takes its name once all of it is there.

    Args:
        folder: Where the result shall be.
        marked_by: A file that every such result holds; a folder without it is never deleted.
        overwrite: Whether an earlier result there shall be replaced.
        recordings: Folders of the recording sets that the result comes from, which stay.

    Yields:
        The folder to write into.

    Raises:
        ConfigurationError: If there is an earlier result that shall not be replaced, something else, or recordings.
        FileExistsError: If something else has the name FOLDER.part.
        FolderInUseError: If another process is making the result.
        OSError: If nothing can be written there.
    """
    from physid.data.files import finish, holds_anything, whole_folder

    require_apart(folder, recordings)
    finish(folder)
    earlier = holds_anything(folder)
    if earlier and not folder.is_dir():
        raise ConfigurationError(f"{folder}: expected a new folder, or none, found a file; choose another --out")
    if earlier and not overwrite:
        raise ConfigurationError(f"{folder} holds an earlier result; --overwrite replaces it, --out chooses another")
    if earlier and not (folder / marked_by).is_file():
        raise ConfigurationError(f"{folder} has no {marked_by}, so it is no earlier result, and is not deleted")
    with whole_folder(folder, overwrite=overwrite) as part:
        yield part
