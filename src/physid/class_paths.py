"""Classes that a configuration names: which of them it may name, checked before anything is imported."""

from __future__ import annotations

import difflib
import importlib
import inspect
import re
from collections.abc import Sequence

from physid.strict import shown

TRUSTED = ("physid", "torch.optim", "torch.nn", "lightning", "torchmetrics")
"""Packages whose classes any configuration may name; to import a module is to run its code.

Of torch only what a fit is made of: other parts start processes, load what is pickled, or compile."""
DOTTED = re.compile(r"[^\W\d]\w*(\.[^\W\d]\w*)+")


LONGEST = 500
"""Letters of the longest dotted path; one of a million would only be quoted."""


class ClassPathError(ValueError):
    """A class that a configuration names and that cannot be had, or must not."""


def require_trusted(path: object, allowed: Sequence[str] = ()) -> None:
    """Check that a dotted path lies in a trusted package, or in one that the user allows by name.

    Args:
        path: What stands behind `class_path`; a name without a dot is no import and passes.
        allowed: Packages or modules that the user trusts beside `TRUSTED`.

    Raises:
        ClassPathError: If it is no dotted path, or lies elsewhere.
    """
    if not isinstance(path, str) or not re.fullmatch(r"[\w.]+", path) or len(path) > LONGEST or "__" in path:
        raise ClassPathError(f"expected a dotted path to a class, got {shown(path)}")
    if "." in path and not lies_in(path, (*TRUSTED, *allowed)):
        root = path.partition(".")[0]
        raise ClassPathError(
            f"{path}: expected a class of {', '.join(TRUSTED)}, since to import one is to run its code; if you trust "
            f"it, --allow {root}"
        )


def require_packages(allowed: Sequence[str]) -> tuple[str, ...]:
    """Return the packages that a user allows.

    Raises:
        ClassPathError: If one cannot be the name of a package.
    """
    for each in allowed:
        if not all(part.isidentifier() for part in each.split(".")):
            raise ClassPathError(
                f"--allow: expected the name of a package, as my_package, or a file of effects, as my_effects.py, got "
                f"{shown(each)}"
            )
    return tuple(allowed)


def load_class(path: object, allowed: Sequence[str] = ()) -> type | None:
    """Import the class that a dotted path names; None for a name without a dot.

    Raises:
        ClassPathError: If it must not be imported (see `require_trusted`), cannot be, or is no class.
    """
    require_trusted(path, allowed)
    module_name, dot, name = str(path).rpartition(".")
    if not dot:
        return None
    try:
        module = importlib.import_module(module_name)
    except (Exception, SystemExit) as error:  # whatever a module does that is imported
        raise ClassPathError(f"cannot import {path}: {str(error) or type(error).__name__}") from None
    found = getattr(module, name, None)
    if found is None:
        classes = [each for each, value in vars(module).items() if inspect.isclass(value)]
        close = difflib.get_close_matches(name, classes, n=1)
        hint = f'; did you mean "{close[0]}"?' if close else ""
        raise ClassPathError(f'{module_name} has no "{name}"{hint}')
    # A module also holds what it has imported: torch.x.Popen would be a class of subprocess.
    if not inspect.isclass(found) or not lies_in(found.__module__, (*TRUSTED, *allowed)):
        raise ClassPathError(f"{path}: expected a class of that package, found {found!r}")
    return found


def lies_in(path: str, packages: Sequence[str]) -> bool:
    """Return whether a dotted path is one of some packages or modules, or within one."""
    return any(path == package or path.startswith(f"{package}.") for package in packages)
