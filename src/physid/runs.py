"""The folder of a run: where it lies, and what it must not overwrite."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from physid.class_paths import load_class
from physid.configuration import Configuration, ConfigurationError, compose, flatten
from physid.one_writer import one_writer
from physid.one_writer import refuse_links as refuse_links
from physid.record import RECORD, Record, recording_sets, write_record
from physid.strict import shown
from physid.typed_files import read_json_as

CONFIG = "config.yaml"
LEFT_BY_A_RUN = ("metrics.csv", "metrics.json", "checkpoints")
WHAT_RUNS = ("model", "data", "seed_everything")
"""Of a configuration, what makes a run this one; trainer and wandb say how far and how it goes."""


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
    if not first_process():
        yield folder
        return
    require_apart(folder, recording_sets(configuration.values), within=overwrite and not resume)
    with one_writer(folder):
        _begin(folder, configuration, resume=resume, overwrite=overwrite)
        yield folder


def _begin(folder: Path, configuration: Configuration, *, resume: bool, overwrite: bool) -> None:
    """Clear what must go, and write configuration and record (see `open_folder`)."""
    from physid.data.files import clear_folder, write_text

    earlier = any((folder / name).exists() for name in LEFT_BY_A_RUN)
    if earlier and not resume and not overwrite:
        raise ConfigurationError(
            f"{folder} holds an earlier run; --resume goes on, --overwrite deletes it, --run-dir chooses another folder"
        )
    if earlier and overwrite and not resume:
        if not (folder / CONFIG).is_file() or not _is_recorded(folder):
            raise ConfigurationError(
                f"{folder} has no {CONFIG} and {RECORD} of a run, so it is no run's folder, and is not deleted"
            )
        clear_folder(folder)
    if resume:
        _require_same_run(folder, configuration)
    write_record(folder, configuration.values)
    write_text(folder / CONFIG, configuration.to_yaml())


def _is_recorded(folder: Path) -> bool:
    """Return whether a folder has the record that every run writes."""
    try:
        read_json_as(Record, folder / RECORD)
    except (OSError, ValueError):
        return False
    return True


def _require_same_run(folder: Path, configuration: Configuration) -> None:
    """Refuse to go on with a run as another one: what it has learned would be taken for what the other asks for.

    Raises:
        ConfigurationError: If model, data or seed are others; names the key.
    """
    from physid.training.runs.every_run import CHECKPOINT

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
    for group in WHAT_RUNS:
        section = values.get(group)
        if not isinstance(section, dict):
            yield group, section
            continue
        path = section.get("class_path")
        yield group, path
        free = getattr(load_class(path, allowed), "MAY_CHANGE", None)
        if free is not None:
            arguments = section.get("init_args") or {}
            yield from flatten({key: value for key, value in arguments.items() if key not in free}, group)


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
