"""Whatever a reader is given: a value or a short message, never a traceback, and soon. More in benchmarks/fuzz.py."""

from __future__ import annotations

import random
import sys
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from physid.yaml_files import YamlError, parse_yaml

INPUTS = 60
"""For each of eighteen targets."""


sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
import fuzz  # noqa: E402

fuzz.import_all()
MODEST = settings(
    max_examples=INPUTS,
    deadline=1000 * fuzz.LONGEST,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
    derandomize=True,
    database=None,
)


@pytest.mark.filterwarnings("ignore:Reading `.npy` or `.npz` file required additional header parsing")
@pytest.mark.parametrize("target", fuzz.TARGETS, ids=lambda target: target.name)
def test_damaged_input_ends_in_a_value_or_a_short_message(target: object, tmp_path: Path) -> None:
    @MODEST
    @given(st.integers(0, 2**32))
    def attempt(seed: int) -> None:
        _, fault = fuzz.attempt(target, random.Random(seed), tmp_path / "input")
        assert fault is None, fault

    attempt()


@MODEST
@given(st.text(alphabet="ab:[]{},&*!<- \n\"'0#|>?%@", max_size=60))
def test_any_text_is_yaml_or_refused_in_one_line(text: str) -> None:
    try:
        parse_yaml(text, "here")
    except YamlError as error:
        message = str(error)
    else:
        message = "here"
    assert message.startswith("here")
    assert "\n" not in message
