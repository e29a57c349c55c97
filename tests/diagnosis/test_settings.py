"""Settings: every deciding number is one, each is read somewhere, and a wrong key or value is said in one line."""

from __future__ import annotations

import ast
import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from pydantic import ValidationError

from physid.cli import main
from physid.diagnosis import diagnose as pipeline
from physid.diagnosis.settings.settings import Settings, parse_changes

ROOT = Path(pipeline.__file__).parent.parent
ROOMS = (
    "estimation/measurement", "estimation/prediction", "estimation/least_squares", "estimation/segmented_fit",
    "diagnosis/inputs", "diagnosis/reference", "diagnosis/testing", "diagnosis/residual_law", "diagnosis/selection",
    "diagnosis/posterior", "diagnosis/conclusion",
)  # fmt: skip
"""Where a diagnosis decides; `document` and `report` only present it."""
FILES = [
    ROOT / "diagnosis/analysis.py",
    ROOT / "diagnosis/diagnose.py",
    ROOT / "inspection/usability.py",
    *(path for room in ROOMS for path in sorted((ROOT / room).glob("*.py"))),
]
NAMES = [path.relative_to(ROOT).as_posix() for path in FILES]
TRIVIAL = {0, 1, 2, 3, 6, 7, 0.5}
"""Neutral values, halves, doubles, the three axes, the six coordinates of a pose difference and the seven of a pose."""
TINY, HUGE = 1e-6, 1e9
"""What is at most so small or at least so large keeps a division or a comparison finite, and decides nothing."""
LISTED = {
    "diagnosis/reference/stored_fit.py": {9},  # LAYOUT
    "diagnosis/reference/null_simulations.py": {12},  # the same of one line, 12 sigma^2 / n^3
    "diagnosis/testing/null_tails.py": {9},  # Wilson and Hilferty 1931
    "diagnosis/conclusion/localisation.py": {4},  # digits
    "estimation/least_squares/covariance.py": {0.9},  # CONFIDENCE
    "estimation/least_squares/discretisation.py": {4},  # an axis, and the quarter that the settings describe
    "estimation/least_squares/experiment.py": {4},  # an axis
    "estimation/least_squares/jacobian.py": {4, 12, 0.9, 1e-3, 2.5e-4, 0.1, 1e-5},  # directions of a state; see below
    "estimation/least_squares/line_search.py": {1e3},  # largest damping: a state that stays where it is
    "estimation/measurement/correlated_noise.py": {4, 8, 12, 16, 24, 32, 48, 64, 0.9},  # NEIGHBOURS; a ninth decile
    "estimation/measurement/correlation.py": {0.7, 1.5, 4, 8, 12, 16, 24, 32},  # TIMES, WHITE, FORGOTTEN
    "estimation/measurement/deviation.py": {1.4826, 0.98661},  # of a normal distribution
    "estimation/measurement/force_noise.py": {4},  # BLOCKS
    "estimation/measurement/misfit.py": {4, 9, 15, 20, 0.15, 2e-4},  # third differences; SHARE_OF_...
    "estimation/measurement/outliers.py": {5},  # NEXT
    "estimation/measurement/sensor_noise.py": {4, 1.5},  # of differences
    "estimation/measurement/tracking_error.py": {4, 8, 16, 32, 0.15},  # SPANS, SURE
    "estimation/measurement/unexplained.py": {1e3, 180},  # units
    "estimation/prediction/coordinates.py": {14, 0.1},  # see below
    "estimation/prediction/rollout.py": {400_000},  # memory
    "estimation/prediction/segments.py": {16, 32, 64, 128, 240},  # CLASSES; the usual frame rate
}
CONSTANTS = {
    "diagnosis/reference/stored_fit.py": {"LAYOUT"},  # version of a file
    "diagnosis/conclusion/gap.py": {"ROTATION, POSITION"},  # columns
    "estimation/least_squares/covariance.py": {"CONFIDENCE"},  # what intervals mean by default
    "estimation/least_squares/jacobian.py": {
        "SHIFTS",  # columns
        "SLOPES", "BEND", "FAINT",  # no part of a diagnosis: identifiability alone looks at two step sizes
    },
    "estimation/least_squares/levenberg_marquardt.py": {"WHOLE"},  # the whole step
    "estimation/measurement/force_noise.py": {"BLOCKS", "CUBIC"},  # rows that are averaged; a third difference
    "estimation/measurement/misfit.py": {
        "SHARE_OF_NOISE, SHARE_OF_SIZE",  # of a fit, and the defaults of `materiality`
        "SQUARES", "DEVIATION", "TINY",  # coefficients of a third difference
    },
    "estimation/measurement/outliers.py": {"NEXT"},  # so many that one outlier among them does not count
    "estimation/measurement/correlated_noise.py": {
        "KINDS",  # columns of a pose
        "NEIGHBOURS",  # all that a trajectory holds
    },
    "estimation/measurement/correlation.py": {
        "TIMES", "POWERS",  # a grid, as fine as can be distinguished
        "WHITE",  # of a second difference
        "FORGOTTEN",  # exp(-8)
    },
    "estimation/measurement/deviation.py": {"NORMAL_MAD", "TRIM, TRIMMED"},  # of a normal distribution, and its cut
    "estimation/measurement/sensor_noise.py": {"WINDOW"},  # frames of a third difference
    "estimation/measurement/tracking_error.py": {
        "SPANS",  # all that a trajectory holds
        "SURE",  # the default of `noise.sure`
        "UNREAD",  # rounding
        "KINDS",  # columns of a pose
    },
    "estimation/measurement/unexplained.py": {"KINDS"},  # units
    "estimation/prediction/coordinates.py": {
        "SMALLEST", "FARTHEST",  # keep a logarithm and its exponential finite
        "FIRST_GUESS",  # no part of a diagnosis, whose effects begin at their null values
    },
    "estimation/prediction/segments.py": {"CLASSES"},  # how many are simulated together, for speed
}  # fmt: skip


def literals(tree: ast.AST) -> Iterator[ast.Constant]:
    """List the numbers below a node, but for indices, settings, and what is written into texts."""
    if isinstance(tree, ast.Call) and ast.unparse(tree.func) == "setting":
        return
    for child in ast.iter_child_nodes(tree):
        if isinstance(child, ast.Constant) and type(child.value) in (int, float):
            yield child
        elif not isinstance(child, ast.JoinedStr) and not (isinstance(tree, ast.Subscript) and child is tree.slice):
            yield from literals(child)


@pytest.mark.parametrize("name", NAMES)
def test_no_number_decides_outside_the_settings(name: str) -> None:
    for number in literals(ast.parse((ROOT / name).read_text())):
        value = number.value
        assert isinstance(value, int | float)
        fine = value in TRIVIAL | LISTED.get(name, set()) or value <= TINY or value >= HUGE
        assert fine, f"{name}:{number.lineno}: {value} decides something: make it a setting"


@pytest.mark.parametrize("name", NAMES)
def test_no_module_has_a_number_of_its_own(name: str) -> None:
    for statement in ast.parse((ROOT / name).read_text()).body:
        if isinstance(statement, ast.Assign | ast.AnnAssign) and statement.value is not None:
            named = ast.unparse(statement).partition("=")[0].partition(":")[0].strip()
            pure = not any(isinstance(node, ast.Call) for node in ast.walk(statement.value))
            assert not (pure and list(literals(statement))) or named in CONSTANTS.get(name, set()), f"{name}: {named}"


def test_every_setting_is_read_and_says_its_unit_meaning_and_origin() -> None:
    shown = (path for room in ("document", "report", "settings") for path in (ROOT / "diagnosis" / room).glob("*.py"))
    source = "".join(path.read_text() for path in (*FILES, *shown))
    read = {node.attr for node in ast.walk(ast.parse(source.replace("from __future__ import annotations", "")))
            if isinstance(node, ast.Attribute)}  # fmt: skip
    for row in Settings().table():
        assert row.meaning, row.key
        assert row.calibrated, row.key
        assert row.key.rpartition(".")[2] in read, f"{row.key} is read nowhere"


def test_a_table_read_back_is_the_settings() -> None:
    words = [f"{row.key}={row.value}" for row in Settings().table()]
    again = Settings().changed(parse_changes(words)).to_mapping()
    assert json.loads(json.dumps(again, allow_nan=False)) == again
    assert again["evidence"] == Settings().to_mapping()["evidence"]
    assert again["segments"]["impacts"]["lead"] == pytest.approx(20 / 240, rel=1e-5)


def test_a_change_reaches_what_is_used_and_leaves_the_rest() -> None:
    changed = Settings().changed({"segments.impacts.lead": 0.1, "lack_of_fit.margin": 2})
    assert changed.segments.impacts.lead == 0.1
    assert changed.lack_of_fit.margin == 2.0
    assert changed.evidence == Settings().evidence
    with pytest.raises(ValidationError, match="frozen"):
        changed.lack_of_fit.margin = 3.0


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("lack_of_fit.margn=2", r'unknown key "lack_of_fit.margn"; did you mean "lack_of_fit.margin"\?'),
        ("margin=2", r'unknown key "margin"; known are lack_of_fit.margin'),
        ("nothing.alike_at_all=2", r"known are roles\.\*, .*"),
        ("lack_of_fit.margin=much", r"lack_of_fit.margin: expected a valid number, .*got 'much'"),
        (
            "lack_of_fit.margin=0.5",
            r"lack_of_fit.margin: expected greater than or equal to 1, got 0.5 \(factor by which .*\)",
        ),
        ("lack_of_fit.margin=.inf", r"lack_of_fit.margin: expected a finite number, got inf"),
        ("score_test.steady=perhaps", r"score_test.steady: expected a valid boolean, .*got 'perhaps'"),
        ("hypothesis.strides=1", r"hypothesis.strides: expected a valid tuple, got 1"),
        ("lack_of_fit.margin=", r"expected key=value, got 'lack_of_fit.margin='"),
        ("lack_of_fit.margin=[1", r"lack_of_fit.margin: expected a value in YAML, got '\[1'"),
    ],
)
def test_a_wrong_change_is_said_in_one_line_before_anything_is_read(
    word: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(ValueError, match=said) as raised:
        Settings().changed(parse_changes([word]))
    assert "\n" not in str(raised.value)
    assert main(["diagnose", str(tmp_path / "none"), word]) == 2
    assert capsys.readouterr().err.strip().endswith(str(raised.value))


def test_the_command_lists_all_settings(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["diagnose", "--settings"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 2 * len(Settings().table())
    assert "lack_of_fit.margin=1.25" in lines
    assert "materiality.tolerance=null m" in lines
