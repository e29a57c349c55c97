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
from physid.training.callbacks.converged import Converged
from physid.training.callbacks.intervals import Intervals
from physid.training.callbacks.parameter_history import ParameterHistory
from physid.training.callbacks.run_state import RunState
from physid.training.runs.checkpoints import LastCheckpoint

CHECKPOINT = Path("checkpoints", "last.ckpt")
KIND = "lightning.pytorch.callbacks.ModelCheckpoint"
BEST = f"trainer.callbacks=[{{class_path: {KIND}, init_args: {{filename: 'at-{{epoch}}', monitor: train/loss}}}}]"


def fit(folder: Path, *words: str) -> int:
    """Fit a line in a folder."""
    return cli.main(["fit", f"--run-dir={folder}", *words, f"--allow={regression.__name__}"])


def victim(tmp_path: Path) -> Path:
    """Return a folder of the user's own."""
    (tmp_path / "victim" / "deep").mkdir(parents=True)
    (tmp_path / "victim" / "thesis.ckpt").write_text("years")
    (tmp_path / "victim" / "deep" / "thesis.txt").write_text("years")
    return tmp_path / "victim"


def untouched(folder: Path) -> bool:
    """Return whether all of it is there."""
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


@pytest.mark.slow
@pytest.mark.parametrize(
    "callbacks",
    [pytest.param([], id="plain"), pytest.param([BEST], id="with a ModelCheckpoint of its own")],
)
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
        # A run that holds a link out of it is refused before its checkpoint is read.
        code = 2 if way == "link" else 0
        assert fit(folder, "--resume", f"trainer.max_epochs={torch.load(folder / CHECKPOINT)['epoch'] + 3}") == code
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


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a run of two epochs."""
    folder = tmp_path_factory.mktemp("runs")
    name = regression.__name__
    (folder / "line.yaml").write_text(
        f"model: {{class_path: {name}.Line}}\ndata: {{class_path: {name}.Points}}\n"
        "trainer: {max_epochs: 2, accelerator: cpu}\n"
    )
    assert fit(folder / "run", f"--config={folder / 'line.yaml'}") == 0
    return folder / "run"


OWN = ("callbacks", "RunState")


@pytest.mark.parametrize(
    ("place", "value", "found"),
    [
        (("epoch",), float("inf"), "epoch must be a whole number"),
        (("epoch",), "x", "epoch must be a whole number"),
        (("callbacks",), [], "callbacks: expected the state of a run"),
        (("callbacks",), {}, "callbacks: expected the state of a run"),
        (OWN, 3, "RunState: expected a mapping"),
        ((*OWN, "seconds"), "x", "RunState: seconds: expected a finite number, found 'x'"),
        ((*OWN, "figures"), [1], "RunState: figures: expected a mapping"),
        ((*OWN, "row"), {"x": [1]}, "RunState: row.x: expected a finite number"),
        ((*OWN, "torch"), torch.zeros(3), "RNG state must be a torch.ByteTensor"),
        ((*OWN, "cuda"), [1], "RunState.cuda: expected states"),
        ((*OWN, "numpy"), ["MT19937", [1], 2, 3, 4.0], "RunState.numpy: expected 624 numbers"),
        ((*OWN, "numpy"), ["MT19937", [1] * 624, 10**6, 0, 0.0], "RunState.numpy: expected 624 numbers"),
        ((*OWN, "python"), [3, [1], None], ""),
        (("loops",), {}, "KeyError: 'fit_loop'"),
        (("loops", "fit_loop"), {"epoch_progress": 5}, ""),
        (("optimizer_states",), [{}], "KeyError"),
        (("optimizer_states",), "x", "AttributeError"),
        (("state_dict",), [1], "whose state_dict is a mapping"),
        (("state_dict",), {"net.weight": 1}, "Error(s) in loading state_dict"),
        (("pytorch-lightning_version",), "zz", "Invalid version: 'zz'"),
        (("pytorch-lightning_version",), 3, ""),
    ],
)
def test_what_is_wrong_with_a_checkpoint_is_one_line_that_names_it(
    run: Path, tmp_path: Path, place: tuple[str, ...], value: Any, found: str, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(run, tmp_path / "run")
    path = tmp_path / "run" / CHECKPOINT
    state = inner = torch.load(path, weights_only=True)
    for key in place[:-1]:
        inner = inner[key]
    inner[place[-1]] = value
    torch.save(state, path)
    assert fit(tmp_path / "run", "--resume", "trainer.max_epochs=3") == 2
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert said.startswith(f"physid: {path}: expected a checkpoint")
    assert found in said


@pytest.mark.parametrize(
    ("callback", "state", "message"),
    [
        (Converged(lengthen=[8]), {"longer": 2}, "Converged.longer must be a whole number of at most 1"),
        (Converged(), {"longer": "x"}, "Converged.longer must be a whole number"),
        (Intervals(), {"path": [1]}, "Intervals.path: expected parameters"),
        (ParameterHistory(), {"rows": [{"epoch": 0.0, "x": "y"}]}, r"ParameterHistory.rows: \[0\].x: expected"),
        (ParameterHistory(), {"rows": [{"epoch": 0.0}]}, "ParameterHistory.rows: expected epoch, evaluations"),
        (
            ParameterHistory(),
            {"rows": [{"epoch": 0.0, "evaluations": 1.0, "x": 1.0}, {"epoch": 1.0, "evaluations": 1.0, "y": 1.0}]},
            "the same parameters in each",
        ),
    ],
)
def test_a_callback_takes_no_state_that_is_none_of_its_own(callback: Any, state: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        callback.load_state_dict(state)


def test_figures_that_are_not_finite_are_taken_up() -> None:
    own, other = RunState(), RunState()
    other.load_state_dict({**own.state_dict(), "figures": {"a": float("inf"), "b": -1.5}})
    assert other.figures == {"a": float("inf"), "b": -1.5}
