"""What a better model would have to add: the law of a hidden effect that no catalogue has, and its size."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import torch

from diagnosis.sets import Vortex, recorded_with
from physid.benchmark.sealing.outside import CameraSway, Keystone
from physid.data import RecordingSet
from physid.diagnosis.document.residual_law import ResidualLaw
from physid.diagnosis.document.residual_sentences import residual_sentences
from physid.diagnosis.inputs import load_observations
from physid.diagnosis.inputs.model_source import read_nominal_model
from physid.diagnosis.reference.nominal_fit import fit_nominal_model
from physid.diagnosis.residual_law import ResidualLaws, find_residual_laws
from physid.diagnosis.residual_law.laws import hats
from physid.diagnosis.testing import conclude, find_lack_of_fit
from physid.effects import find
from physid.physics import Effect

STRENGTH = 0.8  # [N s/m]
SWAY = 0.003  # [m]


def laws_beyond(folder: Path, *hidden: Effect) -> ResidualLaws:
    """Describe what recordings with hidden effects leave of a model that knows a turned camera alone."""
    observations = load_observations(RecordingSet(recorded_with(folder, hidden)))
    generator = torch.Generator().manual_seed(0)
    fitted = fit_nominal_model(
        observations, read_nominal_model(observations.scene, None), [find("camera_yaw")], generator
    )
    nominal = conclude(fitted.experiment, fitted.fit, (), fitted.settings)
    return find_residual_laws(fitted, nominal, find_lack_of_fit(fitted, nominal, generator))


@pytest.fixture(scope="module")
def across(tmp_path_factory: pytest.TempPathFactory) -> ResidualLaws:
    hidden = Vortex(strength=torch.tensor([STRENGTH], dtype=torch.float64))
    return laws_beyond(tmp_path_factory.mktemp("laws") / "across", hidden)


@pytest.mark.slow
def test_a_force_across_the_velocity_is_found_with_its_law(across: ResidualLaws) -> None:
    """It is c v to the left of the motion: linear in the speed, through zero."""
    law = across.described[0]
    assert (law.kind, law.direction, law.variable, law.unit) == ("force", "across the velocity", "speed", "N")
    assert law.explains > 0.9
    assert len(law.at) > 2
    for speed, low, high in zip(law.at, law.low, law.high, strict=True):
        assert low < STRENGTH * speed < high
    assert law.size[-1] == pytest.approx(STRENGTH * law.at[-1], rel=0.25)
    assert "(to its left) that grows with the speed" in residual_sentences([law])[0]


def test_its_site_is_the_dynamics(across: ResidualLaws) -> None:
    assert max(across.gains, key=lambda site: across.gains[site]) == "dynamics"


@pytest.mark.slow
def test_a_picture_that_sways_is_found_as_a_shift_over_time(tmp_path: Path) -> None:
    """Initial states follow a steady shift and a drift; what is left of 3 mm sin(2 pi t / 0.4 s) is less than 3 mm."""
    found = laws_beyond(tmp_path / "sway", CameraSway(sway=torch.tensor([SWAY], dtype=torch.float64)))
    law = found.described[0]
    assert (law.kind, law.direction, law.variable) == ("shift", "along x", "time")
    assert law.explains > 0.9
    assert 0.3 * SWAY < law.moves < SWAY
    assert max(found.gains, key=lambda site: found.gains[site]) == "perception"


@pytest.mark.slow
def test_a_camera_that_does_not_look_straight_down_is_found_as_a_stretch_that_changes_with_a_place(
    tmp_path: Path,
) -> None:
    """(x, y)' = (1 + k x) (x, y) moves pictures away from the origin by k x for each metre from there."""
    found = laws_beyond(tmp_path / "keystone", Keystone(slope=torch.tensor([0.15], dtype=torch.float64)))
    law = found.described[0]
    assert (law.kind, law.direction, law.variable) == ("shift", "away from the origin", "x")
    assert law.explains > 0.9
    assert max(found.gains, key=lambda site: found.gains[site]) == "perception"


@pytest.mark.slow
def test_without_a_gap_there_is_no_law(tmp_path: Path) -> None:
    assert laws_beyond(tmp_path / "free") == ResidualLaws()


def test_hats_interpolate_between_knots_and_go_on_straight_beyond_for_as_far_again() -> None:
    knots = torch.tensor([0.0, 1.0, 4.0], dtype=torch.float64)
    value = torch.tensor([-1.0, 0.0, 0.25, 1.0, 2.5, 4.0, 7.0], dtype=torch.float64)
    table = hats(value, knots)
    assert torch.allclose(table.sum(-1), torch.ones(7, dtype=torch.float64))
    heights = torch.tensor([2.0, 4.0, 1.0], dtype=torch.float64)
    assert (table @ heights).tolist() == pytest.approx([0.0, 2.0, 2.5, 4.0, 2.5, 1.0, -2.0])
    ends = torch.tensor([-4.0, -1e6, 8.0, 1e6], dtype=torch.float64)
    assert (hats(ends, knots) @ heights).tolist() == pytest.approx([-6.0, -6.0, -3.0, -3.0])


def law(**changes: Any) -> ResidualLaw:
    known: dict[str, Any] = {
        "kind": "force",
        "direction": "across the velocity",
        "variable": "speed",
        "variable_unit": "m/s",
        "region": "everywhere",
        "at": (0.0, 0.5, 1.0),
        "size": (0.0, 0.2, 0.41),
        "low": (-0.01, 0.18, 0.37),
        "high": (0.01, 0.22, 0.45),
        "unit": "N",
        "moves": 0.0018,
        "explains": 0.83,
        "gain": 1000.0,
    }
    return ResidualLaw(**known | changes)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({}, "a force across the velocity (to its left) that grows with the speed, 0.410 (0.370 to 0.450) N at 1 m/s"),
        (
            {"size": (0.0, -0.2, -0.41), "low": (-0.01, -0.22, -0.45), "high": (0.01, -0.18, -0.37)},
            "to its right) that grows with the speed, 0.410 (0.370 to 0.450) N at 1 m/s",
        ),
        (
            {"direction": "along the velocity", "size": (-0.4, -0.2, -0.1), "low": (-0.5,) * 3, "high": (-0.1,) * 3},
            "a force against the velocity that falls with the speed, 0.40 (0.10 to 0.50) N at 0 m/s",
        ),
        ({"size": (-0.4, 0.0, 0.2), "low": (-0.5, -0.1, 0.1), "high": (-0.3, 0.1, 0.3)}, "that changes with the speed"),
        ({"size": (0.3, 0.5, 0.3), "region": "in contact"}, "in contact that changes with the speed"),
        (
            {"at": (0.0,), "size": (0.4,), "low": (0.3,), "high": (0.5,), "variable": None, "direction": "along x"},
            "a force along x, 0.40 (0.30 to 0.50) N;",
        ),
        (
            {"kind": "shift", "direction": "along x", "variable": "time", "unit": "m"},
            "a shift of the picture along x that changes with the time, by 1.8 mm; it explains 83 %",
        ),
        (
            {"kind": "shift", "direction": "away from the origin", "variable": None, "unit": "m"},
            "a shift of the picture away from the origin, by 1.8 mm; it explains 83 %",
        ),
        (
            {"low": (-0.5,) * 3, "high": (0.5,) * 3},
            "across the velocity that changes with the speed, of no sure size; it",
        ),
        ({"variable": "x", "variable_unit": "m"}, "that grows with x, 0.410 (0.370 to 0.450) N at x = 1 m"),
    ],
)
def test_a_law_is_said_in_one_sentence(changes: dict[str, Any], said: str) -> None:
    (sentence,) = residual_sentences([law(**changes)])
    assert said in sentence
    assert sentence.startswith("What is missing acts like a ")


def test_a_second_law_is_said_with_what_both_explain() -> None:
    second = residual_sentences([law(), law(direction="along x", explains=0.91)])[1]
    assert second.startswith("A force along x")
    assert second.endswith("beside it: 91 % together.")
