"""One run of Lightning's Trainer in its own folder: build, fit or evaluate, resume, write the figures."""

from __future__ import annotations

import json
import math
import signal
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from traceback import extract_tb
from typing import Any, Literal

import lightning as L
from lightning.pytorch.utilities.model_helpers import is_overridden
from torch import Tensor

from physid.data.batches.datamodule import RecordingsDataModule
from physid.data.files import read_tensors, write_text
from physid.training.runs.building import build
from physid.training.runs.every_run import CHECKPOINT as CHECKPOINT
from physid.training.runs.every_run import callbacks_of
from physid.training.runs.failures import Chosen, explain, misfit
from physid.training.runs.loggers import Reached, build_loggers, history_of
from physid.training.training_module import LEARNED, TrainingModule, require_same_parameters
from physid.yaml_files import read_yaml

Stage = Literal["validate", "test", "predict"]
PARTS = ("state_dict", "epoch", "global_step", "loops", "callbacks", "pytorch-lightning_version")
"""Of a checkpoint that a run goes on from."""
SAFELY: dict[str, Any] = {"weights_only": True}
"""A checkpoint from elsewhere is data, never code."""
CONFIG, FIGURES = "config.yaml", "metrics.json"
LOADER = "DataLoader worker (pid"  # how torch begins to say that a process which loads data has ended
# The keys of a configuration, and whose arguments stand below each (None: a class_path says so).
GROUPS: dict[str, Callable[..., Any] | None] = {
    "seed_everything": None,
    "model": None,
    "data": None,
    "trainer": L.Trainer,
    "wandb": None,
}
CLASSES: dict[str, type] = {"model": L.LightningModule, "data": L.LightningDataModule}
# Of which kind they must be where the user does not allow others: callbacks and figures build on it.
KINDS: dict[str, type] = {"model": TrainingModule, "data": RecordingsDataModule}
# Arguments of the Trainer that a run decides itself, and what a user may want instead.
DECIDED = {
    "logger": "metrics.csv is always written, wandb=online or wandb=disabled chooses the rest",
    "default_root_dir": "--run-dir names it",
    "fast_dev_run": "trainer.max_epochs=1 data.limit=2 tries a run out",
}


class LoaderLostError(RuntimeError):
    """A process that loads data ended in the middle of a run."""


def fit(
    config: Mapping[str, Any], folder: Path, *, resume: bool = False, allowed: Sequence[str] = ()
) -> dict[str, float]:
    """Train a model in a run folder, test it where it states how, and write metrics.json.

    Args:
        config: Resolved configuration with the keys of `GROUPS`.
        folder: Run folder; gets metrics.csv, metrics.json, checkpoints and what the callbacks draw.
        resume: Whether to go on from the last checkpoint, exactly; without one the run starts at the beginning.
        allowed: Packages beside the trusted ones whose classes the configuration may name.

    Returns:
        The last value of every figure that was logged, and `seconds`.

    Raises:
        KeyboardInterrupt: If the run was interrupted; the last checkpoint stays.
        ValueError: If the configuration does not fit the classes it names.
    """
    checkpoint = folder / CHECKPOINT if resume and (folder / CHECKPOINT).exists() else None
    state, callbacks = callbacks_of(folder, config)
    config, chosen = dict(config), Chosen.of(config, allowed)
    reached = None if checkpoint is None else _reached(checkpoint)
    loggers = build_loggers(folder, config.pop("wandb", "offline"), config, reached)
    cli = build(config, folder, callbacks, allowed, logger=loggers)
    trainer, model, data = cli.trainer, cli.model, cli.datamodule
    _until_interrupted(trainer, chosen, lambda: trainer.fit(model, datamodule=data, ckpt_path=checkpoint, **SAFELY))
    state.note_steps(trainer.global_step)
    figures = _flat({**state.figures, **trainer.callback_metrics})
    if is_overridden("test_step", model) and _has_test_split(data):
        _until_interrupted(trainer, chosen, lambda: trainer.test(model, datamodule=data, verbose=False))
        figures |= _flat(trainer.callback_metrics)
    figures["seconds"] = state.seconds
    if trainer.is_global_zero:
        write_text(folder / FIGURES, json.dumps(figures, indent=2, sort_keys=True) + "\n")
    return figures


def evaluate(
    stage: Stage,
    config: Mapping[str, Any],
    folder: Path,
    weights: Path | None = None,
    *,
    callbacks: Sequence[L.Callback] = (),
    out: Path | None = None,
    allowed: Sequence[str] = (),
) -> dict[str, float]:
    """Validate, test or predict with a trained model.

    Args:
        stage: validate, test or predict.
        config: Resolved configuration, as for `fit`.
        folder: Run folder.
        weights: Checkpoint to load; the last one of the run by default.
        callbacks: Further callbacks, say one that writes what is predicted.
        out: Folder into which callbacks write; the run folder by default.
        allowed: Packages beside the trusted ones whose classes the configuration may name.

    Returns:
        The figures that were logged; none for predict, whose callbacks write.

    Raises:
        KeyboardInterrupt: If the run was interrupted.
        ValueError: If there is no checkpoint, or the configuration does not fit the classes it names.
    """
    weights = weights or folder / CHECKPOINT
    if not weights.exists():
        raise ValueError(f"{weights} does not exist: run `physid fit` first, or name another with --checkpoint")
    cli = build(
        {key: value for key, value in config.items() if key != "wandb"} | {"model": _as_learned(config, weights)},
        out or folder,
        list(callbacks),
        allowed,
        logger=False,
        enable_checkpointing=False,
    )
    if stage == "validate" and not cli.datamodule.val_dataloader():
        raise ValueError("there are no trajectories to validate on (split val or select); use `physid test`")
    run: Callable[..., Any] = getattr(cli.trainer, stage)
    options = SAFELY | ({"return_predictions": False} if stage == "predict" else {"verbose": False})
    trainer, chosen = cli.trainer, Chosen.of(config, allowed)
    _until_interrupted(trainer, chosen, lambda: run(cli.model, datamodule=cli.datamodule, ckpt_path=weights, **options))
    return _flat(cli.trainer.callback_metrics)


def restore(folder: Path, recordings: Path) -> L.LightningModule:
    """Return the model of a run, as its last checkpoint has it, for the scene of some recordings.

    Raises:
        ValueError: If the folder holds no run with a checkpoint, or the recordings show something else.
    """
    place, weights = folder / CONFIG, folder / CHECKPOINT
    if not place.is_file() or not weights.is_file():
        raise ValueError(f"{folder}: expected a run of `physid fit` with {CONFIG} and {CHECKPOINT}, found none")
    config = read_yaml(place)
    if not isinstance(config, dict) or not all(isinstance(config.get(key), dict) for key in CLASSES):
        raise ValueError(f"{place}: expected the configuration of a fit with model and data, found something else")
    data = config["data"]
    given = {**(data.get("init_args") or {}), "folder": str(recordings)}
    kept = {key: config[key] for key in ("seed_everything", "model", "trainer") if key in config}
    model = _as_learned(config, weights)
    cli = build(kept | {"model": model, "data": {**data, "init_args": given}}, folder, [], logger=False)
    module: Any = cli.model
    module.attach(cli.datamodule.scene)
    checkpoint = read_tensors(weights, PARTS)
    require_same_parameters(module, checkpoint, str(weights))
    try:
        module.load_state_dict(checkpoint["state_dict"])
    except RuntimeError as error:
        reason = str(error).splitlines()[-1].strip()
        raise ValueError(f"{weights}: expected a model of the scene of {recordings}, found another: {reason}") from None
    restored: L.LightningModule = module
    return restored


def _reached(checkpoint: Path) -> Reached:
    """Return how far the history of a run goes.

    Raises:
        ValueError: If its checkpoint does not say so.
    """
    content = read_tensors(checkpoint, PARTS)
    try:
        return history_of(content)
    except ValueError as error:
        raise misfit(checkpoint, error) from None


def _as_learned(config: Mapping[str, Any], weights: Path) -> Any:
    """Return the model's configuration, with the parameters that were learned where it names none."""
    model, learned = config["model"], read_tensors(weights, PARTS).get(LEARNED)
    if learned is not None and not (isinstance(learned, list) and all(isinstance(each, str) for each in learned)):
        raise ValueError(f"{weights}: expected names of parameters ({LEARNED}), found something else")
    arguments = model.get("init_args") or {}
    known = learned is None or arguments.get("learn")
    return model if known else {**model, "init_args": {**arguments, "learn": learned}}


def _until_interrupted(trainer: L.Trainer, chosen: Chosen, action: Callable[[], object]) -> None:
    """Run a part of the Trainer; Ctrl-C ends it with a KeyboardInterrupt that says how to go on.

    Raises:
        ValueError: If what a configuration chose fails, or a checkpoint is none of this run (see `explain`).
        LoaderLostError: If a process that loads data was killed.
    """
    handler = signal.getsignal(signal.SIGINT)
    try:
        action()
    except Exception as error:
        if _loader_lost(error):
            raise LoaderLostError(
                "a process that loads data was killed, as the system does where memory is short; the same command with "
                "--resume goes on, with fewer data.workers where that was so"
            ) from None
        if (explained := explain(error, chosen, trainer.ckpt_path)) is None:
            raise
        raise explained from error
    except SystemExit:
        if not trainer.interrupted:
            raise
        signal.signal(signal.SIGINT, handler)
        raise KeyboardInterrupt(f"in epoch {trainer.current_epoch}; the same command with --resume goes on") from None


def _loader_lost(error: Exception) -> bool:
    """Return whether a process that loads data has ended: torch says so, unless it dies while it hands data over."""
    handing = any("/multiprocessing/" in frame.filename for frame in extract_tb(error.__traceback__))
    if isinstance(error, RuntimeError):
        return LOADER in str(error)
    return handing and isinstance(error, EOFError | OSError)


def _has_test_split(data: Any) -> bool:
    """Return whether the data module has anything to test on."""
    try:
        data.test_dataloader()
    except ValueError:
        return False
    return True


def _flat(figures: Mapping[str, Tensor | float]) -> dict[str, float]:
    """Return the figures as floats; what is not finite is left out, since JSON has no word for it."""
    values = {name: float(value) for name, value in figures.items()}
    return {name: value for name, value in values.items() if math.isfinite(value)}
