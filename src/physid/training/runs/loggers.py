"""Where a run's history goes: always metrics.csv in its folder, and wandb (offline unless asked otherwise)."""

from __future__ import annotations

import csv
import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from lightning.pytorch.loggers import CSVLogger, Logger, WandbLogger

WANDB_MODES = ("offline", "online", "disabled")


def build_loggers(folder: Path, wandb_mode: str, config: Mapping[str, Any], last_epoch: int | None) -> list[Logger]:
    """Build the loggers of a run.

    Args:
        folder: Run folder.
        wandb_mode: offline, online or disabled; the environment variable WANDB_MODE wins.
        config: Resolved configuration, shown by wandb beside the curves.
        last_epoch: Last epoch of the checkpoint that is resumed; None for a run that starts anew.

    Returns:
        The CSV logger first.

    Raises:
        ValueError: If there is no such mode.
    """
    mode = _mode(wandb_mode)
    loggers: list[Logger] = [_csv_logger(folder, last_epoch)]
    if mode != "disabled":
        loggers.append(_wandb_logger(folder, mode, config))
    return loggers


def _csv_logger(folder: Path, last_epoch: int | None) -> CSVLogger:
    """Build a CSV logger that goes on with the history up to `last_epoch`; Lightning's own would delete it."""
    path = folder / "metrics.csv"
    rows: list[dict[str, str]] = []
    if last_epoch is not None and path.exists():
        with path.open(newline="") as file:
            rows = [row for row in csv.DictReader(file) if row.get("epoch") and int(row["epoch"]) <= last_epoch]
    logger = CSVLogger(folder, name="", version="", flush_logs_every_n_steps=1)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Experiment logs directory .* exists and is not empty")
        writer = logger.experiment
    if rows:
        writer.metrics_keys = list(rows[0])
        with path.open("w", newline="") as file:
            table = csv.DictWriter(file, fieldnames=writer.metrics_keys)
            table.writeheader()
            table.writerows(rows)
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
