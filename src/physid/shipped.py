"""The configurations that come with physid, wherever it is installed: `sysid/push_friction` is a name of one."""

from __future__ import annotations

import difflib
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

SHIPPED = Path(__file__).parent / "configs"
"""In the repository a link to configs/; a wheel holds the files."""
SUFFIX = ".yaml"


def names() -> list[str]:
    """Return the names of all shipped configurations, say `sysid/push_friction`."""
    return sorted(path.relative_to(SHIPPED).with_suffix("").as_posix() for path in SHIPPED.glob(f"*/*{SUFFIX}"))


def find_configuration(file: Path, beside: Path = Path()) -> Path:
    """Return the file that a path or a name stands for: one that is there, else the one that is shipped.

    `configs/sysid/push_friction.yaml`, the path in the repository, and `sysid/push_friction` mean the same anywhere.

    Args:
        file: What was named.
        beside: The folder that a relative path begins in.

    Returns:
        A file that exists, or the path as it was meant where there is none.
    """
    places = [beside / file]
    if not file.is_absolute() and ".." not in file.parts:
        places.append(SHIPPED.joinpath(*file.parts[file.parts[:1] == ("configs",) :]))
    for place in [each for path in places if path.name for each in (path, path.with_name(path.name + SUFFIX))]:
        if place.is_file():
            return place
    return places[0]


def nearest_configuration(file: Path) -> str:
    """Return a hint at the configuration whose path or name comes nearest: beside it, or shipped."""
    beside = [str(path) for path in file.parent.glob(f"*{SUFFIX}") if path.is_file()]
    found = [*beside, *names(), *(f"configs/{name}{SUFFIX}" for name in names())]
    close = difflib.get_close_matches(str(file), found, n=1, cutoff=0.6)
    return f'; did you mean "{close[0]}"?' if close else "; physid configs lists those that there are"


def summary(name: str) -> str:
    """Return what a shipped configuration says of itself in its first line."""
    first = (SHIPPED / f"{name}{SUFFIX}").read_text().partition("\n")[0]
    return first.removeprefix("#").strip()


def with_bases(name: str) -> Iterator[str]:
    """Yield a shipped configuration and those that it builds on, by name."""
    from physid.yaml_files import read_yaml

    yield name
    bases = read_yaml(SHIPPED / f"{name}{SUFFIX}").get("base") or []
    for base in [bases] if isinstance(bases, str) else bases:
        yield from with_bases((PurePosixPath(name).parent / base).with_suffix("").as_posix())
