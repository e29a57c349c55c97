"""Effects that a user writes in a file of their own."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from difflib import get_close_matches
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import TypeGuard

import cloudpickle

from physid.class_paths import require_packages
from physid.effects import CATALOGUE, admit
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
        raise ValueError(f'effects must be given as FILE.py or FILE.py:CLASS, as my_effects.py:MyEffect, got "{place}"')
    return _checked(_class(_run(Path(path)), name, path), place)


def _checked(effect: type[Effect], place: str) -> type[Effect]:
    """Return an effect that obeys the laws of all effects, and whose name is free."""
    try:
        check(effect)
    except ValueError:
        raise
    except (Exception, SystemExit) as error:  # the user's code, which may raise anything
        raise ValueError(
            f"{place} fails where its laws are checked: {type(error).__name__}: {error}; what a hook is given, and its "
            "shapes, is in docs/adding_an_effect.md"
        ) from error
    if effect.name in {known.name for known in CATALOGUE}:
        raise ValueError(f'the name "{effect.name}" of {place} is taken by the catalogue; choose another')
    return effect


def own_effects(places: Sequence[str]) -> tuple[type[Effect], ...]:
    """Return the effects of files: of "FILE.py:CLASS" this one (see `load`), of "FILE.py" all.

    Raises:
        ValueError: If an effect cannot be loaded, or two have the same name.
    """
    effects = tuple(
        effect for place in places for effect in (_all_in(place) if file_of(place) == place else [load(place)])
    )
    names = [effect.name for effect in effects]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"effects must have names of their own, got {', '.join(twice)} more than once")
    return effects


def admit_files(allowed: Sequence[str]) -> tuple[str, ...]:
    """Let configurations name the effects of files.

    Args:
        allowed: What a user trusts: packages, and files with effects (see `own_effects`).

    Returns:
        The packages among it.

    Raises:
        ValueError: If an effect cannot be loaded, or something is neither a file nor a package.
    """
    packages = packages_in(allowed)
    admit(own_effects([each for each in allowed if file_of(each)]))
    return packages


def packages_in(allowed: Sequence[str]) -> tuple[str, ...]:
    """Return the packages among what a user trusts.

    Raises:
        ValueError: If it is neither a file nor the name of a package.
    """
    return require_packages([each for each in allowed if not file_of(each)])


def file_of(place: str) -> str:
    """Return the file of "FILE.py" or "FILE.py:CLASS"; nothing of anything else, such as a package."""
    return next((file for file in (place, place.rpartition(":")[0]) if file.endswith(".py")), "")


def _all_in(place: str) -> list[type[Effect]]:
    """Load all effects of a file."""
    module = _run(Path(place))
    effects = dict.fromkeys(each for each in vars(module).values() if _is_effect(each) and "name" in vars(each))
    own = [each for each in effects if each.__module__ == module.__name__]
    if not own:
        raise ValueError(f"{place} defines no effect, which is a class derived from physid.physics.Effect")
    return [_checked(each, f"{place}:{each.__name__}") for each in own]


def _is_effect(value: object) -> TypeGuard[type[Effect]]:
    return isinstance(value, type) and issubclass(value, Effect) and value is not Effect


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
    except (Exception, SystemExit) as error:  # the user's code, which may raise anything, and must not end physid
        raise ValueError(
            f"{path} cannot be run: {type(error).__name__}: {error}; a file of effects defines classes and no more"
        ) from error
    cloudpickle.register_pickle_by_value(module)  # worker processes cannot import it
    return module


def _class(module: ModuleType, name: str, path: str) -> type[Effect]:
    """Return the effect `name` of a module."""
    own = [key for key, value in vars(module).items() if getattr(value, "__module__", "") == module.__name__]
    found = getattr(module, name, None)
    if found is None:
        close = get_close_matches(name, own, n=1)
        hint = f'; did you mean "{close[0]}"?' if close else f"; it defines {', '.join(own) or 'none'}"
        raise ValueError(f'{path} has no class "{name}"{hint}')
    if not _is_effect(found):
        raise ValueError(f"{name} of {path} must be a class derived from physid.physics.effect.Effect, got {found!r}")
    return found
