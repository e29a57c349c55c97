"""Frames in which a pose stands alone do not count in a fit, nor in the initial states of a prediction."""

from __future__ import annotations

import math
from pathlib import Path

import h5py
import lightning as L
import pytest
import torch
from tests.training.pushed import SCENE, push_batch
from tests.training.trainers import trainer_in

from physid.data.batches.datamodule import RecordingsDataModule
from physid.data.generation.generate import generate
from physid.data.generation.settings import GenerateConfig, Noise
from physid.training.initial_states import Cutting, OutlierFrames
from physid.training.learners.sysid import SysID
from physid.training.parameters import Trajectories

NOISE = Noise(position=3e-4, rotation=2e-3)
MOVED = 8e-3  # far less than a pose must be off that no motion explains whatever the model
STRAY = {(0, 1): 1, (0, 17): -1, (1, 30): 1, (2, 0): 1, (3, 47): -1, (4, 9): 1, (4, 12): -1, (5, 25): 1}
quiet = pytest.mark.filterwarnings("ignore::UserWarning")  # Lightning's, about loaders, and of stray poses


def whole() -> Trajectories:
    return Trajectories.of(push_batch(), SCENE.time_step).stepped(SCENE.time_step)


def made(folder: Path, *, moved: bool) -> Path:
    """Record pushes of another simulator, some poses of which are moved."""
    config: dict[str, object] = {
        "scene": "push",
        "simulator": "mujoco",
        "protocol": "rich",
        "frame_rate": 60.0,
        "trajectories": 6,
        "steps": 48,
        "unknown": ["block.friction"],
        "noise": NOISE,
        "video": False,
        "split": {"train": 1},
    }
    generate(GenerateConfig(**config), folder, workers=1, quiet=True)  # type: ignore[arg-type]
    for (trajectory, frame), sign in STRAY.items() if moved else ():
        with h5py.File(sorted((folder / "trajectories").glob("*.h5"))[trajectory], "r+") as file:
            file["pose"][frame, 0, :2] += sign * MOVED
    return folder


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made(tmp_path_factory.mktemp("sets") / "clean", moved=False)


@pytest.fixture(scope="module")
def moved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made(tmp_path_factory.mktemp("sets") / "moved", moved=True)


def fitted(folder: Path, epochs: int) -> tuple[SysID, L.Trainer]:
    module, trainer = SysID(), trainer_in(folder, epochs)
    trainer.fit(module, RecordingsDataModule(folder, shuffle=False))
    return module, trainer


@quiet
@pytest.mark.slow
def test_poses_that_are_off_by_little_are_left_out_and_move_no_estimate(clean: Path, moved: Path) -> None:
    undisturbed, _ = fitted(clean, 20)
    module, trainer = fitted(moved, 20)
    assert undisturbed.outliers is None
    assert module.outliers is not None
    found = zip(module.outliers.index.tolist(), module.outliers.frame.tolist(), strict=True)
    assert set(found) == STRAY.keys()
    low, high = (float(trainer.callback_metrics[f"params/block.friction/{end}"]) for end in ("low", "high"))
    one, other = (each.physical.estimates()["block.friction"] for each in (undisturbed, module))
    assert abs(math.log(one / other)) < math.log(high / low) / 2, "lost frames cost little, and no bias"


@quiet
@pytest.mark.slow
def test_what_is_left_out_is_kept_with_a_run(moved: Path) -> None:
    module, _ = fitted(moved, 1)
    assert module.outliers is not None
    found = zip(module.outliers.index.tolist(), module.outliers.frame.tolist(), strict=True)
    assert set(found) == STRAY.keys()
    checkpoint: dict[str, object] = {}
    module.on_save_checkpoint(checkpoint)
    again = SysID()
    again.attach(module.scene)
    again.on_load_checkpoint(checkpoint)
    assert again.outliers is not None
    assert torch.equal(again.outliers.index, module.outliers.index)
    assert torch.equal(again.outliers.frame, module.outliers.frame)
    said = again.outliers.described(6 * 48)
    assert said.startswith("8 of 288 frames do not count")
    assert said.endswith("the first in trajectory 0, frame 1)")
    assert OutlierFrames.of_state({}) is None


def test_only_those_frames_of_those_trajectories_do_not_count() -> None:
    known = whole()
    outlier = torch.zeros_like(known.real)
    outlier[1, 4] = outlier[2, 0] = True
    frames = OutlierFrames.among(known, outlier)
    assert len(frames) == 2
    backwards = known.chosen(torch.tensor([2, 1]))
    left = Cutting(None, frames).of(backwards)
    assert torch.equal(left.real, backwards.real & ~outlier[[2, 1]])
    assert torch.equal(left.pose, backwards.pose)
    others = known.chosen(known.index == 0)
    assert torch.equal(frames.left_out_of(others).real, others.real)


def test_without_outliers_a_cut_is_that_of_whole_trajectories() -> None:
    known = whole()
    assert Cutting().of(known) is known
    cut, plain = Cutting(5).of(known), known.segments(5)
    assert torch.equal(cut.pose, plain.pose)
    assert torch.equal(cut.real, plain.real)


@quiet
@pytest.mark.slow
def test_predictions_begin_at_frames_that_count(clean: Path, moved: Path) -> None:
    """Initial states are those that are found without the poses which were moved."""
    predicted = []
    for folder in (clean, moved):
        data = RecordingsDataModule(folder, shuffle=False)
        module = SysID(values={"block.friction": 0.12}).attach(data.scene)
        batch = next(iter(data.train_dataloader()))
        predicted.append(module.predict_step(batch, 0).pose[..., :3])
    apart = (predicted[0] - predicted[1]).norm(dim=-1)
    assert float(apart.square().mean().sqrt()) < NOISE.position < MOVED / 20
