"""Whatever a reader is given: a value or a short message, never a traceback, and soon. More in benchmarks/fuzz.py."""

from __future__ import annotations

import importlib.util
import random
import sys
from pathlib import Path
from types import ModuleType

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from physid.yaml_files import YamlError, parse_yaml

PATH = Path(__file__).parents[1] / "benchmarks" / "fuzz.py"
INPUTS = 80
"""For each of thirteen targets."""


def load() -> ModuleType:
    """Load the script as a module."""
    spec = importlib.util.spec_from_file_location("fuzz", PATH)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["fuzz"] = module
    spec.loader.exec_module(module)
    module.import_all()
    return module


FUZZ = load()
MODEST = settings(
    max_examples=INPUTS,
    deadline=1000 * FUZZ.LONGEST,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
    derandomize=True,
    database=None,
)


@pytest.mark.filterwarnings("ignore:Reading `.npy` or `.npz` file required additional header parsing")
@pytest.mark.parametrize("target", FUZZ.TARGETS, ids=lambda target: target.name)
def test_damaged_input_ends_in_a_value_or_a_short_message(target: object, tmp_path: Path) -> None:
    @MODEST
    @given(st.integers(0, 2**32))
    def attempt(seed: int) -> None:
        _, fault = FUZZ.attempt(target, random.Random(seed), tmp_path / "input")
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
