"""The digits of the numbers in diagnosis.json."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from physid.diagnosis.document.document import Diagnosis, check_diagnosis

DIGITS = 5


def rounded(diagnosis: Diagnosis) -> Diagnosis:
    """Return a diagnosis with the digits that its file has."""
    plain = diagnosis.to_mapping()
    return check_diagnosis(_rounded(plain) | {"settings": diagnosis.settings})


def _rounded(value: Any) -> Any:
    """Round the numbers in plain values."""
    if isinstance(value, Mapping):
        return {name: _rounded(each) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(each) for each in value]
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) and math.isfinite(value) else value
