"""Files as typed models: pydantic checks what a file holds, and what is wrong is said in lines of the house style."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, get_args, get_type_hints

from physid.strict import nearest, quoted, shown
from physid.yaml_files import read_text, read_yaml

if TYPE_CHECKING:
    from pydantic import TypeAdapter, ValidationError

T = TypeVar("T")
CLOSED: Any = {"extra": "forbid", "strict": True, "allow_inf_nan": False, "frozen": True}
"""Configuration of every model, of plain dataclasses as well (their `__pydantic_config__`): unknown keys, numbers
written as texts, NaN and infinity are errors."""
MOST_SHOWN = 3  # faults that a message lists
LONGEST = 60  # letters of a value that is quoted
EXPECTED = {
    "json_invalid": "valid JSON ({error})",
    "float_type": "a finite number",
    "finite_number": "a finite number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "greater_than": "a number above {gt:g}",
    "greater_than_equal": "a number of at least {ge:g}",
    "less_than": "a number below {lt:g}",
    "less_than_equal": "a number of at most {le:g}",
    "string_type": "a text",
    "string_too_short": "a text",
    "string_pattern_mismatch": "a text that fits {pattern}",
    "bool_type": "true or false",
    "literal_error": "{expected}",
    "list_type": "a list",
    "tuple_type": "a list",
    "too_short": "at least {min_length} of them",
    "dict_type": "a mapping",
}


def check_as(kind: type[T], content: object, where: str = "") -> T:
    """Check plain content, as a JSON or YAML file holds it, against a model.

    Args:
        kind: A pydantic model, or a dataclass whose `__pydantic_config__` is `CLOSED`.
        content: Mappings, lists and scalars.
        where: Name of the file or of the entry, put before the message; may be empty.

    Returns:
        The model.

    Raises:
        ValueError: If anything is wrong; names each place, what was expected and what came, and the nearest key.
    """
    from pydantic import ValidationError

    try:
        text = json.dumps(content)
    except (TypeError, ValueError, RecursionError) as error:  # a date, say, which YAML knows and JSON does not
        raise ValueError(
            _after(where, f"expected mappings, lists, texts and numbers, found others ({error})")
        ) from None
    try:  # In strict mode pydantic takes lists for tuples and mappings for dataclasses from JSON alone.
        model: Any = kind
        checked: T = _adapter(model).validate_json(text)
        return checked
    except ValidationError as error:
        raise ValueError(explain(error, kind, where)) from None


def without_nulls(content: object) -> object:
    """Return a mapping without its empty keys, which then have their defaults; anything else as it is."""
    return {key: one for key, one in content.items() if one is not None} if isinstance(content, Mapping) else content


def read_yaml_as(kind: type[T], path: Path) -> T:
    """Read a YAML file as a model (see `read_yaml` and `check_as` for the errors, which name the file)."""
    return check_as(kind, read_yaml(path), str(path))


def read_json_as(kind: type[T], path: Path, within: Path | None = None) -> T:
    """Read a JSON file as a model; `within` names the folder in which it must lie (see `open_regular`).

    Raises:
        OSError: If it cannot be read, or lies elsewhere.
        ValueError: If it is damaged, or does not fit the model; names the file.
    """
    try:
        content = json.loads(read_text(path, within=within))
    except (ValueError, RecursionError) as error:
        found = str(error).splitlines()[0] if path.stat().st_size else "an empty file"
        raise ValueError(f"{path}: expected JSON, found a damaged file ({found}); delete it") from None
    return check_as(kind, content, str(path))


@cache
def _adapter(kind: Any) -> TypeAdapter[Any]:
    """Return what checks a model; made once."""
    from pydantic import TypeAdapter

    return TypeAdapter(kind)


def explain(error: ValidationError, kind: Any, where: str = "") -> str:
    """Say what pydantic found wrong, in one line: the first faults, and how many there are beside them."""
    faults = list(_faults(error, kind))
    more = [f"and {len(faults) - MOST_SHOWN} more"] * (len(faults) > MOST_SHOWN)
    return _after(where, "; ".join([*faults[:MOST_SHOWN], *more]))


def _faults(error: ValidationError, kind: Any) -> Iterator[str]:
    """Yield a line for each fault; keys and items that are missing from one place share a line."""
    missing: dict[tuple[int | str, ...], list[int | str]] = {}
    inputs: dict[tuple[int | str, ...], object] = {}
    for fault in error.errors(include_url=False):
        place, what, found, context = fault["loc"], fault["type"], fault["input"], fault.get("ctx", {})
        if what == "missing":
            missing.setdefault(place[:-1], []).append(place[-1])
            inputs[place[:-1]] = found
        elif what in ("extra_forbidden", "unexpected_keyword_argument"):
            known = nearest(str(place[-1]), _keys(_kind_at(kind, place[:-1])))
            yield _after(_dotted(place[:-1]), f"unknown key {quoted(place[-1])}{known}")
        elif what == "value_error":
            yield _after(_dotted(place), str(context["error"]))
        elif what == "too_long":
            yield _after(
                _dotted(place), f"expected a list of {context['max_length']}, found {context['actual_length']}"
            )
        else:
            expected = EXPECTED.get(what, fault["msg"]).format(**context)
            if what in ("model_type", "dataclass_type"):
                expected = f"a mapping with the keys {', '.join(_keys(_kind_at(kind, place)))}"
            elif expected == "a list" and isinstance(found, str):
                expected = f"a list such as [{found if len(found) <= LONGEST else 'a, b'}]"
            yield _after(_dotted(place), f"expected {expected}, found {shown(found, LONGEST)}")
    for place, keys in missing.items():
        if isinstance(keys[-1], int):
            yield _after(_dotted(place), f"expected a list of {keys[-1] + 1}, found {shown(inputs[place], LONGEST)}")
        else:
            yield _after(_dotted(place), f"missing key {', '.join(map(str, keys))}")


def _after(where: str, text: str) -> str:
    return f"{where}: {text}" if where else text


def _dotted(place: tuple[int | str, ...]) -> str:
    """Write a place as `effects[0].parameters.gain`."""
    return "".join(f"[{one}]" if isinstance(one, int) else f".{one}" for one in place).removeprefix(".")


def _kind_at(kind: Any, place: tuple[int | str, ...]) -> Any:
    """Return the model at a place below another one."""
    for one in place:
        if isinstance(one, str) and _keys(kind):
            kind = get_type_hints(kind).get(one)
        else:  # an item of a list, or the value of a free key
            kind = [each for each in get_args(kind) if each is not Ellipsis][-1]
        if type(None) in get_args(kind):
            kind = next(each for each in get_args(kind) if each is not type(None))
    return kind


def _keys(kind: Any) -> list[str]:
    """Return the keys of a model; none for everything else."""
    if dataclasses.is_dataclass(kind):
        return [field.name for field in dataclasses.fields(kind)]
    return list(getattr(kind, "__pydantic_fields__", ()))
