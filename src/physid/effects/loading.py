"""Effects that a user writes in a file of their own."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from difflib import get_close_matches
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

from physid.effects import CATALOGUE
from physid.effects.laws import check
from physid.physics import Effect


def load(place: str) -> type[Effect]:
    """Load an effect from a file, and check the laws that every effect obeys.

    Args:
        place: "path/to/file.py:ClassName".

    Raises:
        ValueError: If there is no such file or class, the file cannot be run, the class is no effect or breaks a law,
            or its name is taken.
    """
    path, colon, name = place.rpartition(":")
    if not (path and colon and name):
        raise ValueError(f'an effect must be given as FILE.py:CLASS, such as my_effects.py:MyEffect, got "{place}"')
    effect = _class(_run(Path(path)), name, path)
    try:
        check(effect)
    except ValueError:
        raise
    except Exception as error:
        raise ValueError(
            f"{place} fails where its laws are checked: {type(error).__name__}: {error}; what a hook is given, and its "
            "shapes, is in docs/adding_an_effect.md"
        ) from error
    if effect.name in {known.name for known in CATALOGUE}:
        raise ValueError(f'the name "{effect.name}" of {place} is taken by the catalogue; choose another')
    return effect


def own_effects(places: Sequence[str]) -> tuple[type[Effect], ...]:
    """Return the effects of files (see `load`).

    Raises:
        ValueError: If an effect cannot be loaded, or two have the same name.
    """
    effects = tuple(load(place) for place in places)
    names = [effect.name for effect in effects]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"effects must have names of their own, got {', '.join(twice)} more than once")
    return effects


def _run(path: Path) -> ModuleType:
    """Run a file as a module of its own."""
    if not path.is_file():
        raise ValueError(f"no file {path} with an effect in it (looked in {Path.cwd()})")
    spec = spec_from_file_location(f"physid_own_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise ValueError(f"{path} must be a Python file with the ending .py")
    module = module_from_spec(spec)
    # Dataclasses look their module up by name while the file runs.
    sys.modules[spec.name] = module
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise ValueError(f"{path} cannot be run: {type(error).__name__}: {error}") from error
    return module


def _class(module: ModuleType, name: str, path: str) -> type[Effect]:
    """Return the effect `name` of a module."""
    own = [key for key, value in vars(module).items() if getattr(value, "__module__", "") == module.__name__]
    found = getattr(module, name, None)
    if found is None:
        close = get_close_matches(name, own, n=1)
        hint = f'; did you mean "{close[0]}"?' if close else f"; it defines {', '.join(own) or 'none'}"
        raise ValueError(f'{path} has no class "{name}"{hint}')
    if not (isinstance(found, type) and issubclass(found, Effect) and found is not Effect):
        raise ValueError(f"{name} of {path} must be a class derived from physid.physics.effect.Effect, got {found!r}")
    return found
