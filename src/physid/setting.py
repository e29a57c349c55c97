"""What a setting is: a value with a unit, a meaning and an origin, in a section that cannot be changed."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict, Field
from pydantic.config import JsonDict

from physid.strict import LARGEST

NOT_CALIBRATED = "not calibrated"


class Section(BaseModel):
    """Settings of one module; frozen, closed, and finite."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


def setting(default: Any, unit: str, meaning: str, calibrated: str = NOT_CALIBRATED, **limits: Any) -> Any:
    """Declare a setting.

    Args:
        default: Its value.
        unit: Of the value; "-" for a pure number, "" for a switch.
        meaning: What it decides, as a phrase.
        calibrated: The decision record or the bank from which the value came.
        limits: Bounds as pydantic takes them: `ge`, `gt`, `le`, `lt`. What counts has an upper one in any case.
    """
    if isinstance(default, int) and not isinstance(default, bool) and not {"le", "lt"} & limits.keys():
        limits["le"] = LARGEST["setting"]
    more: JsonDict = {"unit": unit, "calibrated": calibrated}
    return Field(default, description=meaning, json_schema_extra=more, validate_default=True, **limits)
