"""What a command works with: a configuration, an earlier run, or recordings alone, whose scene says what is unknown."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from physid.commands.command import Command
from physid.configuration import Configuration, ConfigurationError, compose

YAML = (".yaml", ".yml")


def configure(
    command: Command, values: dict[str, Any], files: Sequence[str], overrides: Sequence[str], allowed: Sequence[str]
) -> Configuration | None:
    """Return the configuration of a command; `values`, its own arguments, may get the folder of a run.

    A configuration that is named wins, then what an earlier run left in its folder. Recordings replace those of the
    configuration; with none they are fitted by the one that the command has for them, and a fit of data/NAME is found
    in runs/NAME by what comes after it.

    Raises:
        ConfigurationError: If there is none, or the recordings cannot be used.
    """
    from physid.class_paths import load_class
    from physid.runs import recorded_config

    recordings, run_dir = values.get("recordings"), values.get("run_dir")
    laid: list[str] = []
    if recordings is not None:
        name = _examine(command, recordings)
        if "run_dir" not in values:
            if files:
                raise ConfigurationError(f"{command.name}: expected a configuration or recordings, got both")
            return None
        run_dir = run_dir or (Path("runs") / name if not files else None)
        laid = [f"data.folder={json.dumps(str(recordings))}"]
        if not files and command.usual and not values.get("resume"):
            files, laid = [command.usual], [*laid, "data.limit=null", f"name={json.dumps(name)}"]
    chosen = tuple(files) or recorded_config(run_dir)
    if not chosen:
        raise ConfigurationError(_absent(command, values, run_dir))
    if "run_dir" in values:
        values["run_dir"] = run_dir
    reads = load_class(command.reads) if command.reads else None
    return compose(chosen, [*laid, *overrides], reads=reads, allowed=allowed)


def _examine(command: Command, recordings: Path) -> str:
    """Return the name of a recording set that has poses."""
    from physid.data.format import RecordingSet

    if recordings.suffix in YAML:
        raise ConfigurationError(
            f"{command.name}: expected recordings, got {recordings}; did you mean --config {recordings}?"
        )
    known = RecordingSet(recordings)
    if len(known) and not any(known.has_poses(index) for index in range(len(known))):
        raise ConfigurationError(f"{recordings}: has films and no poses; physid track {recordings} reads them first")
    return recordings.resolve().name


def _absent(command: Command, values: dict[str, Any], run_dir: Path | None) -> str:
    """Say that a configuration is missing, and what would do instead."""
    recordings = values.get("recordings")
    if recordings is not None:
        return f"{run_dir} holds no run: physid fit {recordings} makes one, --run-dir RUN names another"
    there = f"{run_dir} holds no run; " if run_dir else ""
    ways = ["--config FILE (see physid configs)"]
    ways += ["recordings"] * bool("recordings" in values) + ["--run-dir RUN"] * bool(
        "run_dir" in values and not run_dir
    )
    return f"{there}{command.name} needs a configuration: {' or '.join(ways)}"
