"""Units that logs come in, and what one of each is in SI."""

from __future__ import annotations

import math
import re

from physid.strict import nearest

UNITS: dict[str, dict[str, float]] = {
    "position": {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "um": 1e-6, "km": 1e3, "in": 0.0254, "ft": 0.3048},
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0},
    "angle": {"rad": 1.0, "deg": math.pi / 180, "mrad": 1e-3},
    "force": {"N": 1.0, "mN": 1e-3, "kN": 1e3, "kgf": 9.80665, "gf": 9.80665e-3, "lbf": 4.4482216152605},
    "torque": {
        "N m": 1.0, "N mm": 1e-3, "N cm": 1e-2, "mN m": 1e-3, "kN m": 1e3, "kgf m": 9.80665, "kgf cm": 0.0980665,
        "lbf ft": 1.3558179483314, "lbf in": 0.1129848290276,
    },
    "size": {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "in": 0.0254},
    "mass": {"kg": 1.0, "g": 1e-3, "lb": 0.45359237},
}  # fmt: skip
"""For each quantity [SI] the units it may come in."""
ALIASES = {
    "meter": "m", "meters": "m", "metre": "m", "metres": "m", "millimeter": "mm", "millimeters": "mm",
    "millimetres": "mm", "centimeters": "cm", "sec": "s", "secs": "s", "second": "s", "seconds": "s", "msec": "ms",
    "millis": "ms", "milliseconds": "ms", "usec": "us", "micros": "us", "microseconds": "us",
    "nsec": "ns", "nanos": "ns", "nanoseconds": "ns", "degree": "deg", "degrees": "deg", "°": "deg",
    "radians": "rad", "newton": "N", "newtons": "N", "n": "N", "nm": "N m", "nmm": "N mm", "inch": "in",
    "inches": "in", "gram": "g", "grams": "g", "radian": "rad", "º": "deg", "newton meters": "N m",
    "newton metres": "N m", "micrometers": "um", "micrometres": "um", "msecs": "ms", "hours": "h", "minutes": "min",
}  # fmt: skip
BY_CASE = ("force", "torque")  # mN is not MN; of the other quantities no two units differ by case alone
BRACKETED = re.compile(r"^(?P<name>.*?)\s*[\[(](?P<unit>[^\])]*)[\])]\s*$")
SUFFIXED = re.compile(
    r"^(?P<name>.+)_(?P<unit>ms|us|ns|mN|kN|Nm|Nmm|cm|um|sec|secs|msec|usec|nsec|(?i:mm|deg|degrees|rad))$"
)
# No _m, _s, _N or _in: names end like this for other reasons, but for the axis of a force.
FORCE_IN_N = re.compile(r"^(?P<name>(?:.*_)?f(?:orce)?_?[xyz])_(?P<unit>N)$", re.IGNORECASE)


def factor_of(quantity: str, unit: object, where: str) -> float:
    """Return what one of a unit is in SI.

    Args:
        quantity: A key of `UNITS`.
        unit: The unit's name.
        where: Names the place for the message.

    Raises:
        ValueError: If the unit is unknown, or one of another quantity.
    """
    name = canonical(str(unit), quantity)
    if name is None:
        raise ValueError(f'{where}: unknown unit "{unit}"{nearest(str(unit), UNITS[quantity])}')
    return UNITS[quantity][name]


def canonical(unit: str, quantity: str) -> str | None:
    """Return the name that a unit has in `UNITS`, or None where it is no unit of the quantity."""
    known = UNITS[quantity]
    plain = re.sub(r"[·⋅∙*.]|(?<=\w)-(?=\w)", " ", unit.strip())
    plain = plain.replace("\N{MICRO SIGN}", "u").replace("\N{GREEK SMALL LETTER MU}", "u")
    for each in (
        plain,
        ALIASES.get(plain.lower(), ""),
        plain.replace(" ", ""),
        ALIASES.get(plain.replace(" ", "").lower()),
    ):
        if each in known:
            return each
    same = [each for each in known if each.lower() == plain.lower()]
    return same[0] if same and quantity not in BY_CASE else None


def split_header(header: str) -> tuple[str, str | None]:
    """Split "x [mm]", "x (mm)" or "x_mm" into name and unit; None where a header names no unit."""
    found = BRACKETED.match(header) or _suffixed(header)
    return (found["name"].strip(), found["unit"].strip()) if found and found["name"] else (header.strip(), None)


def is_suffixed(header: str) -> bool:
    """Return whether a header names its unit by how it ends alone, as other words do: x_cm, centre of mass."""
    return not BRACKETED.match(header) and _suffixed(header) is not None


def _suffixed(header: str) -> re.Match[str] | None:
    """Find the unit with which a header ends."""
    return SUFFIXED.match(header) or FORCE_IN_N.match(header)
