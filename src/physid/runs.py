"""The folder of a run: where it lies, and what it must not overwrite."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from physid.configuration import Configuration, ConfigurationError
from physid.one_writer import one_writer
from physid.one_writer import refuse_links as refuse_links
from physid.record import write_record

CONFIG = "config.yaml"
LEFT_BY_A_RUN = ("metrics.csv", "metrics.json", "checkpoints")


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
        ConfigurationError: If the folder holds a run that shall neither go on nor be deleted.
        FolderInUseError: If another process writes there.
    """
    folder = folder_of(configuration, run_dir)
    if not first_process():
        yield folder
        return
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
        if not (folder / CONFIG).is_file():
            raise ConfigurationError(f"{folder} has no {CONFIG}, so it is no run's folder, and is not deleted")
        clear_folder(folder)
    write_record(folder, configuration.values)
    write_text(folder / CONFIG, configuration.to_yaml())


@contextmanager
def fill_folder(folder: Path, *, marked_by: str, overwrite: bool = False) -> Iterator[Path]:
    """Give a new folder to write a result into; it takes its name once all of it is there.

    Args:
        folder: Where the result shall be.
        marked_by: A file that every such result holds; a folder without it is never deleted.
        overwrite: Whether an earlier result there shall be replaced.

    Yields:
        The folder to write into.

    Raises:
        ConfigurationError: If there is an earlier result that shall not be replaced, or something else.
        FileExistsError: If something else has the name FOLDER.part.
        FolderInUseError: If another process is making the result.
        OSError: If nothing can be written there.
    """
    from physid.data.files import finish, holds_anything, whole_folder

    finish(folder)
    earlier = holds_anything(folder)
    if earlier and not overwrite:
        raise ConfigurationError(f"{folder} holds an earlier result; --overwrite replaces it, --out chooses another")
    if earlier and not (folder / marked_by).is_file():
        raise ConfigurationError(f"{folder} has no {marked_by}, so it is no earlier result, and is not deleted")
    with whole_folder(folder, overwrite=overwrite) as part:
        yield part
