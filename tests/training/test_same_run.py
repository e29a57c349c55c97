"""A run goes on as itself, on the recordings that it was fitted to, and a mistake costs no earlier run."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import h5py
import pytest
import torch
import yaml

from physid.cli import main
from physid.configuration import ConfigurationError, compose
from physid.data import RecordingSet
from physid.one_writer import CHECKPOINT, EARLIER, UNFINISHED_MOVE
from physid.runs import open_folder

FRICTION = "block.friction"


@pytest.fixture(scope="module")
def made(recordings: Callable[[str], Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with recordings `pushed` and a `run` of two epochs of them."""
    place = tmp_path_factory.mktemp("same")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place)
        shutil.copytree(recordings("push"), "pushed")
        assert main(["fit", "pushed", f"model.learn=[{FRICTION}]", "trainer.max_epochs=2", "--run-dir=run"]) == 0
    return place


@pytest.fixture
def run(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The run, beside its recordings, in a folder of the test's own."""
    shutil.copytree(made, tmp_path / "own", symlinks=True)
    monkeypatch.chdir(tmp_path / "own")
    return Path("run")


def content(folder: Path) -> dict[str, bytes]:
    """Return the files of a folder, without those of wandb."""
    files = [path for path in folder.rglob("*") if path.is_file() and "wandb" not in path.parts]
    return {str(path): path.read_bytes() for path in files}


def assert_refused(
    words: list[str], message: str, capsys: pytest.CaptureFixture[str], leaves: Path | None = None
) -> None:
    """Check that a command ends with a message, and leaves a folder as it was."""
    before = {} if leaves is None else content(leaves)
    capsys.readouterr()
    assert main(words) == 2
    assert message in capsys.readouterr().err.strip().splitlines()[-1]
    assert leaves is None or content(leaves) == before


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["model.values={block.mass: 4.0}"], "with model.values.block.mass=None, found 4.0"),
        (["seed_everything=7"], "with seed_everything=0, found 7"),
        (["data.limit=2"], "with data.limit=None, found 2"),
        (["model.learn=[block.mass]"], "with model.learn.0='block.friction', found 'block.mass'"),
        (["trainer.accelerator=gpu"], "gpu"),
        (["data.folder=nowhere"], "nowhere/recording.yaml: expected a recording set"),
    ],
)
def test_a_run_goes_on_as_itself_and_stays_as_it_is_where_it_cannot(
    words: list[str], message: str, run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert_refused(["fit", "--run-dir=run", "--resume", "trainer.max_epochs=3", *words], message, capsys, run)


def test_a_run_goes_on_for_longer_and_from_recordings_that_were_moved(run: Path) -> None:
    Path("pushed").rename("moved")
    Path("moved/SHA256SUMS").unlink()
    words = ["trainer.max_epochs=3", "data.folder=moved", "data.workers=1"]
    assert main(["fit", "--run-dir=run", "--resume", *words]) == 0
    assert torch.load(run / CHECKPOINT, weights_only=True)["epoch"] == 2


@pytest.mark.parametrize("change", ["a mass", "forces", "a file"])
def test_a_run_goes_on_with_its_own_recordings_only(change: str, run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shutil.copytree("pushed", "others")
    expected = "others: expected the recordings that the run was fitted to"
    if change == "a mass":
        description = Path("others/recording.yaml")
        description.write_text(description.read_text().replace("mass: 2.0", "mass: 9.0"))
    elif change == "forces":
        with h5py.File(RecordingSet("others").paths[-1], "r+") as file:
            file["wrench"][...] *= 3
    else:
        RecordingSet("others").paths[-1].unlink()
    assert_refused(["fit", "others", "--run-dir=run", "--resume"], expected, capsys, run)


def test_what_was_learned_is_not_taken_for_another_parameter(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert_refused(
        ["test", "--run-dir=run", "model.learn=[block.mass]"], "one that has learned 'block.friction'", capsys
    )


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["data.folder=nowhere"], "expected a recording set"),
        (["model.learn=[block.mas]"], 'did you mean "block.mass"'),
        (["trainer.accelerator=gpu"], "gpu"),
        (["trainer.enable_checkpointing=false"], "enable_checkpointing"),
        (["trainer.precision=bf16-mixed"], "trainer.precision"),
        (["data.batch_size=2"], "GaussNewton needs all trajectories in one batch"),
        (["data.forces=run/forces.csv"], "run/forces.csv"),
        (["--resume"], "expected --resume or --overwrite, found both"),
    ],
)
def test_a_mistake_costs_no_earlier_run(
    words: list[str], message: str, run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (run / "forces.csv").write_text("block.force_x\n1\n")
    assert_refused(["fit", "pushed", "--run-dir=run", "--overwrite", *words], message, capsys, run)


@pytest.mark.parametrize("killed", ["as the earlier run was put aside", "before a checkpoint", "after one"])
def test_an_exchange_of_runs_that_was_killed_loses_none(killed: str, run: Path) -> None:
    before = content(run)
    aside = run / (UNFINISHED_MOVE if killed.startswith("as") else EARLIER)
    shutil.copytree(run, Path("copy"), symlinks=True)
    aside.mkdir()
    for path in sorted(run.iterdir()):
        if path != aside and (path.name != "config.yaml" or not killed.startswith("as")):
            path.rename(aside / path.name)
    if not killed.startswith("as"):
        (run / "config.yaml").write_text("later: 1\n")
    if killed == "after one":
        Path("copy/checkpoints").rename(run / "checkpoints")
    with pytest.raises(ConfigurationError, match="holds an earlier run"), open_folder(compose([]), run):
        pass
    assert not aside.exists()
    if killed == "after one":
        assert (run / "config.yaml").read_text() == "later: 1\n"
    else:
        assert content(run) == before


def test_the_later_run_takes_the_place_of_the_earlier_one(run: Path) -> None:
    words = ["fit", "pushed", f"model.learn=[{FRICTION}]", "--run-dir=run", "--overwrite"]
    assert main([*words, "trainer.max_epochs=0", "wandb=disabled"]) == 0
    assert not (run / EARLIER).exists()
    assert not (run / CHECKPOINT).exists()


def test_recordings_are_not_deleted_with_the_run_that_they_lie_in(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert_refused(["fit", "pushed", "--run-dir=pushed"], "found the recordings themselves", capsys)
    assert main(["predict", "--run-dir=run"]) == 0
    words = ["fit", "run/predictions", "--run-dir=run", "--overwrite", f"model.learn=[{FRICTION}]"]
    assert_refused(words, "a folder that holds the recordings", capsys, run)


def test_a_folder_that_only_looks_like_a_run_is_not_deleted(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    own = Path("project")
    (own / "checkpoints").mkdir(parents=True)
    (own / "config.yaml").write_text("a: 1\n")
    (own / "precious.py").write_text("")
    assert_refused(
        ["fit", "pushed", "--run-dir=project", "--overwrite"], "found none that is certain to be one", capsys, own
    )


@pytest.mark.parametrize("limit", ["max_epochs=0", "limit_train_batches=0", "max_time=00:00:00:00"])
@pytest.mark.slow
def test_a_fit_without_a_step_says_that_it_gives_first_guesses(
    limit: str, run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    capsys.readouterr()
    assert main(["fit", "pushed", f"model.learn=[{FRICTION}]", "--run-dir=none", f"trainer.{limit}"]) == 0
    assert "NOTHING WAS FITTED" in capsys.readouterr().out
    assert main(["fit", "--run-dir=none", "--resume", "trainer.max_epochs=2", "trainer.limit_train_batches=1.0"]) == 0
    assert ("NOTHING WAS FITTED" in capsys.readouterr().out) == limit.startswith("max_time")


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("trainer.precision=bf16-mixed", "trainer.precision: expected none for GaussNewton"),
        ("trainer.accumulate_grad_batches=2", "trainer.accumulate_grad_batches: expected none for GaussNewton"),
        ("trainer.gradient_clip_val=0.1", "trainer.gradient_clip_val: expected none for GaussNewton"),
        ("data.batch_size=2", "GaussNewton needs all trajectories in one batch"),
    ],
)
def test_settings_that_gauss_newton_cannot_follow_are_refused(
    word: str, message: str, run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert_refused(["fit", "pushed", f"model.learn=[{FRICTION}]", "--run-dir=none", word], message, capsys)


def test_a_first_guess_stays_unknown_in_what_is_predicted(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shutil.copytree("pushed", "others")
    description = Path("others/recording.yaml")
    known = yaml.safe_load(description.read_text())
    description.write_text(yaml.safe_dump(known | {"unknown": ["block.mass", FRICTION]}))
    capsys.readouterr()
    assert main(["predict", "others", "--run-dir=run", "--out=there"]) == 0
    assert "block.mass = 2 is a first guess" in capsys.readouterr().out
    assert RecordingSet("there").scene.unknown == ("block.mass",)
    assert FRICTION in json.loads(Path("there/parameters.json").read_text())
    assert main(["predict", "others", "--run-dir=run", "--out=known", "model.values={block.mass: 2.0}"]) == 0
    assert RecordingSet("known").scene.unknown == ()
