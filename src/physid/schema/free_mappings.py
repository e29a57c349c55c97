"""Which mappings of a configuration are free: their keys are the user's choice, so that a later layer replaces them.

The type decides. A parameter that is annotated as a Mapping or a dict, such as `split: Mapping[str, float]`, is free;
one that is annotated as a class, such as `noise: Noise`, is a section whose keys are the parameters of that class.
"""

from __future__ import annotations

import collections.abc
import dataclasses
import inspect
import types
import typing
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from pydantic import BaseModel

from physid.class_paths import ClassPathError, load_class


def free_mappings(values: Mapping[str, Any], reads: type | None = None, allowed: Sequence[str] = ()) -> dict[str, bool]:
    """Return the dotted keys of all free mappings, and whether what such a one holds are scalars alone.

    Args:
        values: A configuration, arguments of classes under `init_args`.
        reads: The class whose fields the keys at the top are, if there is one.
        allowed: Packages beside the trusted ones whose classes may be looked at; others are passed over.
    """
    return dict(_free(dict(values), "", reads, allowed))


SCALARS = {bool, int, float, str, types.NoneType}
UNKNOWN = object()
"""A type that cannot be resolved, for instance since only a type checker imports it."""


def types_of(target: Any) -> dict[str, Any]:
    """Return the types of the parameters of a class by name; UNKNOWN where they cannot be resolved."""
    fields = dataclasses.is_dataclass(target) or (inspect.isclass(target) and issubclass(target, BaseModel))
    owner = target if fields else getattr(target, "__init__", None)
    try:
        hints = typing.get_type_hints(owner)
    except Exception:  # whatever a name is that only a type checker imports
        hints = dict.fromkeys(getattr(owner, "__annotations__", {}), UNKNOWN)
    return {name: hint for name, hint in hints.items() if name != "return"}


def alternatives(annotation: Any) -> tuple[Any, ...]:
    """Return the members of a union, or the type itself."""
    if typing.get_origin(annotation) in (typing.Union, types.UnionType):
        return tuple(one for each in typing.get_args(annotation) for one in alternatives(each))
    return (annotation,)


def _free(value: Any, key: str, annotation: Any, allowed: Sequence[str]) -> Iterator[tuple[str, bool]]:
    """Yield the free mappings at and below a key of a type, and whether they hold scalars; None for an unknown type."""
    if isinstance(value, list):
        for index, each in enumerate(value):
            yield from _free(each, f"{key}.{index}", None, allowed)
    if not isinstance(value, dict):
        return
    if "class_path" in value:
        try:
            target = load_class(value["class_path"], allowed)
        except ClassPathError:  # is reported by the check of the keys, which knows where it was set
            target = None
        arguments = value.get("init_args")
        for name, each in arguments.items() if isinstance(arguments, dict) else ():
            yield from _free(each, f"{key}.init_args.{name}", types_of(target).get(name), allowed)
        return
    kinds = alternatives(annotation)
    if mappings := [kind for kind in kinds if is_mapping(kind)]:
        held = [one for kind in mappings for each in typing.get_args(kind)[1:] for one in alternatives(each)]
        yield key, bool(held) and set(held) <= SCALARS
        return
    classes = [kind for kind in kinds if inspect.isclass(kind) and kind.__module__ != "builtins"]
    known = types_of(classes[0]) if classes else {}
    for name, each in value.items():
        yield from _free(each, f"{key}.{name}" if key else str(name), known.get(name), allowed)


def is_mapping(kind: Any) -> bool:
    """Tell whether a type is a mapping whose keys are free."""
    return (typing.get_origin(kind) or kind) in (dict, collections.abc.Mapping, collections.abc.MutableMapping)
