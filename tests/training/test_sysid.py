"""Identification of known parameters, its errors, and exact resume."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import lightning as L
import pytest
import torch
from tests.training.pushed import SCENE, TRUE_FRICTION, push_batch
from torch.optim import LBFGS, Adam
from torch.utils.data import DataLoader

from physid.cli import main
from physid.physics import PhysicsLayer, SolverError
from physid.physics.contact_problem.lcp import SolverSettings
from physid.training.callbacks.intervals import left_to_go, steps_shrink
from physid.training.learners.engine import Engine
from physid.training.learners.sysid import SysID
from physid.training.parameters.gauss_newton import GaussNewton
from physid.training.parameters.trajectories import Trajectories
from physid.training.runs import baselines
from physid.training.training_module import NonFiniteLossError, OptimizerFactory

FOUND = 1e-3
SMOOTHED = 1e-6  # contacts act a little across a gap
CONFIG = Path(__file__).parents[2] / "configs" / "sysid" / "push_friction.yaml"


class OneBatch(L.LightningDataModule):
    """One batch of a known scene."""

    def __init__(self, batch: dict[str, Any]) -> None:
        super().__init__()
        self.scene, self.batch = SCENE, batch

    def train_dataloader(self) -> DataLoader[Any]:
        return DataLoader([self.batch], batch_size=None)

    test_dataloader = train_dataloader


def trainer(folder: Path, epochs: int) -> L.Trainer:
    quiet = {"logger": False, "enable_progress_bar": False, "enable_model_summary": False}
    return L.Trainer(max_epochs=epochs, accelerator="cpu", default_root_dir=folder, enable_checkpointing=False, **quiet)


@pytest.mark.filterwarnings("ignore::lightning.fabric.utilities.warnings.PossibleUserWarning")
@pytest.mark.filterwarnings("ignore:.isinstance.treespec")  # Lightning's own use of torch
@pytest.mark.parametrize(
    ("optimizer", "epochs"),
    [
        (GaussNewton, 6),
        (partial(LBFGS, line_search_fn="strong_wolfe"), 2),
        (partial(Adam, lr=0.1, betas=(0.5, 0.9)), 80),
    ],
    ids=["Gauss-Newton", "L-BFGS", "Adam"],
)
def test_every_optimizer_finds_the_friction(optimizer: OptimizerFactory, epochs: int, tmp_path: Path) -> None:
    module = SysID(values={"block.friction": 2 * TRUE_FRICTION}, optimizer=optimizer)
    run = trainer(tmp_path, epochs)
    run.fit(module, OneBatch(push_batch()))
    assert module.physical.estimates()["block.friction"] == pytest.approx(TRUE_FRICTION, rel=FOUND)
    assert float(run.callback_metrics["train/position_error"]) < FOUND
    with (tmp_path / "parameters.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == epochs + 1
    assert float(rows[0]["block.friction"]) == pytest.approx(2 * TRUE_FRICTION)
    assert float(rows[-1]["evaluations"]) == float(module.evaluations)


@pytest.mark.filterwarnings("ignore::lightning.fabric.utilities.warnings.PossibleUserWarning")
@pytest.mark.filterwarnings("ignore:.isinstance.treespec")
def test_an_estimate_that_the_trajectories_does_not_identify_comes_with_a_warning(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    resting = push_batch() | {"wrench": torch.zeros(3, 25, 1, 6, dtype=torch.float64)}
    trainer(tmp_path, 1).fit(SysID(), OneBatch(resting))
    assert "block.friction: not at all" in caplog.text
    caplog.clear()
    trainer(tmp_path, 1).fit(SysID(), OneBatch(push_batch(frames=60)))
    assert "not at all" not in caplog.text


@pytest.mark.filterwarnings("ignore::lightning.fabric.utilities.warnings.PossibleUserWarning")
@pytest.mark.filterwarnings("ignore:.isinstance.treespec")
@pytest.mark.parametrize(
    ("optimizer", "epochs", "warned"), [(partial(Adam, lr=0.02), 8, True), (GaussNewton, 6, False)]
)
def test_a_fit_that_ends_on_its_way_comes_with_a_warning(
    optimizer: OptimizerFactory, epochs: int, warned: bool, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    run = trainer(tmp_path, epochs)
    run.fit(SysID(values={"block.friction": 2 * TRUE_FRICTION}, optimizer=optimizer), OneBatch(push_batch()))
    assert ("block.friction has not settled" in caplog.text) == warned
    assert (float(run.callback_metrics["params/block.friction/left_to_go"]) > 1) == warned


@pytest.mark.parametrize("ratio", [0.0, 0.3, 0.54, 0.9])
def test_what_steps_that_shrink_alike_have_left_is_known(ratio: float) -> None:
    end, scale = torch.tensor([2.0, -1.0]).double(), torch.tensor([1.0, -3.0]).double()
    path = [end + scale * ratio**k for k in (0, 1, 2)]
    assert torch.allclose(left_to_go(path), (path[-1] - end).abs(), atol=1e-12)


def test_steps_that_do_not_shrink_and_a_single_one_leave_nine_times_the_last() -> None:
    there, back, again = torch.tensor([0.0]), torch.tensor([0.1]), torch.tensor([-0.2])
    assert left_to_go([there, back, again]).item() == pytest.approx(9 * 0.3)
    assert left_to_go([there, back]).item() == pytest.approx(9 * 0.1)
    assert not steps_shrink([there, back, again]), "the last step is as long as the one before: nobody knows the end"
    assert not steps_shrink([there, back])
    assert steps_shrink([torch.tensor([one]) for one in (0.0, 1.0, 1.5)])
    assert left_to_go([there, there]).item() == left_to_go([there, there, there]).item() == 0


def test_the_gradient_of_the_loss_agrees_with_differences() -> None:
    module = SysID(values={"block.friction": 1.5 * TRUE_FRICTION}, segment=8).attach(SCENE)
    batch = push_batch()

    def loss() -> torch.Tensor:
        return torch.stack([value.mean() for value in module.losses(batch).values()]).sum()

    (slope,) = torch.autograd.grad(loss(), [module.physical.coordinates])
    values = []
    for move in (1e-4, -2e-4):
        with torch.no_grad():
            module.physical.coordinates += move
            values.append(float(loss()))
    assert float(slope) == pytest.approx((values[0] - values[1]) / 2e-4, rel=1e-4)


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("model.segment=0", "model.segment must be at least 1, got 0"),
        ("model.seen=1", "model.seen must be at least 2, got 1"),
        ("data.limit=0", "data.limit must be at least 1, or null for all, got 0"),
    ],
)
def test_an_impossible_setting_is_named(
    word: str,
    message: str,
    recordings: Callable[[str], Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    data, folder = f"data.folder={recordings('push')}", f"--run-dir={tmp_path}"
    assert main(["fit", "--config", str(CONFIG), data, folder, word]) == 2
    assert message in capsys.readouterr().err


def test_recordings_without_a_validation_split_cannot_be_validated_on(
    recordings: Callable[[str], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data, folder = f"data.folder={recordings('push')}", f"--run-dir={tmp_path}"
    assert main(["fit", "--config", str(CONFIG), data, folder, "trainer.max_epochs=1"]) == 0
    assert main(["validate", folder]) == 2
    assert "there are no trajectories to validate on" in capsys.readouterr().err


def test_a_loss_that_is_not_finite_names_the_trajectory() -> None:
    module = SysID().attach(SCENE)
    batch = push_batch() | {"index": torch.tensor([4, 7, 9])}
    with pytest.raises(NonFiniteLossError, match="the loss position of trajectory 7 is not finite"):
        module.require_finite({"position": torch.tensor([0.0, math.nan, 0.0])}, batch)


def test_a_contact_problem_without_a_solution_names_the_trajectory() -> None:
    module = SysID(engine=Engine()).attach(SCENE)
    module.layer = PhysicsLayer(module.layer.world, solver=SolverSettings(max_steps=1))
    batch = push_batch() | {"index": torch.tensor([4, 7, 9])}
    with pytest.raises(SolverError, match=r"^trajectory 4, 7, 9: 3 of 3 contact problems were not solved at step 0"):
        module.losses(batch)


def test_the_errors_of_a_perfect_model_are_zero_over_segments_and_over_whole_trajectories() -> None:
    module = SysID(test_segment=6).attach(SCENE)
    batch = push_batch()
    with torch.no_grad():
        module.validation_step(batch, 0)
    for name in ("segments", "whole"):
        assert float(module.errors[name].take()["position_error"]) < 1e-6


def test_free_flight_is_the_ballistic_baseline_until_touch_down() -> None:
    module = SysID().attach(SCENE)
    batch = push_batch(count=1, frames=60)
    batch["pose"] = batch["pose"].clone()
    batch["pose"][:, 0, :, 2] += 0.05
    batch["twist"][:, 0] = torch.tensor([0.0, 0.0, 1.0, 0.5, 0.0, 0.0])
    batch["wrench"] = torch.zeros_like(batch["wrench"])
    known = Trajectories.of(batch, SCENE.time_step)
    with torch.no_grad():
        predicted = module.layer.rollout(known.start, known.wrench[:, :-1], module.physical()).pose
    flown = baselines.ballistic(known, SCENE)
    assert torch.allclose(flown[:, :20], predicted[:, :20], atol=SMOOTHED)
    assert torch.equal(flown[:, 40], flown[:, 59])
    assert torch.equal(baselines.held(known)[:, 5], known.pose[:, 0])


@pytest.mark.slow
def test_a_resumed_identification_equals_one_in_one_go(recordings: Callable[[str], Path], tmp_path: Path) -> None:
    common = ["--config", str(CONFIG), f"data.folder={recordings('push')}", "data.limit=2"]

    def fit(name: str, epochs: int, *more: str) -> dict[str, float]:
        folder = tmp_path / name
        budget = [f"trainer.max_epochs={epochs}", "trainer.callbacks=[]"]
        assert main(["fit", *common, *budget, f"--run-dir={folder}", *more]) == 0
        figures: dict[str, float] = json.loads((folder / "metrics.json").read_text())
        return figures

    fit("parts", 2)
    parts, whole = fit("parts", 4, "--resume"), fit("whole", 4)
    del parts["seconds"], whole["seconds"]
    assert parts == whole
    assert (tmp_path / "parts/parameters.csv").read_text() == (tmp_path / "whole/parameters.csv").read_text()
