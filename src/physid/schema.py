"""Check a configuration against the signatures of what it configures, before anything heavy is built."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Callable, Mapping
from typing import Any

from physid.configuration import CLASS_KEYS, Configuration, ConfigurationError
from physid.scenes.strict import nearest


def check_keys(configuration: Configuration, groups: Mapping[str, Callable[..., Any] | None]) -> None:
    """Check that every key of a configuration is one that somebody reads.

    Args:
        configuration: Resolved configuration.
        groups: The keys at the top, and whose arguments stand below each; None where a `class_path` says so.

    Raises:
        ConfigurationError: If a key is unknown or a class cannot be imported; it names the nearest one that exists.
    """
    _refuse_unknown(configuration, "", configuration.values, groups)
    for key, value in configuration.values.items():
        target = groups[key]
        if target is not None and isinstance(value, dict):
            _refuse_unknown(configuration, key, value, _parameters(target))
        _check_classes(configuration, key, value)


def _check_classes(configuration: Configuration, key: str, value: Any) -> None:
    """Check every `class_path` below a key, and the arguments beside it."""
    if isinstance(value, list):
        for index, each in enumerate(value):
            _check_classes(configuration, f"{key}.{index}", each)
    if not isinstance(value, dict):
        return
    if "class_path" in value:
        target = _load(configuration, f"{key}.class_path", value["class_path"])
        _refuse_unknown(configuration, key, value, dict.fromkeys(CLASS_KEYS))
        known = _parameters(target) if target is not None else {}
        if known:
            _refuse_unknown(configuration, f"{key}.init_args", value.get("init_args") or {}, known)
    for name, each in value.items():
        _check_classes(configuration, f"{key}.{name}", each)


def _refuse_unknown(
    configuration: Configuration, key: str, values: Mapping[str, Any], known: Mapping[str, Any]
) -> None:
    """Raise if a mapping has a key that is not known; an empty `known` knows everything."""
    for name in values:
        if known and name not in known:
            full = f"{key}.{name}" if key else str(name)
            shown = full.replace(".init_args", "")
            raise ConfigurationError(
                f'{configuration.source_of(full)}: unknown key "{shown}"{nearest(str(name), known)}'
            )


def _load(configuration: Configuration, key: str, path: Any) -> Callable[..., Any] | None:
    """Import what a class path names; None for a short name, which LightningCLI resolves."""
    source = configuration.source_of(key)
    if not isinstance(path, str):
        raise ConfigurationError(f"{source}: {key}: expected a dotted path to a class, got {path!r}")
    module_name, dot, name = path.rpartition(".")
    if not dot:
        return None
    try:
        module = importlib.import_module(module_name)
    except ModuleNotFoundError as error:
        raise ConfigurationError(f"{source}: {key}: cannot import {path}: {error}") from None
    if not hasattr(module, name):
        classes = [each for each, value in vars(module).items() if inspect.isclass(value)]
        raise ConfigurationError(f'{source}: {key}: {module_name} has no "{name}"{nearest(name, classes)}')
    found: Callable[..., Any] = getattr(module, name)
    return found


def _parameters(target: Callable[..., Any]) -> dict[str, Any]:
    """Return the parameters of a class or function by name; empty where it takes any."""
    parameters = inspect.signature(target).parameters
    if any(each.kind is each.VAR_KEYWORD for each in parameters.values()):
        return {}
    return dict(parameters)
