"""Text and YAML from strangers: whatever a file holds, reading it costs time and memory in proportion to its size."""

from __future__ import annotations

import contextlib
import errno
import io
import os
import re
import stat
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import yaml

LARGEST_FILE = 1 << 26
"""Bytes of a text that is read at once; what physid itself writes has a few millions at most."""
DEEPEST = 64
"""Levels of nesting; no configuration and no recording set has more than eight, and Python recurses at each."""
MOST_COPIES, FREE_COPIES = 10, 1000
"""Aliases may make so many nodes of each that is written, and so many in any case: a bomb makes 10^9 of a hundred."""
LONGEST_RESOLVED = 1_000_000
"""Letters and nodes of a configuration once its interpolations are followed."""
LARGEST_BITS = 64
"""Of an integer: what counts, indexes or seeds fits, and every float can hold it."""
LONGEST_NUMBER, LONGEST_KEY = 1000, 1000
"""Letters of a number as it is written (YAML 1.1 reads 1:30:00 to the base 60, which grows as their square), and of a
key, which stands in the name of all that is below it."""

KINDS_OF_FILE: tuple[tuple[Callable[[int], bool], str], ...] = (
    (stat.S_ISLNK, "a symbolic link"),
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a named pipe"),
    (stat.S_ISSOCK, "a socket"),
)

# libyaml's parser where PyYAML was built with it, ten times as fast; both give the same events.
_Parser: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class YamlError(ValueError):
    """A text that is no YAML, or none that is read here; the message names file and line."""


def open_regular(path: Path, within: Path | None = None) -> io.BufferedReader:
    """Open a file for reading, if it is one: a pipe would let the reader wait, and a device may never end.

    Args:
        path: The file.
        within: The folder in which it must lie, whatever links lead to it; None for anywhere.

    Raises:
        OSError: If it cannot be read, is no regular file, or lies elsewhere; names it.
    """
    if within is not None:
        real, root = Path(os.path.realpath(path)), Path(os.path.realpath(within))
        if not real.is_relative_to(root):
            raise OSError(
                f"{path}: expected a regular file, found a link to what lies outside of {within}; put a file in its "
                "place"
            )
        path = real if os.path.islink(path) else path
    # Not to block holds for pipes; what was opened is inspected, for a name may stand for something else by then.
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
    mode = os.fstat(descriptor).st_mode
    if stat.S_ISREG(mode):
        return os.fdopen(descriptor, "rb")
    os.close(descriptor)
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    raise OSError(f"{path}: expected a regular file, found {kind_of(mode)}; put a file in its place")


def kind_of(mode: int) -> str:
    """Return what something is that is no regular file, from the mode that lstat(2) or fstat(2) gives."""
    return next((name for is_one, name in KINDS_OF_FILE if is_one(mode)), "a device")


def read_bytes(path: Path, most: int | None = LARGEST_FILE, within: Path | None = None) -> bytes:
    """Read a file.

    Args:
        path: The file.
        most: Bytes that it may have; None for as many as it has.
        within: As for `open_regular`.

    Raises:
        OSError: If it cannot be read, is no regular file, lies elsewhere, or has more bytes; names it.
    """
    with open_regular(path, within) as file:
        size = os.fstat(file.fileno()).st_size
        content = file.read(size + 1 if most is None else most + 1) if most is None or size <= most else None
    if content is None or (most is not None and len(content) > most):
        raise OSError(f"{path}: expected at most {(most or 0) / 1e6:.0f} MB, found more; put another file there")
    return content


def read_text(path: Path, encoding: str = "utf-8", most: int | None = LARGEST_FILE, within: Path | None = None) -> str:
    """Read a text file, as `Path.read_text` does; what is no regular file or larger than allowed is refused at once.

    Raises:
        OSError: If it cannot be read, is no regular file, lies elsewhere (see `open_regular`), or has more than `most`
            bytes; names it.
        UnicodeDecodeError: If it is no text.
    """
    return io.StringIO(read_bytes(path, most, within).decode(encoding), newline=None).read()


def read_yaml(path: Path, construct: Callable[[str], Any] = yaml.safe_load) -> Any:
    """Read a YAML file: plain mappings, lists and scalars.

    Args:
        path: The file.
        construct: Makes values of the text; must make nothing but plain values.

    Returns:
        What it holds.

    Raises:
        OSError: If it cannot be read, is no regular file, or very large.
        YamlError: If it is no YAML, or aliases, nesting or integers go beyond the limits above.
    """
    try:
        text = read_text(path)
    except UnicodeDecodeError as error:
        raise YamlError(f"{path}: expected text in UTF-8, found byte {error.object[error.start]:#04x}") from None
    return parse_yaml(text, str(path), construct)


def parse_yaml(text: str, where: str, construct: Callable[[str], Any] = yaml.safe_load) -> Any:
    """Read YAML from a text (see `read_yaml`); `where` names it in messages."""
    try:
        _require_modest(text, where)
        values = construct(text)
    except yaml.MarkedYAMLError as error:
        line = f":{error.problem_mark.line + 1}" if error.problem_mark else ""
        raise YamlError(f"{where}{line}: no valid YAML: {error.problem}") from None
    except yaml.YAMLError as error:
        raise YamlError(f"{where}: no valid YAML: {str(error).splitlines()[0]}") from None
    except YamlError:
        raise
    # A date with a 13th month, keys that are deeply nested; and a tag with a text that is none of its kind.
    except (ValueError, RecursionError, LookupError, AttributeError, ArithmeticError, TypeError) as error:
        tagged = not isinstance(error, ValueError | RecursionError)
        reason = "a tag (!!int, !!bool ...) of a value that is none" if tagged else str(error).splitlines()[0]
        raise YamlError(f"{where}: no valid YAML: {reason}") from None
    for path, value in _leaves(values):
        if isinstance(value, str) and len(value) > LONGEST_KEY and path[-1:] == (value,):
            raise YamlError(f"{where}: expected keys of at most {LONGEST_KEY} letters, found one of {len(value)}")
        if isinstance(value, int) and value.bit_length() > LARGEST_BITS:
            raise YamlError(
                f"{where}: {_dotted(path)}: expected an integer of at most {LARGEST_BITS} bits, found one of "
                f"{value.bit_length()}"
            )
    return values


def require_modest_text(text: str, where: str) -> None:
    """Refuse a text that somebody may read as YAML, if it is a bomb; one that is no YAML is a text.

    Raises:
        YamlError: If aliases or nesting go beyond the limits above.
    """
    with contextlib.suppress(yaml.YAMLError):
        _require_modest(text, where)


def is_index(part: object) -> bool:
    """Return whether a part of a dotted key is the number of an item of a list; digits of other scripts are none."""
    return str(part).isascii() and str(part).isdigit()


def _require_modest(text: str, where: str) -> None:
    """Refuse aliases that multiply, aliases of what holds them, and nesting that is too deep, from the events alone.

    Long numbers, too: whatever reads one to the base 60 takes time in proportion to the square of its length.
    """
    written, anchors = 0, dict[str, int]()  # nodes with all aliases followed, by anchor
    sizes: list[int] = [0]
    names: list[str | None] = [None]
    for event in yaml.parse(text, Loader=_Parser):
        assert event.start_mark is not None
        at = f"{where}:{event.start_mark.line + 1}"
        if isinstance(event, yaml.AliasEvent):
            if event.anchor in names:
                raise YamlError(f"{at}: expected an alias of something else, found *{event.anchor} inside of itself")
            sizes[-1] += anchors.get(str(event.anchor), 1)
        elif isinstance(event, yaml.ScalarEvent):
            written, sizes[-1] = written + 1, sizes[-1] + 1
            if len(event.value) > LONGEST_NUMBER and NUMBER.fullmatch(event.value):
                raise YamlError(f"{at}: expected numbers of at most {LONGEST_NUMBER} letters, found a longer one")
            if event.anchor:
                anchors[event.anchor] = 1
        elif isinstance(event, yaml.CollectionStartEvent):
            written += 1
            sizes.append(1)
            names.append(event.anchor)
            if len(sizes) - 1 > DEEPEST:
                raise YamlError(f"{at}: expected at most {DEEPEST} levels of nesting, found more")
        elif isinstance(event, yaml.CollectionEndEvent):
            size, name = sizes.pop(), names.pop()
            sizes[-1] += size
            if name:
                anchors[name] = size
    if sizes[0] > FREE_COPIES + MOST_COPIES * written:
        raise YamlError(f"{where}: expected aliases to repeat at most {MOST_COPIES} times what is written, found more")


ENVIRONMENT, ASIDE, LONGEST_SHOWN = "oc.env:", object(), 100
NUMBER = re.compile(r"[-+0-9_:.]+")
REFERENCE = re.compile(r"\$\{([^${}]*)\}")


def require_modest_interpolations(values: Any, where: str) -> None:
    """Refuse interpolations that multiply: `${a}${a}` of `${b}${b}` and so on is 10^9 letters of a hundred.

    Args:
        values: Nested mappings and lists, with `${path}` and `${oc.env:NAME}` in their texts.
        where: What they are, for messages.

    Raises:
        YamlError: If they are longer than `LONGEST_RESOLVED` once they are followed, stand within each other, lead
            through each other, or ask another resolver than that of the environment.
    """
    known = dict[tuple[str, ...], int]()

    def size_of(node: Any, path: tuple[str, ...]) -> int:
        if path not in known:
            known[path] = 0  # one that leads back to itself is refused where it is resolved
            known[path] = 1 + sum(parts_of(node, path))
        return known[path]

    def parts_of(node: Any, path: tuple[str, ...]) -> Iterator[int]:
        if isinstance(node, dict | list):
            items = node.items() if isinstance(node, dict) else enumerate(node)
            yield from (size_of(each, (*path, str(key))) for key, each in items)
        elif isinstance(node, str):
            if "${" in REFERENCE.sub("", node):
                raise YamlError(f"{where}: {'.'.join(path)}: expected no interpolation within another one")
            yield len(node)
            for each in REFERENCE.findall(node):
                if each.strip().startswith(ENVIRONMENT):
                    continue
                target = _target(each, path)
                found = None if ":" in each else _at(values, target)
                if ":" in each or found is ASIDE:
                    raise YamlError(
                        f"{where}: {'.'.join(path)}: expected ${{key}} of a value that is written out, or "
                        f"${{oc.env:NAME}}, found ${{{each[:LONGEST_SHOWN]}}}"
                    )
                yield size_of(found, target)

    try:
        size = size_of(values, ())
    except RecursionError:
        raise YamlError(f"{where}: expected few interpolations of interpolations, found a long chain") from None
    if size > LONGEST_RESOLVED:
        raise YamlError(f"{where}: expected interpolations to make at most {LONGEST_RESOLVED} letters, found more")


def _target(reference: str, path: tuple[str, ...]) -> tuple[str, ...]:
    """Return the path that an interpolation at a path names; dots at its start go up from there."""
    name = reference.strip()
    up = len(name) - len(name.lstrip("."))
    parts = tuple(part for part in re.split(r"[.\[\]]", name) if part)
    return (*path[: len(path) - up], *parts) if up else parts


def _at(values: Any, path: tuple[str, ...]) -> Any:
    """Return what stands at a path; None where nothing does, ASIDE where it leads through an interpolation."""
    for part in path:
        if isinstance(values, str) and "${" in values:
            return ASIDE
        if isinstance(values, dict):
            values = values.get(part, values.get(int(part)) if is_index(part) else None)
        elif isinstance(values, list):
            values = values[int(part)] if is_index(part) and int(part) < len(values) else None
        else:
            return None
    return values


def _leaves(values: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[tuple[Any, ...], Any]]:
    """Yield every scalar and every mapping's key with its place: keys and numbers, from the top."""
    if isinstance(values, dict):
        for name, value in values.items():
            yield (*path, name), name
            yield from _leaves(value, (*path, name))
    elif isinstance(values, list | tuple | set):
        for index, value in enumerate(values):
            yield from _leaves(value, (*path, index))
    else:
        yield path, values


def _dotted(path: tuple[Any, ...]) -> str:
    """Return a place as messages name it."""
    large = [isinstance(one, int) and one.bit_length() > LARGEST_BITS for one in path]
    return ".".join("a key" if each else str(one)[:LONGEST_SHOWN] for one, each in zip(path, large, strict=True))
