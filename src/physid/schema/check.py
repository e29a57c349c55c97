"""Check a configuration against the signatures of what it configures, before anything heavy is built."""

from __future__ import annotations

import collections.abc
import inspect
import os
import re
import typing
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from pydantic import BaseModel

from physid.class_paths import DOTTED, ClassPathError, lies_in, load_class, require_packages, require_trusted
from physid.configuration import CLASS_KEYS, Configuration, ConfigurationError
from physid.schema.free_mappings import UNKNOWN, alternatives, is_mapping, types_of
from physid.strict import MOST_SHOWN, nearest, quoted, shown
from physid.typed_files import check_as

LONGEST_NAME = 200
COUNTS = ("accumulate_grad_batches", "check_val_every_n_epoch", "val_check_interval")
"""Settings of the Trainer by which it divides."""
DIGITS = 3
WIDE = re.compile(rf"\{{[^{{}}]*\{{|\{{[^{{}}:]*:[^{{}}]*?[0-9]{{{DIGITS + 1}}}")
"""A part of a name to fill in that has a width of more digits, or whose width is filled in itself."""
WRITTEN = ("builtins", "datetime", "pathlib", "types")
"""Modules of classes whose values are written as a number or a text."""
PLAIN = re.compile(r"[\w.,:+-]*")
"""What settings such as accelerators, precisions and devices are written with."""


def trusted_packages(allowed: Sequence[str]) -> tuple[str, ...]:
    """Return the packages that a user allows, and let configurations name the effects of the files that are allowed.

    Raises:
        ValueError: If an effect of a file cannot be loaded, or something else is named.
    """
    if not any(".py" in each for each in allowed):
        return require_packages(allowed)  # without torch, which effects need
    from physid.effects.loading import admit_files

    return admit_files(allowed)


def check_fit(configuration: Configuration) -> None:
    """Check a configuration of `physid fit`.

    Raises:
        ConfigurationError: If a key is unknown, a class is none of those expected, or a key has no effect.
    """
    from physid.training.runs import run

    check_keys(configuration, run.GROUPS, run.CLASSES)
    for key, kind in run.KINDS.items():
        _require_kind(configuration, key, kind)
    trainer = configuration.values.get("trainer") or {}
    for name in COUNTS:
        value = trainer.get(name)
        if isinstance(value, int | float) and value <= 0:
            raise _wrong(configuration, f"trainer.{name}", "a number above 0", value)
    _refuse_wide(configuration, "trainer", trainer)
    for name, remedy in run.DECIDED.items():
        if trainer.get(name) is not None:
            source = configuration.source_of(f"trainer.{name}")
            raise ConfigurationError(
                f"{source}: trainer.{name} cannot be chosen, since a run keeps all in its folder; {remedy}"
            )


def check_values(configuration: Configuration) -> None:
    """Check a configuration of `physid fit` whose classes are not made: its keys, and the types of its values.

    Raises:
        ConfigurationError: See `check_fit`.
        ArgumentError: If a value is none that its class takes.
    """
    from physid.training.runs import building

    check_fit(configuration)
    building.check_values(configuration.values, configuration.allowed)


def check_keys(
    configuration: Configuration,
    groups: Mapping[str, Callable[..., Any] | None],
    classes: Mapping[str, type] | None = None,
) -> None:
    """Check that every key of a configuration is one that somebody reads.

    Args:
        configuration: Resolved configuration.
        groups: The keys at the top, and whose arguments stand below each; None where a `class_path` says so.
        classes: The keys at the top that must be there and name a class, and of which kind.

    Raises:
        ConfigurationError: If a key is unknown, a section is no mapping, or a class must not or cannot be imported; it
            names the nearest one that exists.
    """
    _refuse_unknown(configuration, "", configuration.values, groups)
    for key, base in (classes or {}).items():
        _require_class(configuration, key, base)
    for key, value in configuration.values.items():
        target = groups[key]
        if target is not None and value is not None:
            if not isinstance(value, dict):
                raise _wrong(configuration, key, "a mapping of keys to values", value)
            _refuse_unknown(configuration, key, value, _parameters(target))
            known = types_of(target)
            for name, each in value.items():
                _check_classes(configuration, f"{key}.{name}", each, known.get(name))
        else:
            _check_classes(configuration, key, value)


def _require_class(configuration: Configuration, key: str, base: type) -> None:
    """Check that a key names a class of a kind."""
    value = configuration.values.get(key)
    if not isinstance(value, dict) or not isinstance(value.get("class_path"), str):
        raise _wrong(configuration, key, f"a mapping with the class_path of a {base.__name__}", value)
    target = _load(configuration, f"{key}.class_path", value["class_path"])
    if target is not None and not issubclass(target, base):
        raise _wrong(configuration, f"{key}.class_path", f"a {base.__name__}", value["class_path"])


def _require_kind(configuration: Configuration, key: str, kind: type) -> None:
    """Check that a class has what a run asks of it, unless it is of a package of the user's own."""
    path = configuration.values[key]["class_path"]
    found = _load(configuration, f"{key}.class_path", path)
    if found is None or lies_in(found.__module__, configuration.allowed):
        return
    if not issubclass(found, kind):
        wanted = f"a {kind.__name__} (of {kind.__module__.rpartition('.')[0]}), or a class that you --allow"
        raise _wrong(configuration, f"{key}.class_path", wanted, path)


def _refuse_wide(configuration: Configuration, key: str, value: Any) -> None:
    """Refuse names to fill in that ask for more letters than a name has, as `{epoch:>300000000}` does."""
    if isinstance(value, str) and WIDE.search(value):
        raise _wrong(configuration, key, f"a width of at most {DIGITS} digits", value)
    if isinstance(value, dict | list):
        for name, each in value.items() if isinstance(value, dict) else enumerate(value):
            _refuse_wide(configuration, f"{key}.{name}", each)


def _check_classes(configuration: Configuration, key: str, value: Any, annotation: Any = None) -> None:
    """Check every `class_path` below a key of a type, and the arguments beside it."""
    if isinstance(value, str) and _takes_classes(annotation):
        _check_text(configuration, key, value)
    if isinstance(value, list):
        for index, each in enumerate(value):
            _check_classes(configuration, f"{key}.{index}", each, annotation)
    if not isinstance(value, dict):
        return
    known: Mapping[str, Any] = {}
    if "class_path" in value:
        target = _load(configuration, f"{key}.class_path", value["class_path"])
        _refuse_unknown(configuration, key, value, dict.fromkeys(CLASS_KEYS))
        arguments = value.get("init_args")
        if arguments is not None and not isinstance(arguments, dict):
            raise _wrong(configuration, f"{key}.init_args", "a mapping of arguments", arguments)
        parameters = _parameters(target) if target is not None else {}
        if parameters:
            _refuse_unknown(configuration, f"{key}.init_args", arguments or {}, parameters)
        # The parser resolves a short name, and gives what is in dict_kwargs to parameters that no type is known of.
        known = types_of(target) if target is not None else dict.fromkeys(arguments or {}, UNKNOWN)
        for name, each in (arguments or {}).items():
            _check_classes(configuration, f"{key}.init_args.{name}", each, known.get(name))
        further = value.get("dict_kwargs")
        for name, each in further.items() if isinstance(further, dict) else ():
            _check_classes(configuration, f"{key}.dict_kwargs.{name}", each, UNKNOWN)
        return
    if annotation is UNKNOWN:
        known = dict.fromkeys(value, UNKNOWN)
    free = annotation is UNKNOWN or any(is_mapping(kind) for kind in alternatives(annotation))
    section = next((kind for kind in alternatives(annotation) if _is_section(kind)), None)
    if section is not None:
        known = types_of(section)
        _refuse_unknown(configuration, key, value, _parameters(section))
        if issubclass(section, BaseModel):  # of a union the parser names what its last member expects
            where = f"{configuration.source_of(key)}: {key.replace('.init_args', '')}"
            try:
                check_as(section, value, where)
            except ValueError as error:
                raise ConfigurationError(str(error)) from None
    elif _takes_classes(annotation) and not free:
        raise _wrong(configuration, key, "a mapping with class_path and init_args", value)
    for name, each in value.items():
        _check_classes(configuration, f"{key}.{name}", each, known.get(name))


def _check_text(configuration: Configuration, key: str, value: str) -> None:
    """Check a text where a class or a function is expected: the parser takes any but a name for YAML, or for a file."""
    if DOTTED.fullmatch(value):
        _trusted(configuration, key, value)
        return
    plain = PLAIN.fullmatch(value) and len(value) <= LONGEST_NAME
    if not plain or (os.path.exists(value) and not os.path.isdir(value)):
        wanted = "a name, or a mapping with class_path and init_args"
        raise _wrong(configuration, key, f"{wanted}, neither YAML in a text nor a file", value)


def _refuse_unknown(
    configuration: Configuration, key: str, values: Mapping[str, Any], known: Mapping[str, Any]
) -> None:
    """Raise if a mapping has a key that is not known; an empty `known` knows everything."""
    for name in values:
        if known and name not in known:
            full = f"{key}.{name}" if key else str(name)
            plain = full.replace(".init_args", "")
            raise ConfigurationError(
                f"{configuration.source_of(full)}: unknown key {quoted(plain)}{nearest(str(name), known)}"
            )


def _load(configuration: Configuration, key: str, path: Any) -> type | None:
    """Import what a class path names; None for a short name, which LightningCLI resolves."""
    try:
        return load_class(path, configuration.allowed)
    except ClassPathError as error:
        raise _error(configuration, key, str(error)) from None


def _trusted(configuration: Configuration, key: str, path: str) -> None:
    try:
        require_trusted(path, configuration.allowed)
    except ClassPathError as error:
        raise _error(configuration, key, str(error)) from None


def _wrong(configuration: Configuration, key: str, wanted: str, found: Any) -> ConfigurationError:
    return _error(configuration, key, f"expected {wanted}, got {shown(found)}")


def _error(configuration: Configuration, key: str, message: str) -> ConfigurationError:
    """Name the file, or the command line, and the key that a message is about."""
    return ConfigurationError(f"{configuration.source_of(key)}: {key[:MOST_SHOWN]}: {message}")


def _takes_classes(annotation: Any) -> bool:
    """Tell whether a type has a class or a function in it that the parser would import by its dotted path."""
    if annotation is UNKNOWN:
        return True
    for kind in alternatives(annotation):
        inner = typing.get_origin(kind)
        if inner is None and inspect.isclass(kind) and kind.__module__ not in WRITTEN:
            return True
        if inner in (collections.abc.Callable, type):
            return True
        if inner is not None and any(_takes_classes(each) for each in typing.get_args(kind) if each is not Ellipsis):
            return True
    return False


def _is_section(kind: Any) -> bool:
    """Tell whether a type is a class of this project whose parameters a mapping gives."""
    return inspect.isclass(kind) and kind.__module__.startswith("physid.") and not inspect.isabstract(kind)


def _parameters(target: Callable[..., Any]) -> dict[str, Any]:
    """Return the parameters of a class or function by name; empty where it takes any."""
    parameters = inspect.signature(target).parameters
    if any(each.kind is each.VAR_KEYWORD for each in parameters.values()):
        return {}
    return dict(parameters)
