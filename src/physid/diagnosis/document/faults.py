"""Collecting what is wrong with a parsed document, so that one message names all of it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

MOST_SHOWN = 12
LONGEST = 60


class Faults:
    """What is wrong with a document so far; every check names the place, what was expected and what came."""

    def __init__(self) -> None:
        self.found: list[str] = []

    def expect(self, fine: bool, where: str, expected: str, found: object) -> bool:
        """Note a fault unless all is fine; returns whether it is."""
        if not fine:
            shown = repr(found)
            shown = shown if len(shown) <= LONGEST else shown[: LONGEST - 3] + "..."
            self.found.append(f"{where}: expected {expected}, found {shown}")
        return fine

    def mapping(self, value: object, where: str, keys: Sequence[str]) -> Mapping[str, Any] | None:
        """Check that a value is a mapping with exactly these keys; returns it, or None where a key is missing."""
        if not isinstance(value, Mapping):
            self.expect(False, where, f"a mapping with {', '.join(keys)}", value)
            return None
        missing = [key for key in keys if key not in value]
        strange = [key for key in value if key not in keys]
        self.expect(not missing, where, f"the keys {', '.join(keys)}", f"no {', '.join(missing)}")
        self.expect(not strange, where, f"the keys {', '.join(keys)} only", strange)
        return None if missing else value

    def items(self, value: object, where: str) -> Iterator[tuple[str, Any]]:
        """Check that a value is a list; yields the name of each place and what is there."""
        if self.expect(isinstance(value, list | tuple), where, "a list", value):
            assert isinstance(value, list | tuple)
            yield from ((f"{where}[{index}]", each) for index, each in enumerate(value))

    def entries(self, value: object, where: str) -> Iterator[tuple[str, Any]]:
        """Check that a value is a mapping; yields the name of each place and what is there."""
        if self.expect(isinstance(value, Mapping), where, "a mapping", value):
            assert isinstance(value, Mapping)
            yield from ((f"{where}.{name}", each) for name, each in value.items())

    def text(self, value: object, where: str) -> bool:
        """Check that a value is a text that is not empty."""
        return self.expect(isinstance(value, str) and bool(value.strip()), where, "a text", value)

    def one_of(self, value: object, where: str, known: Sequence[object]) -> bool:
        """Check that a value is one of those known."""
        fine = any(type(value) is type(each) and value == each for each in known)
        return self.expect(fine, where, " or ".join(repr(each) for each in known), value)

    def number(self, value: object, where: str, low: float = -math.inf, high: float = math.inf) -> bool:
        """Check that a value is a finite number in a range."""
        fine = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
        bounds = [f"at least {low:g}"] * (low > -math.inf) + [f"at most {high:g}"] * (high < math.inf)
        expected = " ".join(["a finite number", " and ".join(bounds)]).strip()
        return self.expect(fine and low <= value <= high, where, expected, value)  # type: ignore[operator]

    def estimate(self, value: object, where: str, *, unit: bool = True) -> None:
        """Check a value with its interval and, unless it is a share, its unit."""
        keys = ("value", "low", "high", "unit") if unit else ("value", "low", "high")
        known = self.mapping(value, where, keys)
        if known is None:
            return
        if unit:
            self.expect(isinstance(known["unit"], str), f"{where}.unit", "a text", known["unit"])
        numbers = [self.number(known[key], f"{where}.{key}") for key in ("value", "low", "high")]
        if all(numbers):
            found = f"{known['low']:g}, {known['value']:g}, {known['high']:g}"
            self.expect(known["low"] <= known["value"] <= known["high"], where, "low <= value <= high", found)

    def complain(self, name: str) -> None:
        """Raise a ValueError that lists all faults, if there are any."""
        if self.found:
            shown = self.found[:MOST_SHOWN]
            more = [f"and {len(self.found) - MOST_SHOWN} more"] * (len(self.found) > MOST_SHOWN)
            raise ValueError("\n  ".join([f"not a valid {name}:", *shown, *more]))
