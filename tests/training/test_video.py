"""Learning from video end to end, on a recording set that is far too small to learn anything."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from physid.cli import main
from physid.data import Recording, RecordingSet, write_scene, write_trajectory
from physid.networks.voting import VotingPoseEncoder
from physid.training.learners.engine import Engine
from physid.training.learners.optimisation import take_encoder
from physid.training.learners.self_supervised import SelfSupervisedID
from physid.training.learners.supervised import SupervisedID

CONFIGS = Path(__file__).parent.parent.parent / "configs"
MISSED = 10.0  # block sizes: after a step of learning anything in view will do
MOVED = 0.01  # [m]
CLASSES = {"supervised": SupervisedID, "self_supervised": SelfSupervisedID}
TINY = [
    "data.batch_size=4",
    "data.every=5",
    "data.draw=1",
    "model.objective.synthetic_images.frames=1",
    "model.phases.warm_up=1",
    "model.phases.refine=1",
    "model.vision.pose_refinement.steps=2",
    "model.vision.pose_refinement.headings=1",
    "trainer.max_epochs=3",
    "trainer.accelerator=cpu",
    "wandb=disabled",
]


@pytest.fixture(scope="module")
def films(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("films") / "push"
    config = str(CONFIGS / "generate" / "push.yaml")
    tiny = ["trajectories=10", "steps=21", "--workers=1", "--quiet", f"--out={out}"]
    assert main(["generate", "--config", config, *tiny]) == 0
    return out


def test_films_whose_maker_is_not_known_are_predicted_with_one_step_per_frame_and_that_is_said(
    films: Path, caplog: pytest.LogCaptureFixture
) -> None:
    known = RecordingSet(films).scene
    SupervisedID(["block.mass"]).attach(known)
    unknown = dataclasses.replace(known, integration=None, time_step=1 / 30)
    SupervisedID(["block.mass"], engine=Engine(substeps=4)).attach(unknown)
    assert not caplog.records
    SelfSupervisedID(["block.mass"]).attach(unknown)
    (said,) = (one.getMessage() for one in caplog.records)
    assert "one from frame to frame (33.3 ms)" in said
    assert "model.engine.substeps=16" in said


@pytest.mark.parametrize("method", ["supervised", pytest.param("self_supervised", marks=pytest.mark.slow)])
def test_all_phases_run_within_one_fit_and_leave_films(method: str, films: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    config = str(CONFIGS / method / "push_friction.yaml")
    assert main(["fit", "--config", config, f"--run-dir={run}", f"data.folder={films}", *TINY]) == 0
    figures = json.loads((run / "metrics.json").read_text())
    assert figures["params/block.friction/low"] < figures["params/block.friction/high"]
    assert {"test/position_error", "test/encoded_position_error", "test/psnr", "test/ssim"} <= figures.keys()
    assert list(run.glob("frames_*.png"))
    assert list(run.glob("prediction_*.mp4"))


class Killed(Exception):
    """What stops a run in a test."""


@pytest.mark.slow
@pytest.mark.parametrize(("method", "epochs"), [("supervised", (1, 2, 4)), ("self_supervised", (4,))])
def test_a_run_that_is_killed_within_its_phases_and_resumed_ends_as_one_that_is_not(
    method: str, epochs: tuple[int, ...], films: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = CLASSES[method]
    phases = ["trainer.max_epochs=5", "model.phases.warm_up=2", "model.phases.refine=2"]
    fit = ["fit", "--config", str(CONFIGS / method / "push_friction.yaml"), f"data.folder={films}", *TINY, *phases]
    assert main([*fit, f"--run-dir={tmp_path / 'whole'}"]) == 0
    step = module.training_step
    for epoch in epochs:  # warming up, learning together, refining

        def killed(self: Any, batch: Any, batch_idx: int, last: int = epoch) -> None:
            if (self.current_epoch, batch_idx) == (last, 1):
                raise Killed
            step(self, batch, batch_idx)

        with monkeypatch.context() as patch:
            patch.setattr(module, "training_step", killed)
            with pytest.raises(Killed):
                main([*fit, f"--run-dir={tmp_path / 'parts'}", "--resume"])
    assert main([*fit, f"--run-dir={tmp_path / 'parts'}", "--resume"]) == 0
    whole, parts = (json.loads((tmp_path / name / "metrics.json").read_text()) for name in ("whole", "parts"))
    assert {**parts, "seconds": 0} == {**whole, "seconds": 0}


@pytest.mark.slow
@pytest.mark.parametrize(("epoch", "loss"), [(1, "encoded_position"), (2, "refined")])
def test_a_loss_that_is_not_finite_names_the_trajectory_and_leaves_the_last_good_state(
    epoch: int,
    loss: str,
    films: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    run, config = tmp_path / "run", str(CONFIGS / "supervised" / "push_friction.yaml")
    spoiled, step = 3, SupervisedID.training_step

    def spoil(self: Any, batch: Any, batch_idx: int) -> None:
        if self.current_epoch == epoch:
            batch["pose"][batch["index"] == spoiled] = torch.nan
        step(self, batch, batch_idx)

    monkeypatch.setattr(SupervisedID, "training_step", spoil)
    assert main(["fit", "--config", config, f"--run-dir={run}", f"data.folder={films}", *TINY]) == 2
    said = capsys.readouterr().err
    assert f"the loss {loss} of trajectory {spoiled} is not finite in epoch {epoch}" in said
    assert "last.ckpt" in said
    assert torch.load(run / "checkpoints" / "last.ckpt", weights_only=True)["epoch"] == epoch - 1


@pytest.mark.slow
def test_first_velocities_come_from_three_frames_where_nothing_rests(films: Path, tmp_path: Path) -> None:
    config = str(CONFIGS / "supervised" / "push_friction.yaml")
    fit = ["fit", "--config", config, f"data.folder={films}", *TINY, "model.vision.start={at_rest: false, spacing: 5}"]
    assert main([*fit, f"--run-dir={tmp_path / 'run'}", "data.video=[0, 5, 10]"]) == 0
    figures = json.loads((tmp_path / "run" / "metrics.json").read_text())
    assert figures["test/predicted_position_error"] < MISSED


def test_first_velocities_without_their_frames_are_refused(
    films: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = str(CONFIGS / "supervised" / "push_friction.yaml")
    fit = ["fit", "--config", config, f"data.folder={films}", *TINY, "model.vision.start={at_rest: false, spacing: 5}"]
    assert main([*fit, f"--run-dir={tmp_path / 'run'}", "data.video=[0]", "data.draw=0"]) == 2
    assert "name them in data.video" in capsys.readouterr().err


@pytest.mark.parametrize("cell", ["collide", "slide_friction"])
@pytest.mark.parametrize("method", ["supervised", "self_supervised"])
@pytest.mark.slow
def test_two_blocks_and_an_incline_go_through_all_phases(cell: str, method: str, tmp_path: Path) -> None:
    films, config = tmp_path / "films", str(CONFIGS / "generate" / f"{cell.split('_')[0]}.yaml")
    tiny = ["trajectories=10", "steps=11", "--workers=1", "--quiet", f"--out={films}"]
    assert main(["generate", "--config", config, *tiny]) == 0
    run, config = tmp_path / "run", str(CONFIGS / method / f"{cell}.yaml")
    assert main(["fit", "--config", config, f"--run-dir={run}", f"data.folder={films}", *TINY]) == 0
    assert "test/psnr" in json.loads((run / "metrics.json").read_text())


def pose(recording: Recording) -> np.ndarray:
    assert recording.pose is not None
    return recording.pose


@pytest.mark.slow
def test_what_is_predicted_lands_in_a_recording_set_with_films(films: Path, tmp_path: Path) -> None:
    run, config = tmp_path / "run", str(CONFIGS / "supervised" / "push_friction.yaml")
    assert main(["fit", "--config", config, f"--run-dir={run}", f"data.folder={films}", *TINY]) == 0
    few = ["data.limit=2", "trainer.accelerator=cpu"]
    assert main(["predict", f"--run-dir={run}", f"--out={tmp_path / 'seen'}", *few]) == 0
    seen = RecordingSet(tmp_path / "seen")
    seen.verify()
    assert [path.name for path in seen.paths] == ["000000.h5", "000001.h5"]
    assert all(pose(made).shape == pose(known).shape for made, known in zip(seen, RecordingSet(films), strict=False))
    assert len(list((tmp_path / "seen").rglob("prediction_*.mp4"))) == 2
    assert "block.friction" in json.loads((tmp_path / "seen" / "parameters.json").read_text())

    # Planned forces: two that are alike at first predict alike as long as they are, and as far as they go.
    pushes = {"weak": [5.0] * 8 + [0.0] * 6, "strong": [5.0] * 8 + [20.0] * 22}
    for name, force in pushes.items():
        table = tmp_path / f"{name}.csv"
        table.write_text("\n".join(["block.force_x", *map(str, force)]))
        assert main(["predict", f"--run-dir={run}", f"--out={tmp_path / name}", f"--forces={table}", *few]) == 0
        assert len(list((tmp_path / name).rglob("prediction_*.mp4"))) == 2
    weak, strong = (pose(RecordingSet(tmp_path / name).read(0)) for name in pushes)
    assert (len(weak), len(strong)) == (15, 31)
    assert np.allclose(weak[:9], strong[:9], atol=1e-9)
    assert strong[-1, 0, 0] > strong[0, 0, 0] + MOVED


@pytest.mark.slow
def test_films_without_poses_are_predicted_alike(films: Path, tmp_path: Path) -> None:
    run, config = tmp_path / "run", str(CONFIGS / "supervised" / "push_friction.yaml")
    assert main(["fit", "--config", config, f"--run-dir={run}", f"data.folder={films}", *TINY]) == 0
    alone, few = tmp_path / "alone", ["data.limit=2", "trainer.accelerator=cpu"]
    (alone / "trajectories").mkdir(parents=True)
    write_scene(alone, RecordingSet(films).scene)
    for index in range(2):
        film = dataclasses.replace(RecordingSet(films).read(index, video=True), pose=None, twist=None)
        write_trajectory(alone / "trajectories" / f"{index:06d}.h5", film)
    for folder, name in ((films, "seen"), (alone, "unseen")):
        made = ["predict", f"--run-dir={run}", f"--out={tmp_path / name}", f"data.folder={folder}", *few]
        assert main(made) == 0
    for index in range(2):
        seen, unseen = (pose(RecordingSet(tmp_path / name).read(index)) for name in ("seen", "unseen"))
        assert np.array_equal(seen, unseen)


@pytest.mark.slow
def test_a_run_begins_with_the_encoder_of_another_one_of_its_kind(films: Path, tmp_path: Path) -> None:
    run, config = tmp_path / "run", str(CONFIGS / "supervised" / "push_friction.yaml")
    assert main(["fit", "--config", config, f"--run-dir={run}", f"data.folder={films}", *TINY]) == 0
    checkpoint, scene = run / "checkpoints" / "last.ckpt", RecordingSet(films).scene
    learned = torch.load(checkpoint, weights_only=True)["state_dict"]
    model = SupervisedID(["block.mass"], encoder=VotingPoseEncoder).attach(scene).model
    take_encoder(model, checkpoint)
    assert all(
        torch.equal(value, learned[f"model.encoder.{name}"]) for name, value in model.encoder.state_dict().items()
    )
    with pytest.raises(ValueError, match=r"last.ckpt: expected an encoder of the same method"):
        take_encoder(SelfSupervisedID(["block.mass"]).attach(scene).model, checkpoint)
    with pytest.raises(ValueError, match=r"model.vision.weights: expected a checkpoint .* found none at"):
        take_encoder(model, tmp_path / "nowhere.ckpt")
    taking = [f"--run-dir={tmp_path / 'second'}", f"model.vision.weights={checkpoint}", "model.phases.warm_up=0"]
    assert main(["fit", "--config", config, f"data.folder={films}", *TINY, *taking]) == 0


def test_recordings_without_video_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, config = tmp_path / "blind", str(CONFIGS / "generate" / "push.yaml")
    blind = ["trajectories=10", "steps=5", "video=false", "--workers=1", "--quiet", f"--out={out}"]
    assert main(["generate", "--config", config, *blind]) == 0
    fit = ["fit", "--config", str(CONFIGS / "supervised" / "push_friction.yaml"), f"--run-dir={tmp_path / 'run'}"]
    assert main([*fit, f"data.folder={out}", *TINY]) == 2
    assert "video=true" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize(("imagined", "compared"), [(0, [0, 1, 2, 3, 4, 5]), (1, [2, 3, 4, 5])])
def test_the_blur_goes_all_the_way_over_the_epochs_whose_loss_compares_images(
    imagined: int, compared: list[int], films: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: dict[int, set[int]] = {}
    losses = SelfSupervisedID.losses

    def noted(self: SelfSupervisedID, batch: Any) -> dict[str, torch.Tensor]:
        values = losses(self, batch)
        if "encoded_image" in values:
            seen.setdefault(self.current_epoch, set()).add(self.blur.blur.kernel)
        return values

    monkeypatch.setattr(SelfSupervisedID, "losses", noted)
    config = str(CONFIGS / "self_supervised" / "push_friction.yaml")
    phases = ["trainer.max_epochs=7", "model.phases.warm_up=2", "model.phases.refine=1"]
    images = ["model.objective.blur={start: [128, 128]}", f"model.objective.synthetic_images.frames={imagined}"]
    fit = ["fit", "--config", config, f"--run-dir={tmp_path / 'run'}", f"data.folder={films}", *TINY, *phases, *images]
    assert main(fit) == 0
    assert list(seen) == compared
    kernels = [kernel for epoch in compared for kernel in seen[epoch]]
    assert len(kernels) == len(compared), "one kernel in each epoch"
    assert (kernels[0], kernels[-1]) == (128, 5)
    assert kernels == sorted(kernels, reverse=True)


@pytest.mark.parametrize(
    "encoder",
    [
        "encoder.PoseEncoder",
        "encoder.VariationalPoseEncoder",
        "voting.VotingPoseEncoder",
    ],
)
@pytest.mark.parametrize("method", ["supervised", "self_supervised"])
@pytest.mark.slow
def test_either_method_takes_any_encoder_and_a_distribution_has_its_price(
    method: str, encoder: str, films: Path, tmp_path: Path
) -> None:
    run, config = tmp_path / "run", str(CONFIGS / method / "push_friction.yaml")
    slot = f"model.encoder={{class_path: physid.networks.{encoder}}}"
    assert main(["fit", "--config", config, f"--run-dir={run}", f"data.folder={films}", *TINY, slot]) == 0
    figures = json.loads((run / "metrics.json").read_text())
    assert (figures.get("train/divergence", 0.0) > 0) == (encoder == "encoder.VariationalPoseEncoder")
    assert figures["test/encoded_position_error"] < MISSED
    assert figures["params/block.friction/by_gradient_estimate"] != figures["params/block.friction/estimate"]


@pytest.mark.slow
def test_a_still_film_is_told_by_its_first_frame_and_not_by_the_empty_scene(films: Path, tmp_path: Path) -> None:
    run, config = tmp_path / "run", str(CONFIGS / "supervised" / "push_friction.yaml")
    assert main(["fit", "--config", config, f"--run-dir={run}", f"data.folder={films}", *TINY]) == 0
    figures = json.loads((run / "metrics.json").read_text())
    # Within 21 frames a block hardly moves: what its first frame says is nearly right.
    assert figures["test/held_psnr"] > figures["test/background_psnr"] + 10
