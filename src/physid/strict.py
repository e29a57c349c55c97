"""Values as messages quote them, the nearest known name, and numbers that check themselves."""

from __future__ import annotations

import difflib
import math
import os
import unicodedata
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

MOST_SHOWN = 100
"""Letters of a value that a message quotes."""

LARGEST: Mapping[str, int] = {
    "trajectories": 10**6,  # their files have numbers of six digits, and are sorted by name
    "steps": 10**7,  # a day at 100 frames per second
    "film": 10**5,  # frames with masks that are rendered into memory: some gigabytes
    "instants": 10**8,  # that a simulator steps through in a trajectory: hours
    "poses": 10**7,  # of all trajectories of an experiment, which are held in memory with their sensitivities
    "substeps": 10**5,
    "sets": 10**5,
    "sample": 10**7,
    "seeds": 10**4,
    "workers": 4096,
    "setting": 10**6,  # whatever a setting counts
    "seed": 2**63 - 1,  # what torch takes
    "seed_everything": 2**32 - 1,  # what NumPy's older generator takes, too
}
"""What may be asked for at most. Nobody needs more, and more would end, after a long time or at once, for want of
memory."""
LARGEST_VALUE = 1e9
"""Of what is measured, in SI; a square of more, or a step of its motion, is beyond what numbers resolve."""
UNSEEN = ("Cc", "Cs", "Zl", "Zp")
TURNING = "".join(map(chr, (0x61C, 0x200E, 0x200F, *range(0x202A, 0x202F), *range(0x2066, 0x206A))))
"""Categories of Unicode, and marks of direction, that no name needs."""
RATES = (0.01, 1e6)
"""[Hz] Least and largest number of frames, or rows of forces, per second."""


def nearest(name: str, known: Iterable[str]) -> str:
    """Return '; did you mean "..."?' for the nearest known name, or the list of what is known where none is near."""
    names = [str(one) for one in known]
    close = difflib.get_close_matches(str(name)[:MOST_SHOWN], names, n=1, cutoff=0.6)
    return f'; did you mean "{close[0]}"?' if close else f"; known are {', '.join(names) or 'none'}"


def shown(value: object, most: int = MOST_SHOWN) -> str:
    """Return a value as a message can quote it: in one line, cut where it is long."""
    try:
        text = repr(value)
    except ValueError:  # Python does not write whole numbers of more than some thousand digits
        return f"a number of {value.bit_length()} bits" if isinstance(value, int) else type(value).__name__
    return text if len(text) <= most else f"{text[:most]}..."


def quoted(value: object, most: int = MOST_SHOWN) -> str:
    """Return a name in double quotes, cut where it is long; what is not seen is escaped."""
    text = one_line(" ".join(str(value).split()))
    return f'"{text}"' if len(text) <= most else f'"{text[:most]}..."'


def one_line(text: str) -> str:
    """Return a text with everything that is not seen escaped: it ends no line or comment, and moves no cursor."""
    return "".join(each if each.isprintable() else each.encode("unicode_escape").decode() for each in text)


def at_home(value: Any) -> Any:
    """Return a value in which texts that begin with ~/ name places below the user's home folder, as shells have it."""
    if isinstance(value, str):
        return os.path.expanduser(value) if value.startswith("~/") else value
    if isinstance(value, list):
        return [at_home(each) for each in value]
    return {key: at_home(each) for key, each in value.items()} if isinstance(value, dict) else value


def joined(values: Mapping[Any, Any], where: str) -> dict[Any, Any]:
    """Return a mapping of scalars with one dotted key for each nested one: `block: {friction: 0.4}` is block.friction.

    Raises:
        ValueError: If it holds one twice.
    """
    found: dict[Any, Any] = {}
    for name, value in _flat(values.items(), ""):
        if name in found:
            raise ValueError(f"{where}: expected {shown(name)} once, found it by a dotted key and by nested ones")
        found[name] = value
    return found


def _flat(items: Iterable[tuple[Any, Any]], before: str) -> Iterator[tuple[Any, Any]]:
    """Yield nested items by dotted keys; an empty mapping stays as it is, to be refused as no scalar."""
    for name, value in items:
        if isinstance(value, Mapping) and value:
            yield from _flat(value.items(), f"{before}{name}.")
        else:
            yield (f"{before}{name}" if before else name), value


def is_seen(name: str) -> bool:
    """Return whether no character of a name moves a cursor, ends a line or turns the direction of writing.

    Joiners between letters, which Persian and Hindi need, and spaces of any width are fine.
    """
    return not any(unicodedata.category(each) in UNSEEN or each in TURNING for each in name)


def seen(name: str, where: str) -> str:
    """Return a name that is shown on terminals and in pages, where no character of it moves a cursor or ends a line.

    Raises:
        ValueError: If a character is a control character, or another one that is not seen.
    """
    if not is_seen(name):
        raise ValueError(f"{where} must hold characters that are seen, got {shown(name)}; rename it")
    return name


def number(value: object, where: str, *, low: float = -math.inf, high: float = math.inf, strict: bool = False) -> float:
    """Return `value` as a finite float that is at least `low` (above it, where `strict`), and at most `high`.

    Raises:
        ValueError: If it is no number, not finite, too small or too large.
    """
    wanted = "a finite number" if low == -math.inf else f"a number {'above' if strict else 'of at least'} {low:g}"
    if not isinstance(value, int | float) or isinstance(value, bool) or not math.isfinite(value):
        raise ValueError(f"{where} must be {wanted}, got {shown(value)}")
    if value > high:
        raise ValueError(f"{where} must be a number of at most {high:g}, got {shown(value)}")
    if value < low or (strict and value == low):
        raise ValueError(f"{where} must be {wanted}, got {shown(value)}")
    return float(value)


def whole(value: object, where: str, *, low: int, high: int | None = None) -> int:
    """Return `value` as an int that is at least `low`, and at most `high` (see `LARGEST`).

    Raises:
        ValueError: If it is no whole number, too small or too large.
    """
    if not isinstance(value, int) or isinstance(value, bool) or value < low:
        raise ValueError(f"{where} must be a whole number of at least {low}, got {shown(value)}")
    if high is not None and value > high:
        raise ValueError(f"{where} must be a whole number of at most {high}, got {shown(value)}")
    return value


def triple(value: object, where: str) -> tuple[float, float, float]:
    """Return `value` as three finite floats.

    Raises:
        ValueError: If it is no list of three numbers.
    """
    if isinstance(value, str | Mapping) or not isinstance(value, Iterable):
        raise ValueError(f"{where} must be a list of 3 numbers, got {shown(value)}")
    values = [number(one, f"{where}[{axis}]") for axis, one in enumerate(value)]
    if len(values) != 3:
        raise ValueError(f"{where} must be a list of 3 numbers, got {len(values)}")
    return values[0], values[1], values[2]
