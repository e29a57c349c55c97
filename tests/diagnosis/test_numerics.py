"""A reference simulator that stands alone, far off the model and off all others, makes no null simulations."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from diagnosis.sets import recorded
from physid.data import RecordingSet
from physid.diagnosis.conclusion import next_experiment as proposals
from physid.diagnosis.diagnose import diagnose
from physid.diagnosis.inputs.model_source import read_nominal_model
from physid.diagnosis.inputs.observations import load_observations
from physid.diagnosis.reference.nominal_fit import NominalFit, fit_nominal_model
from physid.diagnosis.settings.settings import Settings
from physid.scenes import find_setup

pytest.importorskip("mujoco")
SOME = {"trajectories": 4, "steps": 45, "simulator": "mujoco", "frame_rate": 60.0, "split": {"fit": 1}}
DEFAULT = Settings()


@pytest.fixture(scope="module")
def pushed_off_centre(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded(tmp_path_factory.mktemp("off") / "set", {}, protocol="off_centre", **SOME)


def fitted(made: Path, settings: Settings = DEFAULT) -> NominalFit:
    observations = load_observations(RecordingSet(made))
    model = read_nominal_model(observations.scene, None)
    return fit_nominal_model(observations, model, [], torch.Generator().manual_seed(0), settings=settings)


@pytest.mark.slow
def test_references_that_agree_with_the_model_or_with_each_other_all_count(tmp_path: Path) -> None:
    made = recorded(tmp_path / "set", {}, protocol="straight", **SOME)
    assert fitted(made).references == ("pybullet", "mujoco")


@pytest.mark.slow
def test_pybullet_does_not_count_where_pushes_off_the_centre_turn_a_block(pushed_off_centre: Path) -> None:
    """The pyramid of its friction lets a block that a push turns go centimetres off (docs/simulators.md)."""
    assert fitted(pushed_off_centre).references == ("mujoco",)


@pytest.mark.slow
@pytest.mark.parametrize("change", [{"replay.far": 1e4}, {"replay.farther": 1e6}], ids=str)
def test_a_reference_that_is_not_as_far_off_as_is_asked_stays(
    pushed_off_centre: Path, change: dict[str, float]
) -> None:
    assert fitted(pushed_off_centre, DEFAULT.changed(change)).references == ("pybullet", "mujoco")


@pytest.mark.slow
def test_the_only_reference_stays_however_far_off_it_is(pushed_off_centre: Path) -> None:
    alone = DEFAULT.changed({"replay.simulators": ("pybullet",)})
    assert fitted(pushed_off_centre, alone).references == ("pybullet",)


@pytest.mark.slow
@pytest.mark.parametrize("drag", [0.0, 1.2])
def test_pushes_off_the_centre_hide_no_gap_and_make_none(tmp_path: Path, drag: float) -> None:
    more = SOME | {"trajectories": 9, "steps": 60, "split": {"fit": 5, "report_same": 1}}
    effects = {"viscous_drag": {"coefficient": drag}} if drag else {}
    made = recorded(tmp_path / "set", effects, protocol="off_centre", protocol_of_split={}, **more)
    found = diagnose(RecordingSet(made), tmp_path / "out")
    assert found.references == ("mujoco",)
    assert found.verdict == "none" if not drag else "viscous_drag" in found.group


@pytest.mark.slow
def test_torques_are_proposed_to_whoever_recorded_some(
    pushed_off_centre: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whoever pushed at the centre of mass may have no way to push elsewhere, however much it would say."""
    monkeypatch.setattr(proposals, "_planned", lambda drawn, *_: sum(abs(one.wrench[..., :3]).sum() for one in drawn))
    central = recorded(tmp_path / "set", {}, protocol="straight", **SOME)
    for made, torques in ((pushed_off_centre, True), (central, False)):
        found = fitted(made, DEFAULT.changed({"replay.simulators": ("mujoco",)}))
        best = proposals._best_protocol(find_setup("push"), found, found, found)  # type: ignore[arg-type]
        assert best is not None
        assert (best[1] == "off_centre") == torques
