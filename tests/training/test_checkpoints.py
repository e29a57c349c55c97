"""A checkpoint of a stranger is data: it reaches no file outside the run, and what is wrong with it is one line."""

from __future__ import annotations

import shutil
import warnings
from pathlib import Path
from typing import Any

import pytest
import torch
from tests.training import regression

from physid import cli
from physid.training.runs.checkpoints import LastCheckpoint

CHECKPOINT = Path("checkpoints", "last.ckpt")
KIND = "lightning.pytorch.callbacks.ModelCheckpoint"
BEST = f"trainer.callbacks=[{{class_path: {KIND}, init_args: {{filename: 'at-{{epoch}}', monitor: train/loss}}}}]"


def fit(folder: Path, *words: str) -> int:
    """Fit a line in a folder."""
    return cli.main(["fit", f"--run-dir={folder}", *words, f"--allow={regression.__name__}"])


@pytest.fixture
def config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.chdir(tmp_path)
    name = regression.__name__
    (tmp_path / "line.yaml").write_text(
        f"model: {{class_path: {name}.Line}}\ndata: {{class_path: {name}.Points}}\n"
        "trainer: {max_epochs: 2, accelerator: cpu}\n"
    )
    return "--config=line.yaml"


def victim(tmp_path: Path) -> Path:
    """Return a folder of the user's own."""
    (tmp_path / "victim" / "deep").mkdir(parents=True)
    (tmp_path / "victim" / "thesis.ckpt").write_text("years")
    (tmp_path / "victim" / "deep" / "thesis.txt").write_text("years")
    return tmp_path / "victim"


def untouched(folder: Path) -> bool:
    """Tell whether all of it is there."""
    return all((folder / name).read_text() == "years" for name in ("thesis.ckpt", "deep/thesis.txt"))


def forge(folder: Path, change: dict[str, Any]) -> None:
    """Change the state of every ModelCheckpoint in a run's checkpoint; there is one even where none was written."""
    state = torch.load(folder / CHECKPOINT, weights_only=True)
    known = [key for key in state["callbacks"] if key.startswith("ModelCheckpoint")]
    last = LastCheckpoint(folder / CHECKPOINT).state_key
    for key in {*known, last, last.replace("LastCheckpoint", "ModelCheckpoint")}:
        plain = {"dirpath": str(folder / "checkpoints"), "best_model_score": None, "best_model_path": ""}
        state["callbacks"][key] = {**plain, **state["callbacks"].get(key, {}), **change}
    torch.save(state, folder / CHECKPOINT)


@pytest.mark.parametrize("callbacks", [[], [BEST]], ids=["plain", "with a ModelCheckpoint of its own"])
@pytest.mark.parametrize("way", ["local://{}", "file://{}", "{}", "{}/thesis.ckpt", "local://{}/thesis.ckpt", "link"])
def test_a_checkpoint_removes_no_file_outside_its_run(
    config: str, tmp_path: Path, callbacks: list[str], way: str
) -> None:
    folder, mine = tmp_path / "run", victim(tmp_path)
    assert fit(folder, config, *callbacks) == 0
    path = way.format(mine)
    if way == "link":
        (folder / "checkpoints" / "way").symlink_to(mine)
        path = str(folder / "checkpoints" / "way" / "thesis.ckpt")
    home = path.rpartition("/")[0]
    for dirpath in (folder / "checkpoints", mine, home):
        best = {path: torch.tensor(1e9)}
        names = dict.fromkeys(("best_model_path", "kth_best_model_path", "last_model_path"), path)
        forge(folder, {**names, "best_k_models": best, "dirpath": str(dirpath), "kth_value": torch.tensor(1e9)})
        assert fit(folder, "--resume", f"trainer.max_epochs={torch.load(folder / CHECKPOINT)['epoch'] + 3}") == 0
        assert untouched(mine)


def test_a_configuration_whose_checkpoints_lie_elsewhere_removes_there_what_it_has_written_alone(
    config: str, tmp_path: Path
) -> None:
    folder, mine = tmp_path / "run", victim(tmp_path)
    assert fit(folder, config, BEST.replace("{filename", f"{{dirpath: {mine}, filename")) == 0
    forge(folder, {"best_model_path": str(mine / "thesis.ckpt"), "dirpath": str(mine)})
    assert fit(folder, "--resume", "trainer.max_epochs=4") == 0
    assert untouched(mine)
    assert (mine / "at-epoch=3.ckpt").exists()
    assert not (mine / "at-epoch=2.ckpt").exists()


def test_a_run_goes_on_with_checkpoints_of_its_own_and_removes_the_earlier_ones(config: str, tmp_path: Path) -> None:
    names = []
    for folder in (tmp_path / "whole", tmp_path / "halves"):
        assert fit(folder, config, BEST, "trainer.max_epochs=" + ("4" if folder.name == "whole" else "2")) == 0
        assert folder.name == "whole" or fit(folder, "--resume", "trainer.max_epochs=4") == 0
        names.append(sorted(path.name for path in (folder / "checkpoints").iterdir()))
    assert names == [["at-epoch=3.ckpt", "last.ckpt"]] * 2


def test_a_run_that_was_moved_goes_on_without_a_warning_and_forgets_no_checkpoint(config: str, tmp_path: Path) -> None:
    assert fit(tmp_path / "here", config, BEST) == 0
    shutil.move(tmp_path / "here", tmp_path / "there")
    with warnings.catch_warnings():
        warnings.filterwarnings("error", "The dirpath has changed")
        assert fit(tmp_path / "there", "--resume", "trainer.max_epochs=4") == 0
    assert sorted(path.name for path in (tmp_path / "there" / "checkpoints").iterdir()) == [
        "at-epoch=3.ckpt", "last.ckpt",
    ]  # fmt: skip
    assert not (tmp_path / "here").exists()
