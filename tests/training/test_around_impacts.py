"""Trajectories that tumble, or that no initial states explain, are cut around impacts; others stay whole."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import lightning as L
import numpy as np
import pytest
import torch
from tests.training.pushed import SCENE, TRUE_FRICTION, layer, push_batch
from tests.training.trainers import trainer_in

from physid.cli import main
from physid.data import trajectory_path
from physid.data.batches.datamodule import RecordingsDataModule
from physid.data.generation.generate import generate
from physid.data.generation.settings import GenerateConfig, Noise
from physid.training.learners.sysid import SysID
from physid.training.parameters import Pieces, Trajectories
from physid.training.parameters.physical_parameters import PhysicalParameters

NOISE = Noise(position=2e-4, rotation=2e-3)
LARGE = 3.0  # half widths of an interval: a miss is no surprise, three of them are
quiet = pytest.mark.filterwarnings("ignore::UserWarning")  # Lightning's, about loaders


def whole() -> Trajectories:
    return Trajectories.of(push_batch(), SCENE.time_step).stepped(SCENE.time_step)


def pieces(*rows: tuple[int, int, int, float]) -> Pieces:
    index, start, size, weight = zip(*rows, strict=True)
    place = (torch.tensor(each) for each in (index, start, size))
    return Pieces(*place, torch.tensor(weight, dtype=torch.float64), torch.zeros(len(rows), dtype=torch.bool))


def test_a_piece_has_the_frames_and_the_forces_of_its_trajectory() -> None:
    known = whole()
    cut = pieces((2, 5, 8, 1.0), (0, 0, 25, 0.5), (2, 13, 12, 1.0)).of(known)
    assert cut.index.tolist() == [2, 0, 2]
    assert cut.real.sum(1).tolist() == [8, 25, 12]
    for row, (trajectory, start, size) in enumerate(((2, 5, 8), (0, 0, 25), (2, 13, 12))):
        assert torch.equal(cut.pose[row, :size], known.pose[trajectory, start : start + size])
    predicted = cut.rolled(layer(), PhysicalParameters(SCENE, values={"block.friction": TRUE_FRICTION})())
    assert (predicted.pose - cut.pose)[cut.real].abs().max() < 1e-9  # the layer made them, state for state


def test_pieces_of_a_trajectory_that_is_not_there_are_refused() -> None:
    with pytest.raises(ValueError, match=r"expected the trajectories \[1, 7\], got \[0, 1, 2\]"):
        pieces((1, 0, 5, 1.0), (7, 0, 5, 1.0)).of(whole())


def test_pieces_count_by_their_frames_and_weights_and_whole_trajectories_alike() -> None:
    share = pieces((0, 0, 20, 1.0), (1, 0, 10, 1.0), (2, 0, 20, 0.25)).of(whole()).share
    assert share.mean() == pytest.approx(1.0)
    assert (share / share[0]).tolist() == pytest.approx([1.0, 0.5, 0.25])
    assert whole().share.tolist() == [1.0, 1.0, 1.0]


def test_pieces_are_kept_and_described() -> None:
    cut = pieces((0, 0, 25, 1.0), (1, 0, 10, 1.0), (1, 10, 15, 0.25))
    again = Pieces.of_state(cut.state_dict())
    assert again is not None
    assert all(torch.equal(one, other) for one, other in zip(vars(again).values(), vars(cut).values(), strict=True))
    assert Pieces.of_state({}) is None
    older = {name: value for name, value in cut.state_dict().items() if name != "struck"}
    assert not bool(Pieces.of_state(older).struck.any())  # type: ignore[union-attr]
    assert cut.counts_like(pieces((0, 0, 25, 0.9), (1, 0, 10, 1.2), (1, 10, 15, 0.3)))
    assert not cut.counts_like(pieces((0, 0, 25, 1.0), (1, 0, 10, 1.0), (1, 10, 15, 0.1)))
    assert cut.described().startswith("2 trajectories are cut around their impacts into 3 pieces")


def fitted(
    folder: Path, *, scene: str, epochs: int, cuts: bool = True, protocol: str = "rich", **made: object
) -> tuple[SysID, L.Trainer]:
    """Generate a set and fit it; returns the module and its trainer, with all its figures."""
    config = GenerateConfig(scene, protocol=protocol, video=False, split={"train": 1}, noise=NOISE, **made)  # type: ignore[arg-type]
    if not folder.exists():
        generate(config, folder, quiet=True)
    module = SysID(impacts=cuts)
    module.print = lambda *_, **__: None  # type: ignore[method-assign]
    trainer = trainer_in(folder, epochs)
    trainer.fit(module, RecordingsDataModule(folder, shuffle=False))
    return module, trainer


@quiet
@pytest.mark.slow
def test_without_impacts_nothing_is_cut_and_nothing_changes(tmp_path: Path) -> None:
    made: dict[str, object] = {
        "simulator": "mujoco",
        "trajectories": 3,
        "steps": 30,
        "unknown": ["block.friction"],
        "frame_rate": 60.0,
    }
    found = [fitted(tmp_path / "set", scene="push", epochs=2, cuts=cuts, **made)[0] for cuts in (True, False)]
    assert found[0].pieces is None
    assert found[0].physical.estimates() == found[1].physical.estimates()


@pytest.mark.slow
@quiet
def test_what_trajectories_without_an_impact_leave_is_no_reason_to_cut(tmp_path: Path) -> None:
    """A drag that the model lacks is in all of five pushes, a jolt in one of them."""
    folder = tmp_path / "set"
    config = GenerateConfig(
        "push", protocol="rich", video=False, split={"train": 1}, noise=NOISE, simulator="mujoco", trajectories=5,
        steps=60, frame_rate=60.0, unknown=("block.friction",), effects={"viscous_drag": {"coefficient": 4.0}},
    )  # fmt: skip
    generate(config, folder, quiet=True)
    with h5py.File(trajectory_path(folder, 0), "r+") as file:
        pose = file["pose"][...]
        pose[30:, 0, 0] += np.arange(len(pose) - 30) / 60.0  # [m], 1 m/s from there on
        file["pose"][...] = pose
    module, _ = fitted(folder, scene="push", epochs=1)
    assert module.pieces is None


@pytest.mark.slow
@quiet
def test_blocks_that_land_flat_stay_whole(tmp_path: Path) -> None:
    made: dict[str, object] = {"simulator": "closed_form", "trajectories": 4, "steps": 48, "frame_rate": 60.0}
    made["unknown"] = ["block.friction", "block.restitution"]
    module, _ = fitted(tmp_path / "set", scene="toss", protocol="straight", epochs=1, **made)
    assert module.pieces is None


@pytest.mark.slow
@quiet
@pytest.mark.parametrize("simulator", ["mujoco", "pybullet"])
def test_tumbling_blocks_are_cut_where_nobody_says_who_made_the_recordings(simulator: str, tmp_path: Path) -> None:
    """A simulator that is known keeps its trajectories whole; of others friction and restitution are found."""
    unknown = ["block.friction", "block.restitution"]
    foreign = simulator == "mujoco"
    made = {"simulator": simulator, "trajectories": 5, "steps": 48, "unknown": unknown, "frame_rate": 60.0, "seed": 1}
    module, trainer = fitted(tmp_path / "set", scene="toss", epochs=20 if foreign else 1, **made)
    assert (module.pieces is not None) == foreign
    if not foreign:
        return
    for name, true in (("block.friction", 0.2), ("block.restitution", 0.3)):
        value = module.physical.estimates()[name]
        low, high = (float(trainer.callback_metrics[f"params/{name}/{end}"]) for end in ("low", "high"))
        assert value == pytest.approx(true, rel=0.02)
        assert abs(math.log(value / true)) < LARGE * math.log(high / low) / 2


def interrupted_in(epoch: int) -> Callable[..., None]:
    """Return what SysID does before a batch, but for a Ctrl-C in an epoch."""
    start = SysID.on_train_batch_start

    def interrupted(self: SysID, *words: Any) -> None:
        if self.current_epoch == epoch:
            raise KeyboardInterrupt
        start(self, *words)

    return interrupted


@pytest.mark.slow
@quiet
def test_a_run_over_pieces_that_is_resumed_ends_as_an_undisturbed_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    made = {"simulator": "mujoco", "trajectories": 5, "steps": 48, "frame_rate": 60.0, "seed": 1}
    config = GenerateConfig(
        "toss", protocol="rich", video=False, split={"train": 1}, noise=NOISE,
        unknown=("block.friction", "block.restitution"), **made,
    )  # fmt: skip
    generate(config, tmp_path / "set", quiet=True)
    words = ["fit", str(tmp_path / "set"), "--run-dir"]
    assert main([*words, str(tmp_path / "whole"), "trainer.max_epochs=2"]) == 0
    assert "are cut around their impacts" in capsys.readouterr().out
    with monkeypatch.context() as interrupting:
        interrupting.setattr(SysID, "on_train_batch_start", interrupted_in(1))
        assert main([*words, str(tmp_path / "halves"), "trainer.max_epochs=2"]) == 130
    assert main([*words, str(tmp_path / "halves"), "trainer.max_epochs=2", "--resume"]) == 0
    whole, halves = (json.loads((tmp_path / name / "metrics.json").read_text()) for name in ("whole", "halves"))
    assert {name: halves[name] for name in whole if name.startswith("params/")} == {
        name: value for name, value in whole.items() if name.startswith("params/")
    }
