"""What is missing, written as an effect, acts as the residual law does; tried, it closes the gap."""

from __future__ import annotations

import ast
import shlex
import warnings
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from torch import Tensor

from physid.cli import main
from physid.diagnosis.document.effect_file import REGIONS, effect_file
from physid.diagnosis.document.residual_law import ResidualLaw
from physid.diagnosis.residual_law.laws import hats
from physid.diagnosis.residual_law.motion import Direction, Variable, directions_of, variables_of
from physid.effects.loading import own_effects
from physid.effects.motion import course, course_from_body, from_origin, unit
from physid.effects.probe import Probe, draw_probe
from physid.effects.touch import touching
from physid.estimation.prediction import Prediction
from physid.physics import Effect, Parameters, PhysicsLayer, State, World
from physid.physics.rotations import exponential, to_matrix

STILL = 0.1
AT, SIZE = (-0.6, 0.2, 1.4), (0.7, -0.4, 1.1)
GROUND = to_matrix(exponential(torch.tensor([0.2, -0.1, 0.3], dtype=torch.float64)))
PROBE = draw_probe()
SEEN = ("x", "y", "height", "time")
"""Variables that a camera has."""


def law(kind: Any, direction: str, variable: str | None, region: Any = "everywhere") -> ResidualLaw:
    """Return a law with sizes of both signs."""
    count = 1 if variable is None else len(AT)
    size = SIZE[:count]
    low, high = tuple(one - 0.1 for one in size), tuple(one + 0.1 for one in size)
    unit = variable and "m"
    return ResidualLaw(kind, direction, variable, unit, region, AT[:count], size, low, high, "N", 0.001, 0.9, 20.0)


def written(folder: Path, laws: list[ResidualLaw]) -> list[Effect]:
    """Write laws, and load them with what was measured at work."""
    place = folder / "missing_effects.py"
    text = effect_file(laws, GROUND, STILL, str(place))
    assert text is not None
    place.write_text(text)
    names = [line.split()[1].partition("(")[0] for line in text.splitlines() if line.startswith("class ")]
    assert f"--effects {place} --out " in text
    one, kinds = torch.tensor([1.0], dtype=torch.float64), own_effects([str(place)])
    assert [kind.__name__ for kind in kinds] == names
    return [kind().replace(scale=one) for kind in kinds]


def in_motion(probe: Probe) -> tuple[dict[tuple[str, str], Direction], dict[str | None, Variable]]:
    """Return directions and variables of a probe, whose worlds are trajectories that stand still until its time."""
    twice = [each[None, :, None].expand(-1, -1, 2, -1, -1) for each in (probe.state.pose, probe.state.twist)]
    time = torch.stack([torch.zeros_like(probe.inputs.time), probe.inputs.time], 1)
    line: Any = SimpleNamespace(time=time, wrench=probe.inputs.wrench[:, None].expand(-1, 2, -1, -1))
    prediction = Prediction(twice[0], twice[0], twice[1], twice[1][..., 0])
    directions = directions_of(prediction, line, GROUND, False, STILL)
    variables = variables_of(prediction, line, GROUND, False, STILL)
    return {(one.kind, one.name): one for one in directions}, {one.name: one for one in variables}


def said(one: ResidualLaw) -> Tensor:
    """Return what a law says of the probe, shape (B, N, 6)."""
    directions, variables = in_motion(PROBE)
    size = torch.tensor(one.size, dtype=torch.float64)
    if one.variable is not None:
        variable = variables[one.variable]
        size = (hats(variable.value, torch.tensor(one.at, dtype=torch.float64)) @ size) * variable.defined
    touch = touching(PROBE.state, PROBE.inputs)
    shares = {"everywhere": torch.ones_like(touch), "in contact": touch, "in flight": 1 - touch}
    value = directions[one.kind, one.direction].value * size[..., None]
    return value[:, 1] * shares[one.region][..., None]


DIRECTIONS, VARIABLES = in_motion(PROBE)


@pytest.mark.parametrize(
    ("variable", "region"),
    [*((variable, "everywhere") for variable in (None, *VARIABLES)), *(("speed", region) for region in REGIONS)],
)
def test_what_is_missing_acts_as_the_law_says(tmp_path: Path, variable: str | None, region: str) -> None:
    laws = [law(kind, name, variable, region) for kind, name in DIRECTIONS if kind != "shift"]
    effects = written(tmp_path, laws)
    assert len(effects) == len(laws)
    for one, effect in zip(laws, effects, strict=True):
        change = effect.act(PROBE.state, PROBE.inputs).wrench - PROBE.inputs.wrench
        assert torch.allclose(change, said(one), atol=1e-9), (one.direction, effect.name)
        assert change.any()


@pytest.mark.parametrize("variable", [None, *VARIABLES])
def test_a_missing_shift_moves_what_the_camera_reports_where_that_shows_the_variable(
    tmp_path: Path, variable: str | None
) -> None:
    laws = [law(kind, name, variable) for kind, name in DIRECTIONS if kind == "shift"]
    if variable is not None and variable not in SEEN:
        assert effect_file(laws, GROUND, STILL, "missing_effects.py") is None
        return
    pose = PROBE.state.pose[:, None].expand(-1, 2, -1, -1)
    time = torch.stack([torch.zeros_like(PROBE.inputs.time), PROBE.inputs.time], 1)
    for one, effect in zip(laws, written(tmp_path, laws), strict=True):
        shown = effect.observe(pose, time)
        assert torch.allclose((shown - pose)[:, 1, :, :3], said(one)[..., 3:], atol=1e-9), one.direction
        assert torch.equal(shown[..., 3:], pose[..., 3:])
        assert effect.site == "perception"


def test_a_shift_that_changes_with_time_goes_on_in_a_piece_of_a_trajectory(tmp_path: Path) -> None:
    (effect,) = written(tmp_path, [law("shift", "along x", "time")])
    pose, time = PROBE.pose[:1], 0.5 * torch.arange(PROBE.pose.shape[1], dtype=torch.float64)[None]
    assert torch.equal(effect.observe(pose, time)[:, 3:], effect.observe(pose[:, 3:], time[:, 3:]))


def test_what_falls_straight_has_no_course(tmp_path: Path) -> None:
    (effect,) = written(tmp_path, [law("force", "along x", "course")])
    twist = torch.zeros_like(PROBE.state.twist)
    twist[..., 3:] = -2.0 * GROUND[2]
    assert torch.equal(effect.act(State(PROBE.state.pose, twist), PROBE.inputs).wrench, PROBE.inputs.wrench)


def test_a_diagnosis_does_not_run_the_file_that_it_replaces(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "missing_effects.py").write_text("")
    for words in (["--effects"], ["--allow"]):
        place = f"{tmp_path}/../{tmp_path.name}/missing_effects.py:MissingForce"
        assert main(["diagnose", str(tmp_path), *words, place, "--out", str(tmp_path)]) == 2
        assert "this diagnosis would replace it; name another folder" in capsys.readouterr().err


@pytest.mark.parametrize("variable", [None, *(name for name in VARIABLES if "course" not in str(name))])
def test_what_is_missing_is_compiled_into_the_step(tmp_path: Path, variable: str | None) -> None:
    for name in ("across the velocity",) if variable else ("along x", "along the velocity", "along the command"):
        effect = written(tmp_path, [law("force", name, variable, "in contact")])[0]
        state, inputs = PROBE.state, PROBE.inputs
        parameters = Parameters(inputs.size, inputs.mass, inputs.inertia, inputs.friction, inputs.restitution)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            rollout = PhysicsLayer(World(), (effect,)).rollout(state, PROBE.wrench, parameters)
        assert rollout.pose.isfinite().all()


def test_laws_of_one_kind_are_numbered_and_each_says_where_it_is_made(tmp_path: Path) -> None:
    laws = [
        law("force", "along x", "speed"),
        law("force", "along the command", None),
        law("force", "along the velocity", None, "in contact"),
        law("torque", "about the vertical", "commanded force"),
    ]
    effects = written(tmp_path, laws)
    assert [one.name for one in effects] == ["missing_force", "missing_force_2", "missing_force_3", "missing_torque"]
    assert [one.site for one in effects] == ["dynamics", "actuation", "contact", "actuation"]


def test_nothing_that_is_missing_is_no_file() -> None:
    assert effect_file([], GROUND, STILL, "missing_effects.py") is None


def test_the_file_says_of_each_law_where_it_acts_and_on_what_it_depends() -> None:
    laws = [law("force", "along x", "speed", "in contact"), law("force", "along y", None)]
    text = effect_file(laws, GROUND, STILL, "missing_effects.py")
    assert text is not None
    assert "F = s f(speed) along x in contact, f piecewise linear." in text
    assert "F = s f along y, f piecewise linear." in text
    assert ["# speed [m]" in line for line in text.splitlines() if " at: ClassVar" in line] == [True, False]
    assert text.count("# of nothing") == 1
    assert text.count("> STILL") == 0, "a force along an axis acts on bodies that lie still"


@pytest.mark.parametrize(
    "folder",
    ['a"""b', 'a"""\nprint("ran")\nx = """b', "a\\", 'a\\"""b', "a\rprint(1)", "a\u2028b", "$(touch x) 'y'", "a\udc80"],
)
def test_a_place_is_text_in_the_file_whatever_its_folder_is_called(folder: str) -> None:
    laws = [law("force", "along x", "speed")]
    plain, text = effect_file(laws, GROUND, STILL, "a/m.py"), effect_file(laws, GROUND, STILL, f"{folder}/m.py")
    assert plain is not None
    assert text is not None
    text.encode()
    assert len(text.splitlines()) == len(plain.splitlines())
    own, other = ast.parse(text), ast.parse(plain)
    assert [ast.dump(each) for each in own.body[1:]] == [ast.dump(each) for each in other.body[1:]]
    said = ast.get_docstring(own)
    assert said is not None
    if folder.isprintable():
        assert f"--effects {shlex.quote(f'{folder}/m.py')} --out" in said


def test_what_a_law_says_ends_neither_its_docstring_nor_its_comment() -> None:
    hostile = 'N"""\nimport os\n"""'
    one = replace(law("force", "along x", "speed"), unit=hostile, variable_unit=hostile)
    text, plain = (effect_file([each], GROUND, STILL, "m.py") for each in (one, law("force", "along x", "speed")))
    assert text is not None
    assert plain is not None
    assert len(ast.parse(text).body) == len(ast.parse(plain).body)
    assert "\nimport os" not in text


def test_directions_and_courses_have_their_closed_forms() -> None:
    up = torch.tensor([0.0, 0.6, 0.8], dtype=torch.float64)
    place = torch.tensor([1.0, 2.0, 3.0], dtype=torch.float64)
    expected = torch.tensor([1.0, -0.16, 0.12], dtype=torch.float64)
    assert torch.allclose(from_origin(place, up), expected, atol=1e-12)
    way = torch.tensor([[0.0, 3.0, 4.0], [0.03, 0.04, 0.0], [0.0, 0.0, 0.0]], dtype=torch.float64)
    assert torch.allclose(unit(way, 0.1), torch.tensor([[0.0, 0.6, 0.8], [0, 0, 0], [0, 0, 0]], dtype=torch.float64))
    still = torch.zeros(2, 3, dtype=torch.float64, requires_grad=True)
    unit(still).sum().backward()  # type: ignore[no-untyped-call]
    assert still.grad is not None
    assert still.grad.isfinite().all()
    flat, turned = torch.eye(3, dtype=torch.float64), torch.deg2rad(torch.tensor([170.0, -170.0], dtype=torch.float64))
    velocity = torch.stack([turned.cos(), turned.sin(), 0 * turned], -1)
    assert torch.allclose(course(velocity, flat), torch.tensor([170.0, -170.0], dtype=torch.float64))
    heading = exponential(torch.tensor([0.0, 0.0, float(turned[0])], dtype=torch.float64)).expand(2, 4)
    apart = course_from_body(heading, velocity, flat)
    assert torch.allclose(apart, torch.tensor([0.0, 20.0], dtype=torch.float64), atol=1e-9)
