"""A parameter that is given and wrong is named where another value of it explains the recordings, and no other is."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch

from diagnosis.flown import observed, random
from estimation.flights import FORCE, TOSS, flights
from physid.data import RecordingSet
from physid.data.generation.generate import generate
from physid.data.generation.settings import GenerateConfig, Noise
from physid.diagnosis.analysis import analyse
from physid.diagnosis.inputs import Inputs, read_inputs
from physid.diagnosis.progress import Stage, silent
from physid.diagnosis.reference.nominal_fit import NominalFit, fit_nominal_model
from physid.diagnosis.selection.given_parameters import findings_of_given, given_that_explain, showing
from physid.diagnosis.selection.materiality import tolerance_of
from physid.diagnosis.settings.settings import Settings
from physid.effects import find
from physid.estimation.prediction import CutRule, NominalModel, Segmentation
from physid.inspection.rules.fitted import given_parameter
from physid.scenes import find_setup, given_in, with_parameters

MASS, FRICTION = 2.0, 0.2
SETTINGS = Settings().changed({"null_simulations.floor_replays": 1})


def named(folder: Path, given: dict[str, float], drag: float = 0.0) -> tuple[dict[str, float], list[str]]:
    """Return which given parameters explain pushes of a block, and which were tried."""
    config = GenerateConfig(
        "push", simulator="closed_form", protocol="straight", frame_rate=60.0, trajectories=6, steps=75, seed=4,
        video=False, unknown=("block.mass",), true_values={"block.mass": MASS, "block.friction": FRICTION},
        noise=Noise(position=5e-4, rotation=3e-3), effects={"viscous_drag": {"coefficient": drag}} if drag else {},
    )  # fmt: skip
    generate(config, folder, quiet=True)
    inputs = read_inputs(RecordingSet(folder), None, None, [], None, SETTINGS)
    inputs = replace(inputs, model=replace(inputs.model, scene=with_parameters(inputs.model.scene, given)))
    generator = torch.Generator().manual_seed(0)
    nominal_fit = fit_nominal_model(inputs.observations, inputs.model, (), generator, settings=SETTINGS)
    tried: list[str] = []

    def say(stage: Stage, what: str = "") -> None:
        tried.append(what)

    return given_that_explain(inputs, nominal_fit, 0, say), tried


@pytest.mark.slow
def test_a_friction_that_is_given_and_wrong_is_named_with_its_value(tmp_path: Path) -> None:
    found, tried = named(tmp_path / "set", {"block.friction": 1.6 * FRICTION})
    assert found == {"block.friction": pytest.approx(FRICTION, rel=0.01)}
    assert tried == ["block.friction"]  # nothing bounces, and the mass is unknown anyway


@pytest.mark.slow
def test_of_a_friction_that_is_given_as_none_as_well(tmp_path: Path) -> None:
    found, _ = named(tmp_path / "set", {"block.friction": 0.0})
    assert found == {"block.friction": pytest.approx(FRICTION, rel=0.01)}


@pytest.mark.slow
def test_a_right_one_is_not_even_tried_and_what_another_effect_does_names_none(tmp_path: Path) -> None:
    assert named(tmp_path / "right", {"block.friction": FRICTION}) == ({}, [])
    assert named(tmp_path / "drag", {"block.friction": FRICTION}, drag=2.0) == ({}, ["block.friction"])


@pytest.mark.parametrize(
    ("unknown", "names"),
    [
        ((), ["block.mass", "block.friction", "block.restitution", "other.mass"]),
        (("block.mass",), ["block.friction", "block.restitution", "other.mass"]),
        (("block.friction",), ["block.mass", "block.restitution", "other.mass"]),
    ],
)
def test_of_bodies_of_one_material_each_value_is_tried_once(unknown: tuple[str, ...], names: list[str]) -> None:
    scene = replace(find_setup("collide").scene, unknown=unknown)
    segments = Segmentation.around(torch.ones(1, 20).bool(), CutRule())
    fit: Any = SimpleNamespace(
        observations=SimpleNamespace(timeline=SimpleNamespace(grid=SimpleNamespace(wrench=torch.zeros(1, 5, 2, 6)))),
        experiment=SimpleNamespace(predictor=SimpleNamespace(segments=segments)),
    )
    assert list(showing(scene, fit)) == names
    assert list(given_in(scene)) == names


def test_it_is_said_with_both_values_and_what_to_do() -> None:
    said = given_parameter("block.friction", 0.24, 0.12003, 1.2e-4)
    assert said.what == (
        "with block.friction 0.12 instead of the 0.24 that is given, the model leaves positions by 0.12 mm at most "
        "beyond noise"
    )
    assert said.mend.startswith("learn it (unknown in recording.yaml, or model.learn) unless it was measured")
    assert not said.wrong


PUSH = (3.0, -2.0, 1.0, 2.5, -1.5)


def pushed(given: float, sizes: tuple[float, ...] = (0.0, 0.0)) -> tuple[Inputs, NominalFit]:
    """Return flights under known forces of a body whose mass is given."""
    made = flights(trajectories=len(PUSH), cuts=1, push=PUSH, sizes=sizes)
    scene = with_parameters(made.experiment.predictor.model.scene, {"block.mass": given * TOSS.bodies[0].mass})
    inputs = Inputs(observed(made, ("fit",) * 4 + ("same",)), NominalModel(scene), (find("constant_force"),))
    return inputs, fit_nominal_model(inputs.observations, inputs.model, (), random(), settings=SETTINGS)


@pytest.mark.slow
def test_a_mass_that_is_given_and_wrong_is_named_with_its_value_and_no_parameter_that_cannot_show() -> None:
    inputs, nominal_fit = pushed(1.3)
    said: list[str] = []
    found = given_that_explain(inputs, nominal_fit, 0, lambda stage, what="": said.append(what))
    assert found == {"block.mass": pytest.approx(TOSS.bodies[0].mass, rel=0.02)}
    assert said == ["block.mass", "block.friction"]
    (one,) = findings_of_given(inputs, nominal_fit, 0, silent)
    assert one == given_parameter(
        "block.mass", 1.3 * TOSS.bodies[0].mass, found["block.mass"], tolerance_of(nominal_fit).position
    )


@pytest.mark.slow
def test_one_that_explains_no_wind_is_not_named() -> None:
    assert given_that_explain(*pushed(1.0, FORCE), 0, silent) == {}


@pytest.mark.parametrize("wrong", [True, False])
@pytest.mark.slow
def test_what_is_given_is_doubted_where_there_is_a_gap_and_only_there(wrong: bool, tmp_path: Path) -> None:
    said: list[Stage] = []
    inputs, _ = pushed(1.3 if wrong else 1.0)
    found = analyse(inputs, tmp_path, 0, SETTINGS, lambda stage, what="": said.append(stage))
    assert (found.diagnosis.verdict != "none") is wrong
    assert (Stage.FREEING in said) is wrong
