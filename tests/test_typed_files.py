"""What is wrong with a file is said in one line: where, what was expected, what came, and the nearest key."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal

import pytest

from physid.typed_files import CLOSED, check_as, read_json_as, read_yaml_as


@dataclass(frozen=True)
class Wheel:
    __pydantic_config__: ClassVar[Any] = CLOSED
    radius: float
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if self.radius <= 0:
            raise ValueError(f"radius must be positive, got {self.radius}")


@dataclass(frozen=True)
class Cart:
    __pydantic_config__: ClassVar[Any] = CLOSED
    name: Literal["cart", "wagon"]
    wheels: tuple[Wheel, ...]
    spare: Wheel | None = None
    named: dict[str, Wheel] | None = None
    count: int = 1
    electric: bool = False


GOOD: dict[str, Any] = {"name": "cart", "wheels": [{"radius": 1}, {"radius": 0.5, "centre": [1, 2, 3]}]}


def test_what_fits_becomes_the_model_lists_as_tuples_and_whole_numbers_as_floats() -> None:
    cart = check_as(Cart, GOOD)
    assert cart == Cart("cart", (Wheel(1.0), Wheel(0.5, (1.0, 2.0, 3.0))))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"nmae": 1}, 'f: unknown key "nmae"; did you mean "name"?'),
        ({"zzz": 1}, 'f: unknown key "zzz"; known are name, wheels, spare, named, count, electric'),
        ({"wheels": [{"radius": 1, "center": 2}]}, 'f: wheels[0]: unknown key "center"; did you mean "centre"?'),
        ({"spare": {"radius": 1, "raduis": 2}}, 'f: spare: unknown key "raduis"; did you mean "radius"?'),
        ({"named": {"a": {"radius": 1, "raduis": 2}}}, 'f: named.a: unknown key "raduis"; did you mean "radius"?'),
        ({"name": "car"}, "f: name: expected 'cart' or 'wagon', found 'car'"),
        ({"wheels": [{}]}, "f: wheels[0]: missing key radius"),
        ({"wheels": 3}, "f: wheels: expected a list, found 3"),
        ({"wheels": [3]}, "f: wheels[0]: expected a mapping with the keys radius, centre, found 3"),
        ({"wheels": [{"radius": "1"}]}, "f: wheels[0].radius: expected a finite number, found '1'"),
        ({"wheels": [{"radius": True}]}, "f: wheels[0].radius: expected a finite number, found True"),
        ({"wheels": [{"radius": float("nan")}]}, "f: wheels[0].radius: expected a finite number, found nan"),
        ({"wheels": [{"radius": -1}]}, "f: wheels[0]: radius must be positive, got -1.0"),
        ({"wheels": [{"radius": 1, "centre": [1]}]}, "f: wheels[0].centre: expected a list of 3, found [1]"),
        ({"wheels": [{"radius": 1, "centre": [1] * 9}]}, "f: wheels[0].centre: expected a list of 3, found 9"),
        ({"count": 1.5}, "f: count: expected a whole number, found 1.5"),
        ({"electric": "yes"}, "f: electric: expected true or false, found 'yes'"),
        ({"electric": "y" * 999}, f"f: electric: expected true or false, found '{'y' * 59}..."),
    ],
)
def test_a_fault_is_one_line(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=r"^f: ") as caught:
        check_as(Cart, GOOD | change, "f")
    assert str(caught.value) == message


def test_of_many_faults_the_first_are_named_and_the_others_counted() -> None:
    with pytest.raises(ValueError, match=r"^f: wheels") as caught:
        check_as(Cart, {"wheels": [{"radius": "1"}] * 20}, "f")
    first, *_, last = str(caught.value).split("; ")
    assert (first, last) == ("f: wheels[0].radius: expected a finite number, found '1'", "and 18 more")
    assert len(str(caught.value).splitlines()) == 1


def test_files_are_named(tmp_path: Path) -> None:
    path = tmp_path / "cart.yaml"
    path.write_text(json.dumps(GOOD | {"count": "3"}))
    for read in (read_json_as, read_yaml_as):
        with pytest.raises(ValueError, match=rf"^{path}: count: expected a whole number, found '3'$"):
            read(Cart, path)
    path.write_text("{")
    with pytest.raises(ValueError, match=f"^{path}: expected JSON, found a damaged file"):
        read_json_as(Cart, path)
    path.write_text("name: 2020-01-01")
    with pytest.raises(ValueError, match=f"^{path}: expected mappings, lists, texts and numbers, found"):
        read_yaml_as(Cart, path)
