"""What a fit leaves beyond noise, in a sentence: wherever an interval is shown, it is shown as well."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping

KINDS = {"position": (1e3, "mm", "motion"), "rotation": (180 / math.pi, "deg", "turning")}
"""In which units people read what is logged in SI, and what it is a share of."""
STEPS_TAKEN = "steps_taken"
"""Figure of a fit that took no step."""


def unexplained_kinds(figures: Mapping[str, float]) -> tuple[str, ...]:
    """Return of which kinds a fit leaves more than the noise of the poses: the intervals hold for a right model alone.

    Args:
        figures: What a fit has logged, by name (fit/position_explained, ...).
    """
    return tuple(kind for kind in KINDS if figures.get(f"fit/{kind}_explained", 1.0) == 0)


def left_beyond_noise(figures: Mapping[str, float]) -> str:
    """Return how much a fit leaves beyond noise, as `26 mm and 4.3 deg`; nothing where it leaves none.

    Args:
        figures: What was logged, by name.
    """
    kinds = {kind: KINDS[kind] for kind in unexplained_kinds(figures) if f"fit/{kind}_unexplained" in figures}
    return " and ".join(
        f"{_short(scale * figures[f'fit/{kind}_unexplained'])} {unit}" for kind, (scale, unit, _) in kinds.items()
    )


def not_fitted_sentence(figures: Mapping[str, float]) -> str | None:
    """Say that a fit took no step at all; None where it took one, or nobody looked.

    Args:
        figures: What was logged, by name.
    """
    if figures.get(STEPS_TAKEN, 1.0) > 0:
        return None
    return (
        "NOTHING WAS FITTED: the parameters are first guesses, since no step was taken within the limits of the trainer"
    )


def lack_of_fit_sentence(figures: Mapping[str, float], recordings: str = "RECORDINGS") -> str | None:
    """Say whether a fit leaves more than noise, and what to do then; None where a fit has not looked.

    Args:
        figures: What was logged, by name.
        recordings: The set that was fitted, to name in advice.
    """
    if not all(f"fit/{kind}_explained" in figures for kind in KINDS):
        return None
    noise = {kind: f"{_short(scale * figures[f'fit/{kind}_noise'])} {unit}" for kind, (scale, unit, _) in KINDS.items()}
    parts = []
    for kind in unexplained_kinds(figures):
        scale, unit, whole = KINDS[kind]
        share, left = figures.get(f"fit/{kind}_share"), figures[f"fit/{kind}_unexplained"]
        # Of what moves by less than the noise there is no share.
        moves = share and left / share > figures[f"fit/{kind}_noise"]
        of_all = f"{_short(100 * share)} % of the {whole}, " if share and moves else ""
        parts.append(f"{of_all}{_short(scale * left)} {unit} (noise {noise[kind]})")
    if not parts:
        return f"the fit leaves nothing beyond the noise of the poses ({' and '.join(noise.values())})"
    return f"the model leaves {' and '.join(parts)}: run physid diagnose {shlex.quote(recordings)}"


def _short(value: float) -> str:
    """Write a number with two digits, 170 and not 1.7e+02."""
    return f"{float(f'{value:.2g}'):g}"
