"""Build what a configuration of a run names, or only look at whether its values are those that classes ask for."""

from __future__ import annotations

import copy
import inspect
import logging
import os
import warnings
from collections.abc import Mapping, Sequence
from contextlib import suppress
from multiprocessing import parent_process
from pathlib import Path
from typing import Any

import lightning as L
from jsonargparse import ArgumentError
from lightning.fabric.utilities.exceptions import MisconfigurationException
from lightning.fabric.utilities.warnings import PossibleUserWarning
from lightning.pytorch.cli import LightningCLI

from physid.class_paths import load_class
from physid.progress.bar import on_terminal
from physid.strict import LARGEST, shown, whole
from physid.training.callbacks.progress import Progress, ProgressLines
from physid.training.runs.checkpoints import OwnFiles
from physid.training.runs.failures import Chosen, explain
from physid.training.runs.trusted_imports import only_trusted_imports
from physid.yaml_files import read_text, require_modest_text

LONGEST_PATH = 1000
"""[letters] of a text that may be the name of a file."""


class Cli(LightningCLI):
    """LightningCLI as a builder: it validates a resolved configuration and makes the objects that it names.

    Args:
        config: Resolved configuration.
        fixed: Arguments of the Trainer that the run folder decides.
        callbacks: Callbacks that every run has.
    """

    def __init__(self, config: Mapping[str, Any], fixed: Mapping[str, Any], callbacks: list[L.Callback]) -> None:
        self._fixed = fixed
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "LightningCLI's args parameter is intended")
            super().__init__(
                args=dict(config),
                run=False,
                save_config_callback=None,
                seed_everything_default=0,
                trainer_defaults={"callbacks": callbacks},
                parser_kwargs={"exit_on_error": False, "allow_abbrev": False},
                auto_configure_optimizers=False,
                load_from_checkpoint_support=False,
            )

    def instantiate_trainer(self, **kwargs: Any) -> L.Trainer:
        """Build the Trainer with what the run folder decides.

        Raises:
            ValueError: If the Trainer refuses a setting, say an accelerator that this machine lacks.
        """
        try:
            trainer: L.Trainer = super().instantiate_trainer(**kwargs, **self._fixed)
            trainer.strategy.checkpoint_io = OwnFiles(trainer)
        except (MisconfigurationException, TypeError, ValueError) as error:
            raise ValueError(f"trainer: {error}") from None
        except OverflowError as error:  # of a time beyond any calendar
            raise ValueError(f"trainer: expected times that a clock can count, as max_time ({error})") from None
        return trainer


class Parsed(Cli):
    """The same that makes nothing of a configuration, for one of which only the values are inspected."""

    def instantiate_classes(self) -> None:
        """Make nothing."""


def build(
    config: Mapping[str, Any],
    folder: Path,
    callbacks: list[L.Callback],
    allowed: Sequence[str] = (),
    kind: type[Cli] = Cli,
    **fixed: Any,
) -> Cli:
    """Build trainer, model and data; the Trainer keeps quiet about what every user knows by now.

    Args:
        config: Resolved configuration; the parser may change what is in it.
        folder: Folder of the run.
        callbacks: Callbacks that every run has.
        allowed: Packages beside the trusted ones whose classes it may name.
        kind: What is built.
        fixed: Further arguments of the Trainer that the run decides.

    Raises:
        ArgumentError: If a value is none that its class takes.
        ClassPathError: If a value names something that it must not import.
        ValueError: If what it names cannot be made (see `explain`), the seed is none, or a text that the parser reads
            as YAML, or the file that it names, is a bomb.
    """
    seed = config.get("seed_everything")
    if isinstance(seed, int):  # a switch, too: true draws one
        whole(int(seed), "seed_everything", low=0, high=LARGEST["seed_everything"])
    logging.getLogger("lightning.pytorch").setLevel(logging.WARNING)
    logging.getLogger("lightning.fabric").setLevel(logging.WARNING)
    # Advice on loader workers, accelerators and logging intervals: the configurations have decided on these.
    warnings.filterwarnings("ignore", category=PossibleUserWarning)
    warnings.filterwarnings("ignore", "Total length of `list` across ranks is zero")
    warnings.filterwarnings("ignore", "Be aware that when using `ckpt_path`, callbacks used to create")
    warnings.filterwarnings("ignore", "Checkpoint directory .* exists and is not empty")
    # Lightning's own use of torch, nothing that a user could change.
    warnings.filterwarnings("ignore", "`isinstance\\(treespec, LeafSpec\\)` is deprecated")
    alone = parent_process() is None  # several processes at work would draw over each other's bars
    bar = on_terminal() and alone
    default = {"enable_progress_bar": bar, "enable_model_summary": False, "log_every_n_steps": 1}
    trainer = {**default, **(config.get("trainer") or {})}
    if trainer["enable_progress_bar"]:
        callbacks = [*callbacks, Progress()]
    elif alone and "enable_progress_bar" not in (config.get("trainer") or {}):
        callbacks = [*callbacks, ProgressLines()]
    _require_modest_texts({key: value for key, value in config.items() if key != "data"})
    _require_modest_texts(config.get("data"), "data", files=False)  # its files are recordings, and tables of forces
    try:
        with only_trusted_imports(allowed):
            return kind({**config, "trainer": trainer}, {"default_root_dir": folder, **fixed}, callbacks)
    except (ArgumentError, ValueError):  # say by themselves what is wrong
        raise
    except Exception as error:
        if (explained := explain(error, Chosen.of(config, allowed))) is None:
            raise
        raise explained from error


def _require_modest_texts(values: Any, key: str = "", *, files: bool = True) -> None:
    """Refuse texts that cost the parser more than they hold: it takes any for YAML, and for the name of such a file."""
    if isinstance(values, Mapping | list | tuple):
        items = values.items() if isinstance(values, Mapping) else enumerate(values)
        for name, each in items:
            _require_modest_texts(each, f"{key}.{name}" if key else str(name), files=files)
    elif isinstance(values, str):
        require_modest_text(values, key)
        if files and len(values) < LONGEST_PATH and os.path.exists(values) and not os.path.isdir(values):
            with suppress(UnicodeDecodeError):
                require_modest_text(read_text(Path(values)), f"{key}: {values}")


def check_values(config: Mapping[str, Any], allowed: Sequence[str] = ()) -> None:
    """Check that each value of a configuration is of the type that its class asks for.

    Raises:
        ArgumentError: If one is not.
        ClassPathError: If it names a class that it must not.
    """
    parsed = {key: value for key, value in copy.deepcopy(dict(config)).items() if key != "wandb"}
    if not isinstance(seed := parsed.get("seed_everything", 0), int):
        raise ValueError(f"seed_everything must be a whole number, got {shown(seed)}")
    parsed["seed_everything"] = False  # nothing is drawn here
    data = parsed.get("data") or {}
    if (takes := load_class(data.get("class_path"), allowed)) and "folder" in inspect.signature(takes).parameters:
        # Which recordings a model is of may be said elsewhere: here it need not name them.
        data["init_args"] = {"folder": ".", **(data.get("init_args") or {})}
    build(parsed, Path(), [], allowed, kind=Parsed)
