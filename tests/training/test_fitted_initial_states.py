"""Initial states as unknowns: recovered where nothing disturbs, and no burden to the parameters where noise does."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from tests.training.pushed import SCENE, TRUE_FRICTION, push_batch

from physid.cli import main
from physid.data.batches.datamodule import RecordingsDataModule
from physid.data.generation.generate import generate
from physid.data.generation.settings import GenerateConfig, Noise
from physid.physics.rotations import angle_between, exponential, multiply
from physid.scenes import find_setup
from physid.scenes.lying import lay_down
from physid.training.initial_states.explaining import started
from physid.training.initial_states.fitted import fit_states
from physid.training.learners.sysid import SysID
from physid.training.parameters.identifiability import SensorNoise
from physid.training.parameters.pose_loss import PoseLoss
from physid.training.parameters.trajectories import Trajectories

CONFIG = Path(__file__).parents[2] / "configs" / "sysid" / "push_friction.yaml"
BOTH = "model.learn=[block.mass,block.friction]"
NOISE = Noise(position=1e-3, rotation=1e-2)
EXACT = 1e-6
BOUND = 3.0  # standard deviations, by the bound of Cramer and Rao


def without_twists(batch: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in batch.items() if name != "twist"}


def test_a_tilted_box_is_laid_flat_on_an_incline() -> None:
    scene = find_setup("slide").scene
    normal = torch.tensor(scene.ground.normal, dtype=torch.float64)
    level = exponential(torch.tensor([0.0, math.atan2(normal[0], normal[2]), 0.0], dtype=torch.float64))
    height = scene.sizes[0, 2]
    flat = torch.cat([(scene.ground.offset + height / 2) * normal, level])
    across = torch.linalg.cross(normal, torch.tensor([1.0, 2.0, 3.0], dtype=torch.float64))
    lean = 0.02 * across / across.norm()
    raised = torch.cat([flat[:3] + 0.01 * normal, multiply(exponential(lean), level)])
    laid = lay_down(raised[None], scene)
    assert float(laid.lean) == pytest.approx(0.02, abs=EXACT)
    assert float(laid.gap) == pytest.approx(0.01, abs=EXACT)
    assert torch.allclose(laid.pose[0, :3], flat[:3], atol=2e-5)  # as deep as a resting box
    assert float(angle_between(laid.pose[0, 3:], level)) < EXACT


@pytest.mark.parametrize("scene", ["push_rich", "toss"])
def test_initial_states_are_recovered_from_poses_alone(
    scene: str, recordings: Callable[[str], Path], tmp_path: Path
) -> None:
    data = RecordingsDataModule(recordings(scene), limit=3, shuffle=False)
    batch = next(iter(data.train_dataloader()))
    module = SysID(values={name: data.scene.value(name) / 2 for name in data.scene.unknown}).attach(data.scene)
    known, poses = module.trajectories(batch), module.trajectories(without_twists(batch))
    rollout = known.rolled(
        module.layer, module.physical()
    )  # the layer's own motion, so that nothing but the state is unknown
    own = type(poses)(rollout.pose, poses.twist, known.wrench, known.length, known.index)
    _, fit = fit_states(module._explaining(own))
    assert torch.allclose(fit.point.pose[0, ..., :3], known.pose[:, 0, :, :3], atol=1e-5)
    assert torch.allclose(fit.point.twist[0], known.twist[:, 0], atol=1e-3)


@pytest.mark.parametrize("afresh", [False, True])
def test_states_that_a_step_taken_back_has_spoiled_are_replaced_by_new_guesses(afresh: bool) -> None:
    module, batch = SysID().attach(SCENE), without_twists(push_batch(frames=60))
    explaining = module._explaining(module.trajectories(batch))
    _, fit = fit_states(explaining)
    spun = fit.point.twist[0].clone()
    spun[..., 2] += 40.0  # a block that spins feels less friction along its path: a valley of its own
    module.tracked.begin(explaining, (fit.point.pose[0], spun))
    found, _ = module.tracked.improve(explaining, afresh=afresh)
    assert bool((found.loss.sum() < 2 * fit.loss.sum()).item()) is afresh


def test_the_gradient_is_that_of_the_least_loss_over_the_initial_states() -> None:
    batch = without_twists(push_batch(frames=60))
    batch["pose"] = batch["pose"].clone()
    batch["pose"][..., :2] += 1e-3 * torch.randn(3, 60, 1, 2, generator=torch.Generator().manual_seed(0))
    module = SysID(values={"block.friction": 1.2 * TRUE_FRICTION}, loss=PoseLoss()).attach(SCENE)
    module.count_evaluations = lambda copies: None  # type: ignore[method-assign]

    def least(move: float) -> float:
        moved = SysID(values={"block.friction": 1.2 * TRUE_FRICTION * math.exp(move)}, loss=PoseLoss()).attach(SCENE)
        explaining = moved._explaining(moved.trajectories(batch))
        point, cut = fit_states(explaining)[1].point, explaining.trajectories
        with torch.no_grad():
            residual = started(cut, point.pose[0], point.twist[0]).residual(moved.layer, moved.physical())
            return float(torch.stack(list(PoseLoss()(residual, cut.real).values())).sum(0).mean())

    for _ in range(4):  # each call improves the initial states a little more
        loss = torch.stack([value.mean() for value in module.losses(batch).values()]).sum()
    (slope,) = torch.autograd.grad(loss, [module.physical.coordinates])
    assert float(loss.detach()) == pytest.approx(least(0.0), rel=1e-4)
    assert float(slope) == pytest.approx((least(1e-3) - least(-1e-3)) / 2e-3, rel=1e-2)


@pytest.mark.slow
def test_noise_moves_mass_and_friction_no_further_than_the_bound_allows(tmp_path: Path) -> None:
    both = ("block.mass", "block.friction")
    made = GenerateConfig("push", trajectories=12, steps=150, seed=1, video=False, noise=NOISE, unknown=both)
    generate(made, tmp_path / "data", quiet=True)
    errors = {}
    for start in ("fitted", "recorded"):
        folder = tmp_path / start
        words = [f"data.folder={tmp_path / 'data'}", BOTH, f"model.start={start}", f"--run-dir={folder}"]
        assert main(["fit", "--config", str(CONFIG), *words]) == 0
        figures = json.loads((folder / "metrics.json").read_text())
        errors[start] = [figures[f"params/{name}/relative_error"] for name in both]
    bound = [deviation(tmp_path / "data", name) for name in both]
    assert all(error < BOUND * one for error, one in zip(errors["fitted"], bound, strict=True)), (errors, bound)
    assert any(error > BOUND * one for error, one in zip(errors["recorded"], bound, strict=True)), (errors, bound)


@pytest.mark.slow
def test_poses_without_noise_do_not_let_the_headings_decide_in_which_engines_differ(tmp_path: Path) -> None:
    rich = CONFIG.parents[1] / "generate" / "push_rich.yaml"
    words = ["trajectories=12", "steps=150", "video=false", "noise.position=0.0001", "noise.rotation=0.0001", "--quiet"]
    assert main(["generate", "--config", str(rich), "--out", str(tmp_path / "data"), *words]) == 0
    assert (
        main(["fit", "--config", str(CONFIG), f"data.folder={tmp_path / 'data'}", f"--run-dir={tmp_path / 'run'}"]) == 0
    )
    figures = json.loads((tmp_path / "run" / "metrics.json").read_text())
    assert figures["params/block.friction/relative_error"] < 5e-3


def deviation(folder: Path, name: str) -> float:
    """Return the standard deviation that the trajectories allow, their initial states being unknown."""
    data = RecordingsDataModule(folder, shuffle=False)
    module = SysID(learn=["block.mass", "block.friction"]).attach(data.scene)
    module.physical.coordinates.data -= math.log(2)  # the first guess is twice the truth
    module.count_evaluations = lambda copies: None  # type: ignore[method-assign]
    module._batch = next(iter(data.train_dataloader()))
    return module.identifiability(SensorNoise(NOISE.position, NOISE.rotation)).deviations[name]


@pytest.mark.parametrize("noise", [Noise(1e-3, 1e-2), Noise(2e-4, 4e-3)])
def test_the_noise_of_poses_is_seen_in_their_third_differences(noise: Noise, tmp_path: Path) -> None:
    made = GenerateConfig("collide", trajectories=4, steps=200, video=False, noise=noise)
    generate(made, tmp_path, quiet=True)
    data = RecordingsDataModule(tmp_path, shuffle=False)
    found = Trajectories.of(next(iter(data.train_dataloader())), data.scene.time_step).noise
    assert found.position == pytest.approx(noise.position, rel=0.1)
    assert found.rotation == pytest.approx(noise.rotation, rel=0.1)


@pytest.mark.slow
def test_a_resumed_identification_with_fitted_initial_states_equals_one_in_one_go(
    recordings: Callable[[str], Path], tmp_path: Path
) -> None:
    common = ["--config", str(CONFIG), f"data.folder={recordings('push')}", "data.limit=2", "model.start=fitted"]
    common.append("trainer.callbacks=[]")
    for name, sessions in {"whole": [["trainer.max_epochs=3"]], "parts": [["trainer.max_epochs=1"], []]}.items():
        for number, words in enumerate(sessions):
            more = ["--resume"] if number else []
            end = words or ["trainer.max_epochs=3"]
            assert main(["fit", *common, *end, f"--run-dir={tmp_path / name}", *more]) == 0
    whole, parts = ((tmp_path / name / "parameters.csv").read_text() for name in ("whole", "parts"))
    assert whole == parts


def test_a_fit_that_has_ended_can_be_taken_up_and_stays_as_it_is(
    recordings: Callable[[str], Path], tmp_path: Path
) -> None:
    words = ["--config", str(CONFIG), f"data.folder={recordings('push')}", "data.limit=2", f"--run-dir={tmp_path}"]
    words += ["trainer.max_epochs=2", "trainer.callbacks=[]"]
    kept = ("metrics.csv", "parameters.csv", "posterior.json", "findings.json")
    assert main(["fit", *words]) == 0
    before = [(tmp_path / name).read_bytes() for name in kept]
    assert main(["fit", *words, "--resume"]) == 0
    assert [(tmp_path / name).read_bytes() for name in kept] == before
