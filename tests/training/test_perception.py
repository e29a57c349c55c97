"""Perception effects in a fit: what the camera gets wrong is predicted, not taken for physics."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch

from physid.cli import main
from physid.data import RecordingSet
from physid.data.generation.generate import generate
from physid.data.generation.settings import GenerateConfig, Noise
from physid.physics import PhysicsLayer, World
from physid.training.learners.engine import Engine
from physid.training.learners.self_supervised import SelfSupervisedID
from physid.training.parameters.trajectories import Trajectories

FRICTION = 0.12
CONFIG = Path(__file__).parents[2] / "configs" / "sysid" / "push_friction.yaml"
NOISE = 1e-4  # [m]
FOUND = 0.005
BIASED = 0.02
EFFECTS = {
    "length_scale": {"change": 0.06},
    "camera_offset": {"x": 0.05, "y": -0.02, "z": 0.03},
    "observation_latency": {"latency": 0.02},
}


def fitted(recordings: Path, run: Path, effects: dict[str, dict[str, float]]) -> dict[str, float]:
    words = [f"model.engine.effects={json.dumps(effects)}", f"data.folder={recordings}", "trainer.max_epochs=12"]
    assert main(["fit", "--config", str(CONFIG), "--run-dir", str(run), "wandb=disabled", *words]) == 0
    figures: dict[str, float] = json.loads((run / "metrics.json").read_text())
    return figures


@pytest.fixture(scope="module", params=EFFECTS)
def seen(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Path]:
    folder = tmp_path_factory.mktemp("seen") / request.param
    config = GenerateConfig(
        "push", protocol="rich", trajectories=5, steps=80, video=False, unknown=("block.friction",), guess_factor=1.2,
        split={"train": 4, "test": 1}, effects={request.param: EFFECTS[request.param]}, noise=Noise(NOISE, 10 * NOISE),
    )  # fmt: skip
    generate(config, folder, 1, quiet=True)
    return request.param, folder


@pytest.mark.slow
def test_a_known_perception_effect_does_not_bias_the_fit_and_is_part_of_what_is_predicted(
    seen: tuple[str, Path], tmp_path: Path
) -> None:
    name, folder = seen
    told = fitted(folder, tmp_path / "with", {name: EFFECTS[name]})
    untold = fitted(folder, tmp_path / "without", {})
    assert told["params/block.friction/estimate"] == pytest.approx(FRICTION, rel=FOUND)
    assert told["test/position_error"] < untold["test/position_error"]
    if name == "length_scale":
        assert abs(untold["params/block.friction/estimate"] / FRICTION - 1) > BIASED
    assert main(["predict", "--run-dir", str(tmp_path / "with"), "--out", str(tmp_path / "foreseen")]) == 0
    for predicted, recorded in zip(RecordingSet(tmp_path / "foreseen"), RecordingSet(folder), strict=True):
        assert predicted.pose is not None
        assert recorded.pose is not None
        assert np.abs(predicted.pose[..., :3] - recorded.pose[..., :3]).max() < 30 * NOISE


def test_without_effects_what_the_camera_reports_is_the_state_itself() -> None:
    layer = PhysicsLayer(World(time_step=1 / 240))
    pose = torch.randn(2, 3, 1, 7, dtype=torch.float64)
    assert not layer.distorts
    assert layer.observe(pose) is pose


def test_recorded_initial_states_are_refused_where_the_camera_does_not_report_true_ones() -> None:
    from tests.training.pushed import SCENE, push_batch

    layer = Engine(effects={"camera_offset": {"z": 0.1}}).layer(SCENE)
    known = Trajectories.of(push_batch(), SCENE.time_step)
    with pytest.raises(ValueError, match="perception effect is at work, got recorded ones"):
        known.rolled(layer, None)  # type: ignore[arg-type]


def test_models_that_draw_what_they_see_refuse_perception_effects() -> None:
    from physid.scenes.setups.push import SCENE

    module = SelfSupervisedID(learn=["block.friction"], engine=Engine(effects={"camera_offset": {"z": 0.1}}))
    with pytest.raises(ValueError, match="physid track"):
        module.attach(SCENE)
