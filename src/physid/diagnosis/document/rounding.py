"""The digits of the numbers in diagnosis.json."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from physid.diagnosis.document.document import Diagnosis, check_diagnosis

DIGITS = 5


def rounded(diagnosis: Diagnosis) -> Diagnosis:
    """Return a diagnosis with the digits that its file has.

    Values of a variable have those of its range: 0 m/s on a scale of metres a second, not 7e-16.
    """
    plain = diagnosis.to_mapping()
    for law in plain.get("residual", ()):
        decimals = DIGITS - math.ceil(math.log10(max(map(abs, law["at"])) or 1.0))
        law["at"] = tuple(round(value, decimals) + 0.0 for value in law["at"])
    return check_diagnosis(_rounded(plain) | {"settings": diagnosis.settings})


def _rounded(value: Any) -> Any:
    """Round the numbers in plain values."""
    if isinstance(value, Mapping):
        return {name: _rounded(each) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(each) for each in value]
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) and math.isfinite(value) else value
