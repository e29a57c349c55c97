"""Residual laws in words: what a better model would have to add, so that a user can write it as an effect."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from physid.diagnosis.document.errors import Impacts
from physid.diagnosis.document.residual_law import ResidualLaw
from physid.pages.numbers import capital, figure, interval, percent, quantity, unit_of

GROWS = 1.5
"""Factor between the ends of a function from which on it is said to grow or to fall."""
SWINGS = 3
"""Changes of sign from which on it is said to swing."""
NOUNS = {"force": "a force", "torque": "a torque", "shift": "a shift of the picture"}


def law_name(law: ResidualLaw) -> str:
    """Name what acts: "a force across the velocity"."""
    return f"{NOUNS[law.kind]} {law.direction}"


def residual_sentences(laws: Sequence[ResidualLaw]) -> list[str]:
    """Say what a better model would have to add, one sentence for each law."""
    said = []
    for place, law in enumerate(laws):
        share = percent(law.explains)
        if place == 0:
            where = "in trajectories that it was not fitted to"
            said.append(f"What is missing acts like {law_phrase(law)}; it explains {share} of what is left {where}.")
        else:
            said.append(f"{capital(law_phrase(law))} beside it: {share} together.")
    return said


def impacts_sentence(impacts: Impacts | None) -> str:
    """Say how many impacts effects leave unexplained; empty where none are blamed, or impacts are explained anyway."""
    if impacts is None or impacts.with_effects is None:
        return ""
    left = f"{impacts.unexplained} of {impacts.among} segments with an impact or a jolt"
    return f"The model alone does not explain {left}; with what is named, {impacts.with_effects} are left."


def law_phrase(law: ResidualLaw) -> str:
    """Say what acts, on what its size depends, and how large it is where it is surely largest, if it is anywhere."""
    peak = max(range(len(law.size)), key=lambda k: max(law.low[k], -law.high[k]))
    value, low, high = law.size[peak], law.low[peak], law.high[peak]
    name = NOUNS[law.kind]
    region = "" if law.region == "everywhere" else f" {law.region}"
    if law.kind != "shift" and low <= 0 <= high:
        depends = "" if law.variable is None else f" that changes with {_variable(law)}"
        return f"{name} {law.direction}{region}{depends}, of no sure size"
    direction, turned = _direction(law, value)
    if turned:
        value, low, high = -value, -high, -low
    if law.kind == "shift":
        depends = "" if law.variable is None else f" that changes with {_variable(law)}"
        return f"{name} {law.direction}{depends}, by {quantity(law.moves, 'm')}"
    size = interval(value, low, high, law.unit)
    if law.variable is None:
        return f"{name} {direction}{region}, {size}"
    at = f"at {_at(law, law.at[peak])}"
    return f"{name} {direction}{region} that {_how(law)}, {size} {at}"


def _direction(law: ResidualLaw, value: float) -> tuple[str, bool]:
    """Say along what it acts where it is largest, and whether a negative size is said by the words."""
    if law.direction.startswith("across "):
        side = "left" if value > 0 else "right"
        return f"{law.direction} (to its {side})", value < 0
    if value < 0 and law.direction in ("along the velocity", "along the command", "along the spin"):
        return law.direction.replace("along", "against"), True
    return law.direction, False


def _how(law: ResidualLaw) -> str:
    """Say how the size depends on the variable; one that may be zero is."""
    known = zip(law.size, law.low, law.high, strict=True)
    size, name = [0.0 if low <= 0 <= high else value for value, low, high in known], _variable(law)
    first, last, most = abs(size[0]), abs(size[-1]), max(map(abs, size))
    changes = sum(one * other < 0 for one, other in pairwise(filter(None, size)))
    if changes >= SWINGS:
        return f"swings with {name}"
    if changes == 0 and last == most and last > GROWS * first:
        return f"grows with {name}"
    if changes == 0 and first == most and first > GROWS * last:
        return f"falls with {name}"
    return f"changes with {name}"


def _variable(law: ResidualLaw) -> str:
    """Name the variable in a sentence: "the speed", "x"."""
    return f"the {law.variable}" if law.variable and len(law.variable) > 1 else str(law.variable)


def _at(law: ResidualLaw, value: float) -> str:
    """Say where: "1.0 m/s", "x = 0.3 m"."""
    number = f"{figure(value, 2)}{unit_of(law.variable_unit)}"
    return f"{law.variable} = {number}" if law.variable in ("x", "y", "height") else number
