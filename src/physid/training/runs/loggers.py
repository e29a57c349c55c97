"""Where a run's history goes: always metrics.csv in its folder, and wandb (offline unless asked otherwise)."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from lightning.pytorch.loggers import CSVLogger, Logger, WandbLogger
from lightning.pytorch.loggers.csv_logs import ExperimentWriter

from physid.data.files import write_text
from physid.strict import whole
from physid.training.callbacks.run_state import kept_of
from physid.yaml_files import read_text

WANDB_MODES = ("offline", "online", "disabled")


@dataclass(frozen=True)
class Reached:
    """How far the history of a run goes that is resumed.

    Attributes:
        epoch: Last epoch of the checkpoint.
        row: What was to be logged at its end; the checkpoint is written first.
    """

    epoch: int
    row: Mapping[str, float]


def history_of(checkpoint: Mapping[str, Any]) -> Reached:
    """Return how far the history of a checkpoint's content goes.

    Raises:
        ValueError: If it does not say so.
    """
    callbacks = checkpoint["callbacks"]
    if not isinstance(callbacks, dict) or "RunState" not in callbacks:
        raise ValueError("callbacks: expected the state of a run (RunState), found none")
    kept_of(callbacks["RunState"])
    return Reached(whole(checkpoint["epoch"], "epoch", low=0), callbacks["RunState"].get("row") or {})


def build_loggers(folder: Path, wandb_mode: str, config: Mapping[str, Any], reached: Reached | None) -> list[Logger]:
    """Build the loggers of a run.

    Args:
        folder: Run folder.
        wandb_mode: offline, online or disabled; the environment variable WANDB_MODE wins.
        config: Resolved configuration, shown by wandb beside the curves.
        reached: Where the history goes on; None for a run that starts anew.

    Returns:
        The CSV logger first.

    Raises:
        ValueError: If there is no such mode.
    """
    mode = _mode(wandb_mode)
    loggers: list[Logger] = [_csv_logger(folder, reached)]
    if mode != "disabled":
        loggers.append(_wandb_logger(folder, mode, config))
    return loggers


class Writer(ExperimentWriter):
    """Lightning's writer of metrics.csv, which deletes no earlier file and leaves none half written.

    Rows are appended; where a figure is new, the whole file is written again under another name first.
    """

    def _check_log_dir_exists(self) -> None:
        """Leave what is there: `_csv_logger` has put the history in order."""

    def _rewrite_with_new_header(self, fieldnames: list[str]) -> None:
        """Give the file columns for new figures."""
        path = Path(self.metrics_file_path)
        _write_rows(path, read_rows(path), fieldnames)


def read_rows(path: Path) -> list[dict[str, str]]:
    """Return the whole rows of a history; one that a killed run has written half is left out.

    Raises:
        OSError: If it cannot be read, or is no regular file.
        ValueError: If the file is no text.
    """
    try:
        text = read_text(path, most=None)  # of a long run, which is the user's own
    except UnicodeDecodeError:
        raise ValueError(f"{path}: expected a history in CSV, found a damaged file; delete it") from None
    whole = text[: text.rfind("\n") + 1]
    try:
        rows = list(csv.DictReader(io.StringIO(whole, newline="")))
    except csv.Error as error:
        raise ValueError(f"{path}: expected a history in CSV, found a damaged file ({error}); delete it") from None
    return [row for row in rows if None not in row and None not in row.values()]


def _write_rows(path: Path, rows: Sequence[Mapping[str, Any]], columns: Sequence[str]) -> None:
    """Write a history, whole or not at all."""
    text = io.StringIO(newline="")
    table = csv.DictWriter(text, fieldnames=columns)
    table.writeheader()
    table.writerows(rows)
    write_text(path, text.getvalue())


def _csv_logger(folder: Path, reached: Reached | None) -> CSVLogger:
    """Build a CSV logger that goes on with the history up to the last checkpoint; Lightning's own would delete it."""
    logger = CSVLogger(folder, name="", version="", flush_logs_every_n_steps=1)
    writer = Writer(str(folder))
    logger._experiment = writer
    path = Path(writer.metrics_file_path)
    if reached is None:
        path.unlink(missing_ok=True)
        return logger
    known = read_rows(path) if path.exists() else []
    rows = [row for row in known if row.get("epoch", "").isdigit() and int(row["epoch"]) <= reached.epoch]
    last = {name: str(value) for name, value in reached.row.items()}
    if last and (not rows or {name: value for name, value in rows[-1].items() if value} != last):
        rows.append(last)
    if rows:
        writer.metrics_keys = sorted({name for row in rows for name in row})
        _write_rows(path, rows, writer.metrics_keys)
    return logger


def _wandb_logger(folder: Path, mode: str, config: Mapping[str, Any]) -> WandbLogger:
    """Build a wandb logger that writes into the run folder and prints nothing."""
    return WandbLogger(experiment=_begin_run(folder, mode, config), save_dir=folder)


def log_result(
    folder: Path,
    wandb_mode: str,
    config: Mapping[str, Any],
    figures: Mapping[str, float | str],
    tables: Mapping[str, tuple[Sequence[str], Sequence[Sequence[Any]]]],
    media: Sequence[Path],
) -> None:
    """Log a result that has no history as a run of wandb; offline, it is written into the folder.

    Args:
        folder: Where the result lies.
        wandb_mode: offline, online or disabled; the environment variable WANDB_MODE wins.
        config: What was asked for.
        figures: Its figures by name, which become the summary of the run.
        tables: Columns and rows by name.
        media: Pages (.html) and films (.mp4); those that are not there are left out.

    Raises:
        ValueError: If there is no such mode.
    """
    mode = _mode(wandb_mode)
    if mode == "disabled":
        return
    import wandb

    kinds: dict[str, Callable[[str], Any]] = {".html": wandb.Html, ".mp4": partial(wandb.Video, format="mp4")}
    run = _begin_run(folder, mode, config)
    shown: dict[str, Any] = {path.stem: kinds[path.suffix](str(path)) for path in media if path.is_file()}
    shown |= {
        name: wandb.Table(columns=list(columns), data=[list(row) for row in rows])
        for name, (columns, rows) in tables.items()
    }
    run.log(dict(figures) | shown)
    run.finish()


def _mode(wandb_mode: str) -> str:
    """Return the mode that counts.

    Raises:
        ValueError: If there is no such mode.
    """
    mode = os.environ.get("WANDB_MODE", wandb_mode)
    if mode not in WANDB_MODES:
        raise ValueError(f"wandb must be one of {', '.join(WANDB_MODES)}, got {mode!r}")
    return mode


def _begin_run(folder: Path, mode: str, config: Mapping[str, Any]) -> Any:
    """Begin a run that prints nothing, named after its folder."""
    import wandb

    folder.mkdir(parents=True, exist_ok=True)
    settings = wandb.Settings(console="off", silent=True, x_disable_stats=True)
    return wandb.init(
        project="physid",
        name=folder.name,
        dir=folder,
        mode="offline" if mode == "offline" else "online",
        config=dict(config),
        settings=settings,
        reinit="finish_previous",
    )
