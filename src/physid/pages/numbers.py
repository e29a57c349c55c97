"""Numbers and names as people read them on every page."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable

PREFIXES = ((1.0, ""), (1e-3, "m"), (1e-6, "µ"))
SMALLEST_SHOWN = 0.1  # a number below takes the next prefix
MOST_DECIMALS = 6
NOTHING = "-"  # stands where there is no value
NO_UNIT = ("", "-", "1", None)


def words(name: str) -> str:
    """Turn a name into words."""
    return name.replace("_", " ")


def capital(text: str) -> str:
    """Begin with a capital letter."""
    return text[:1].upper() + text[1:]


def join(texts: Iterable[str], last: str) -> str:
    """Join texts by commas and a word before the last."""
    *first, end = list(texts) or [""]
    return f"{', '.join(first)} {last} {end}" if first else end


def figure(value: float, digits: int = 3) -> str:
    """Write a number with some significant digits, with an exponent only where it is very small or large."""
    if value == 0 or not 1e-3 <= abs(value) < 1e5:
        mantissa, _, exponent = f"{value:.{digits - 1}e}".partition("e")
        short = mantissa.rstrip("0").rstrip(".") if "." in mantissa else mantissa
        return f"{short}e{int(exponent)}" if value else "0"
    decimals = max(0, digits - 1 - math.floor(math.log10(abs(value))))
    text = f"{value:.{decimals}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


def percent(share: float) -> str:
    """Write a share in percent; one that is close to 0 or 1 is not rounded onto it."""
    value = 100 * share
    if 0 < value < 0.1 or 99.9 < value < 100:
        return "< 0.1 %" if value < 1 else "> 99.9 %"
    return f"{value:.1f} %" if 0 < value < 1 or 99 < value < 100 else f"{value:.0f} %"


def error(share: float) -> str:
    """Write a relative error in percent; a tiny one keeps its digits, down to 0.001 %."""
    size = 100 * abs(share)
    if size == 0 or size >= 0.001:
        return f"{100 * share:.{3 if size >= 1 else 2}g} %"
    return "< 0.001 %"


def quantity(value: float, unit: str | None, digits: int = 3) -> str:
    """Write a value with its unit, a length with a prefix that suits it."""
    if unit != "m" or value == 0:
        return f"{figure(value, digits)}{unit_of(unit)}"
    factor, prefix = next((each for each in PREFIXES if abs(value) >= SMALLEST_SHOWN * each[0]), PREFIXES[-1])
    return f"{figure(value / factor, digits)} {prefix}{unit}"


def in_unit(unit: str | None) -> Callable[[float], str]:
    """Return what writes a value with a unit."""
    return lambda value: quantity(value, unit)


def unit_of(unit: str | None) -> str:
    """Return a unit with a space before it; nothing for a number without a unit."""
    return "" if unit in NO_UNIT else f" {unit}"


def resolved(value: float, low: float, high: float) -> tuple[str, str, str]:
    """Write a value and its interval with two digits of the width of the interval, so that they can be told apart."""
    width = high - low
    decimals = 1 - math.floor(math.log10(width)) if width > 0 else MOST_DECIMALS + 1
    if not 0 <= decimals <= MOST_DECIMALS:
        return figure(value), figure(low), figure(high)
    return f"{value:.{decimals}f}", f"{low:.{decimals}f}", f"{high:.{decimals}f}"


def interval(value: float, low: float, high: float, unit: str | None = "") -> str:
    """Write a value with its interval and unit."""
    middle, least, most = resolved(value, low, high)
    return f"{middle} ({least} to {most}){unit_of(unit)}"


def duration(seconds: float) -> str:
    """Write a time in the unit that suits it."""
    for size, unit in ((7200, 3600), (120, 60)):
        if seconds >= size:
            return f"{figure(seconds / unit)} {'h' if unit == 3600 else 'min'}"
    return f"{figure(seconds)} s"


def p_value(value: float, simulations: int | None = None, *, brief: bool = False) -> str:
    """Write a p-value; one that is the least that so many null simulations can say is written as below it.

    With Z simulations p = (1 + more extreme ones) / (1 + Z): at least 1 / (1 + Z), however clear the effect is.
    """
    if simulations and value * (1 + simulations) < 1.5:
        least = f"< {figure(1 / (1 + simulations), 2)}"
        return least if brief else f"{least} (the least that {simulations} simulations can say)"
    return figure(value, 2)


def named(name: str, value: float) -> str:
    """Write a figure with the unit that its name implies; errors of positions are relative to the object's size."""
    if re.search("position_error|relative_error|_share$", name):
        return error(value)
    if re.search("rotation_error", name):
        return f"{figure(value)}°"
    if re.search("(position|rotation)_(noise|unexplained)$", name):
        return quantity(value, "m") if "position" in name else f"{figure(math.degrees(value))}°"
    if name.endswith("seconds"):
        return duration(value)
    return f"{figure(value, 4)} dB" if "psnr" in name else figure(value, 4)


def plural(count: int, word: str) -> str:
    """Write how many there are of something."""
    if count == 1:
        return f"1 {word}"
    return f"{count} {word[:-2]}es" if word.endswith("sis") else f"{count} {word}s"
