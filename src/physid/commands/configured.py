"""What a command works with: a configuration, an earlier run, or recordings alone; and the keys that it takes."""

from __future__ import annotations

import dataclasses
import inspect
import json
import shlex
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from physid.commands.command import Command
from physid.configuration import Configuration, ConfigurationError, compose

GROUPS = {"fit": ("sysid", "supervised", "self_supervised")}
"""Folders of shipped configurations of commands whose configurations name their classes."""
PLUMBING = ("class_path", "init_args", "base")
Keys = dict[str, str]


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
    from physid.schema.check import trusted_packages

    packages = trusted_packages(allowed)
    recordings, run_dir = values.get("recordings"), values.get("run_dir")
    laid: list[str] = []
    if recordings is not None:
        name = _examine(command, recordings)
        if "run_dir" not in values:
            if files or overrides:
                given = ", ".join([*files, *overrides])
                raise ConfigurationError(
                    f"{command.name}: expected a configuration or recordings, got both: {given} beside {recordings}"
                )
            return None
        run_dir = run_dir or (Path("runs") / name if not files else None)
        laid = [f"data.folder={json.dumps(str(recordings))}"]
        if not files and not values.get("resume"):
            laid.append("data.limit=null")  # that of a run is of its own recordings
            if command.usual:
                files, laid = [command.usual], [*laid, f"name={json.dumps(name)}"]
    chosen = tuple(files) or recorded_config(run_dir)
    if not chosen:
        raise ConfigurationError(_absent(command, values, run_dir))
    if "run_dir" in values:
        values["run_dir"] = run_dir
    reads = load_class(command.reads) if command.reads else None
    composed = compose(chosen, [*laid, *overrides], reads=reads, allowed=packages)
    if command.name == "test" and recordings is not None:
        _test_all_others(composed, recordings, run_dir)
    return composed


def _test_all_others(configuration: Configuration, recordings: Path, run_dir: Path | None) -> None:
    """Let all trajectories of a set that names no split be tested, if the run was not fitted to that set."""
    from physid.data import RecordingSet
    from physid.runs import recorded_config

    own = [compose([file], allowed=configuration.allowed).recordings for file in recorded_config(run_dir)]
    if any(Path(one).resolve() == recordings.resolve() for one in own) or any(RecordingSet(recordings).splits()):
        return
    data = configuration.values["data"]
    data["init_args"] = {"test": ["train"], **(data.get("init_args") or {})}


def _examine(command: Command, recordings: Path) -> str:
    """Return the name of a recording set that has poses."""
    from physid.data import RecordingSet
    from physid.data.files import YAML
    from physid.shipped import names

    if recordings.suffix in YAML or (str(recordings) in names() and not recordings.exists()):
        raise ConfigurationError(
            f"{command.name}: expected recordings, got {recordings}; did you mean --config {recordings}?"
        )
    known = RecordingSet(recordings)
    if len(known) and not any(known.has_poses(index) for index in range(len(known))):
        raise ConfigurationError(
            f"{recordings}: has films and no poses; physid track {shlex.quote(str(recordings))} reads them first"
        )
    return recordings.resolve().name


def _absent(command: Command, values: dict[str, Any], run_dir: Path | None) -> str:
    """Say that a configuration is missing, and what would do instead."""
    recordings = values.get("recordings")
    if recordings is not None:
        return (
            f"{run_dir} holds no run: physid fit {shlex.quote(str(recordings))} makes one, --run-dir RUN names another"
        )
    there = f"{run_dir} holds no run; " if run_dir else ""
    ways = ["--config FILE (see physid configs)"]
    ways += ["recordings"] * bool("recordings" in values) + ["--run-dir RUN"] * bool(
        "run_dir" in values and not run_dir
    )
    return f"{there}{command.name} needs a configuration: {' or '.join(ways)}"


def keys_of(command: Command, *, usual: bool = False) -> Keys:
    """Return the keys that may be overridden, by dots, each with its default as text ("" where there is none).

    Args:
        command: The command.
        usual: Whether to take those of the usual configuration alone, where others are shipped, too.
    """
    from physid.class_paths import load_class

    if command.settings:
        kind = load_class(command.settings)
        assert kind is not None
        return {row.key: str(row.value) for row in kind().table()}
    if command.reads:
        kind = load_class(command.reads)
        assert kind is not None
        return dict(_fields(kind))
    return dict(_shipped(command, usual)) if command.configurable else {}


def _fields(kind: Any, before: str = "") -> Iterator[tuple[str, str]]:
    """Yield the fields of a class of settings."""
    for each in dataclasses.fields(kind):
        if each.default is not dataclasses.MISSING:
            default = each.default
        else:
            default = (
                each.default_factory() if each.default_factory is not dataclasses.MISSING else inspect.Signature.empty
            )
        if dataclasses.is_dataclass(default) and not isinstance(default, type):
            yield from ((f"{before}{each.name}.{name}", _text(value)) for name, value in vars(default).items())
        else:
            yield f"{before}{each.name}", _text(default)


def _shipped(command: Command, usual: bool) -> Iterator[tuple[str, str]]:
    """Yield the keys of shipped configurations, and the arguments of the classes that the usual one names."""
    from physid.configuration import compose
    from physid.shipped import names

    for name in sorted(names(), key=lambda one: one != command.usual):
        if name == command.usual or (not usual and name.partition("/")[0] in GROUPS.get(command.name, ())):
            yield from _flat(compose((name,), []).values)


def _flat(values: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, str]]:
    """Yield nested keys by dots, without the words that only say which class takes them."""
    for name, value in values.items():
        key = before if name == "init_args" else f"{before}{name}"
        if name not in PLUMBING and not (isinstance(value, Mapping) and value):
            yield key, _text(value)
        if isinstance(value, Mapping):
            yield from _flat(value, key if name == "init_args" else f"{key}.")
    path = values.get("class_path")
    if isinstance(path, str) and path.startswith("physid."):
        from physid.class_paths import load_class

        kind = load_class(path)
        for name, parameter in inspect.signature(kind).parameters.items() if kind else ():
            if name not in values.get("init_args", {}):
                yield f"{before}{name}", _text(parameter.default)


def _text(value: Any) -> str:
    """Write a default as it stands in a configuration; nothing where there is none."""
    if value is inspect.Signature.empty or callable(value):
        return ""
    if value is None or isinstance(value, bool):
        return "null" if value is None else str(value).lower()
    if isinstance(value, tuple | list):
        return f"[{', '.join(map(_text, value))}]"
    if isinstance(value, Mapping):
        return "{}"
    return str(value) if isinstance(value, str | int | float) else ""


def read_model(model: Path, allow: str) -> Path | Mapping[str, Any]:
    """Check the configuration of a nominal model, key by key; return it, or the run or checkpoint with its values."""
    from physid.data.files import YAML
    from physid.schema.check import check_values, trusted_packages
    from physid.shipped import find_configuration

    model = find_configuration(model)
    given = model.suffix in YAML and not model.is_dir()
    run = model.parent.parent if model.suffix == ".ckpt" else model
    place = model if given else run / "config.yaml"
    if not given and not place.is_file():
        raise ConfigurationError(
            f"{model}: expected a run of `physid fit` with a file {place.name}, found none there; --model takes a "
            "configuration, a run or its checkpoint"
        )
    configuration = compose([place], allowed=trusted_packages([each for each in allow.split(",") if each]))
    check_values(configuration)
    return configuration.values if given else model
