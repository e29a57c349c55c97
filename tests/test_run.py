"""Runs of the Trainer in a folder: with a model that draws random numbers, so that only an exact resume is equal."""

from __future__ import annotations

import csv
import json
import os
import signal
import time
from collections.abc import Callable
from multiprocessing import Pipe
from pathlib import Path
from typing import Any

import lightning as L
import pytest
import torch
from torch import Tensor
from torch.utils.data import DataLoader, Dataset, TensorDataset

from physid import cli
from physid.one_writer import one_writer
from physid.training.callbacks import progress


class Noisy(L.LightningModule):
    """A regression with dropout; `interrupt_in` presses Ctrl-C in that epoch, `fail` raises a message for the user."""

    def __init__(
        self,
        rate: float = 0.1,
        interrupt_in: int | None = None,
        fail: bool = False,
        stop_in: int | None = None,
        terminate: bool = False,
    ) -> None:
        super().__init__()
        self.net = torch.nn.Sequential(torch.nn.Dropout(0.5), torch.nn.Linear(3, 1))
        self.rate, self.interrupt_in, self.stop_in, self.terminate = rate, interrupt_in, stop_in, terminate
        if fail:
            raise ValueError("fail must be false, got true")

    def training_step(self, batch: list[Tensor], batch_idx: int) -> Tensor:
        if self.interrupt_in == self.current_epoch and batch_idx == 1:
            os.kill(os.getpid(), signal.SIGINT)
        loss: Tensor = (self.net(batch[0]) - batch[0].sum(-1, keepdim=True)).square().mean()
        self.log("train/loss", loss, on_step=False, on_epoch=True)
        self.log("params/block.friction/estimate", self.net[1].weight.sum())
        self.log("params/block.friction/true", 3.0)
        return loss

    def on_train_epoch_end(self) -> None:
        self.log("epochs", self.current_epoch + 1.0)
        self.trainer.should_stop |= self.stop_in == self.current_epoch

    def test_step(self, batch: list[Tensor], batch_idx: int) -> None:
        if self.terminate:
            os.kill(os.getpid(), signal.SIGTERM)
            time.sleep(5)
            pytest.fail("SIGTERM was not looked for")
        self.log("test/position_error", (self.net(batch[0]) - 1).abs().mean())

    validation_step = test_step

    def configure_optimizers(self) -> torch.optim.Optimizer:
        return torch.optim.Adam(self.parameters(), self.rate)


class Harmful(Dataset[Tensor]):
    """Points; the process that reads the third is killed, as the system does where memory is short, or fails."""

    def __init__(self, harm: str) -> None:
        self.harm = harm

    def __len__(self) -> int:
        return 4

    def __getitem__(self, number: int) -> Tensor:
        if number == 2 and self.harm == "kill":
            signal.raise_signal(signal.SIGKILL)
        if number == 2:
            raise RuntimeError("a mistake in the code")
        return torch.ones(3)


class Last:
    """What a loader hands over as its last: as it is read, the process that made it is gone."""

    def __reduce__(self) -> Any:
        return gone, ()


def gone() -> None:
    """End as torch's way of sharing tensors does when the other end is gone."""
    first, second = Pipe()
    second.close()
    first.recv()


class Points(L.LightningDataModule):
    """Twelve points, shuffled."""

    def __init__(self, harm: str = "") -> None:
        super().__init__()
        self.harm = harm

    def train_dataloader(self) -> DataLoader[Any]:
        if self.harm:
            collate = (lambda _: Last()) if self.harm == "cut off" else None
            return DataLoader(Harmful(self.harm), num_workers=1, collate_fn=collate)
        return DataLoader(TensorDataset(torch.arange(36.0).reshape(12, 3) / 36), batch_size=4, shuffle=True)

    def test_dataloader(self) -> DataLoader[Any]:
        return DataLoader(TensorDataset(torch.ones(4, 3)))

    val_dataloader = test_dataloader


def main(words: list[str]) -> int:
    """Run a command whose configuration may name the classes of this file."""
    return cli.main([*words, f"--allow={__name__}"])


@pytest.fixture
def config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "noisy.yaml"
    path.write_text(
        f"seed_everything: 3\nmodel: {{class_path: {__name__}.Noisy}}\ndata: {{class_path: {__name__}.Points}}\n"
        "trainer: {max_epochs: 4, accelerator: cpu}\n"
    )
    return str(path)


def history(folder: Path) -> list[dict[str, str]]:
    with (folder / "metrics.csv").open() as file:
        return list(csv.DictReader(file))


def figures(folder: Path) -> dict[str, float]:
    read: dict[str, float] = json.loads((folder / "metrics.json").read_text())
    del read["seconds"]
    return read


def test_a_fit_leaves_its_configuration_history_figures_and_checkpoint(
    config: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["fit", "--config", config]) == 0
    folder = Path("runs/noisy")
    assert {"config.yaml", "metrics.csv", "metrics.json"} <= {path.name for path in folder.iterdir()}
    assert (folder / "checkpoints" / "last.ckpt").exists()
    assert {"train/loss", "params/block.friction/estimate", "test/position_error"} <= figures(folder).keys()
    assert len(history(folder)) >= 4
    assert figures(folder)["lr/0"] == pytest.approx(0.1)
    printed = capsys.readouterr().out
    assert "block.friction" in printed
    assert "true 3" in printed


def test_the_written_configuration_repeats_the_run(config: str) -> None:
    assert main(["fit", "--config", config, "model.rate=0.05"]) == 0
    assert main(["fit", "--config", "runs/noisy/config.yaml", "--run-dir", "runs/again"]) == 0
    assert figures(Path("runs/again")) == figures(Path("runs/noisy"))


def test_an_interrupted_run_goes_on_exactly_where_it_stopped(config: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["fit", "--config", config, "--run-dir=runs/whole"]) == 0
    halves = ["fit", "--config", config, "--run-dir=runs/halves"]
    assert main([*halves, "model.interrupt_in=2"]) == 130
    message = capsys.readouterr().err.strip()
    assert message.splitlines()[-1].startswith("interrupted: in epoch 2")
    assert main([*halves, "--resume"]) == 0
    assert figures(Path("runs/halves")) == figures(Path("runs/whole"))
    assert history(Path("runs/halves")) == history(Path("runs/whole"))


@pytest.mark.parametrize("stop", [2, 3])
def test_what_a_resumed_run_has_done_until_it_is_interrupted_stays(config: str, stop: int) -> None:
    """The inode of a checkpoint that was replaced is free, and that of the next but one may be the same."""
    assert main(["fit", "--config", config, "--run-dir=runs/whole"]) == 0
    parts = ["fit", "--config", config, "--run-dir=runs/parts"]
    assert main([*parts, "model.interrupt_in=1"]) == 130
    assert main([*parts, "--resume", f"model.interrupt_in={stop}"]) == 130
    assert f"interrupt_in: {stop}" in Path("runs/parts/config.yaml").read_text()
    assert {row["epoch"] for row in history(Path("runs/parts"))} >= {str(epoch) for epoch in range(stop)}
    assert main([*parts, "--resume"]) == 0
    assert history(Path("runs/parts")) == history(Path("runs/whole"))


def test_the_bar_says_how_long_all_epochs_still_take(
    config: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    seconds, said = [0.0], list[tuple[float, float]]()
    step, left = Noisy.training_step, progress.Progress.left

    def timed(self: Noisy, *words: Any) -> Tensor:
        seconds[0] += 1.0 if self.current_epoch else 10.0  # the first epoch also finds first values
        return step(self, *words)

    def noted(self: progress.Progress, trainer: L.Trainer) -> float | None:
        if (value := left(self, trainer)) is not None:
            said.append((seconds[0], value))
        return value

    monkeypatch.setattr(progress, "clock", lambda: seconds[0])
    monkeypatch.setattr(Noisy, "training_step", timed)
    monkeypatch.setattr(progress.Progress, "left", noted)
    assert main(["fit", "--config", config, "trainer.enable_progress_bar=true"]) == 0
    assert {time for time, _ in said} == set(range(33, 40))  # three steps an epoch; nothing is said before two are done
    assert all(value == pytest.approx(39.0 - time) for time, value in said)
    assert "left: ≤0:00:0" in capsys.readouterr().out


# torch raises from the handler of the signal of a killed child, and that may strike within any object's end.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("harm", ["kill", "cut off"])
def test_a_loader_that_is_killed_is_named_with_the_remedy(
    config: str, harm: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["fit", "--config", config, f"data.harm={harm}"]) == 1
    message = capsys.readouterr().err.strip()
    assert len(message.splitlines()) == 1
    assert "with --resume goes on, with fewer data.workers" in message


def test_an_error_of_the_code_in_a_loader_is_not_taken_for_a_killed_one(config: str) -> None:
    with pytest.raises(RuntimeError, match="a mistake in the code"):
        main(["fit", "--config", config, "data.harm=fail"])


@pytest.mark.slow
def test_a_run_that_is_resumed_for_fewer_epochs_than_it_has_is_refused_in_one_line(
    config: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["fit", "--config", config]) == 0
    capsys.readouterr()
    assert main(["fit", "--config", config, "--resume", "trainer.max_epochs=2"]) == 2
    error = capsys.readouterr().err.strip().splitlines()[-1]
    assert error.startswith("physid: trainer: You restored a checkpoint with current_epoch=3")


@pytest.mark.slow
def test_a_run_of_another_version_is_refused_in_one_line_and_its_checkpoint_stays(
    config: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["fit", "--config", config, "--run-dir=runs/old"]) == 0
    path = Path("runs/old/checkpoints/last.ckpt")
    state = torch.load(path, weights_only=True)
    state["state_dict"].popitem()
    torch.save(state, path)
    before = path.read_bytes()
    capsys.readouterr()
    assert main(["fit", "--config", config, "--run-dir=runs/old", "--resume", "trainer.max_epochs=9"]) == 2
    error = capsys.readouterr().err.strip().splitlines()[-1]
    assert error.startswith("physid: ")
    assert "last.ckpt: expected a checkpoint of this version of physid" in error
    assert path.read_bytes() == before


@pytest.mark.slow
def test_the_bar_counts_epochs_and_leaves_out_what_tells_nothing(
    config: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["fit", "--config", config, "trainer.enable_progress_bar=true"]) == 0
    shown = capsys.readouterr().out
    assert "Epoch 3/3" in shown
    assert "v_num" not in shown


@pytest.mark.slow
def test_a_run_interrupted_before_its_first_checkpoint_starts_again(config: str) -> None:
    assert main(["fit", "--config", config, "model.interrupt_in=0"]) == 130
    assert main(["fit", "--config", config, "--resume"]) == 0


@pytest.mark.slow
def test_an_earlier_run_is_neither_overwritten_nor_mixed_unless_asked(
    config: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["fit", "--config", config, "trainer.max_epochs=1"]) == 0
    before = figures(Path("runs/noisy"))
    assert main(["fit", "--config", config, "trainer.max_epochs=2"]) == 2
    assert "--resume" in capsys.readouterr().err
    assert figures(Path("runs/noisy")) == before
    assert main(["fit", "--config", config, "trainer.max_epochs=2", "--overwrite"]) == 0
    assert figures(Path("runs/noisy")) != before


@pytest.mark.slow
def test_test_and_validate_measure_the_checkpoint_of_a_run(config: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["fit", "--config", config]) == 0
    expected = f"{100 * figures(Path('runs/noisy'))['test/position_error']:.2f} % of the size"
    for stage in ("test", "validate"):
        capsys.readouterr()
        assert main([stage, "--run-dir", "runs/noisy"]) == 0
        assert expected in capsys.readouterr().out


@pytest.mark.slow
def test_wandb_is_offline_unless_asked(config: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("WANDB_MODE")
    assert main(["fit", "--config", config, "trainer.max_epochs=1"]) == 0
    assert list(Path("runs/noisy/wandb").glob("offline-run-*"))


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["model.rat=1"], 'command line: unknown key "model.rat"; did you mean "rate"?'),
        (["model.rate=abc"], "model.rate: expected float, got abc"),
        (["trainer.max_epoch=1"], 'command line: unknown key "trainer.max_epoch"; did you mean "max_epochs"?'),
        (["trainer.max_epochs=x"], "trainer.max_epochs: expected int or null, got x"),
        (["trainer.max_time=00:00:01:2"], "trainer: `Timer(duration='00:00:01:2')` is not a valid duration"),
        (["trainer.devices=abc"], "trainer: `devices` selected with `CPUAccelerator` should be an int > 0"),
        (["trainer.strategy=nope"], "trainer: You selected an invalid strategy name"),
        (["modl.rate=1"], 'command line: unknown key "modl"; did you mean "model"?'),
        (["model.fail=true"], "fail must be false, got true"),
        (["wandb=sometimes"], "wandb must be one of offline, online, disabled, got 'sometimes'"),
        (["--resum"], '--resum: no such option, or its value is missing; did you mean "--resume"?'),
    ],
)
def test_a_mistake_ends_in_one_line_and_exit_code_2(
    config: str, words: list[str], message: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    if words[0].startswith("wandb"):
        monkeypatch.delenv("WANDB_MODE")
    assert main(["fit", "--config", config, *words]) == 2
    error = capsys.readouterr().err.strip()
    assert error.startswith(f"physid: {message}")
    assert len(error.splitlines()) == 1


def test_without_a_checkpoint_there_is_nothing_to_test(config: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["test", "--config", config]) == 2
    assert "run `physid fit` first" in capsys.readouterr().err


def test_a_run_that_had_stopped_by_itself_is_over_unless_it_is_asked_for_something_else(config: str) -> None:
    words = ["fit", "--config", config, "model.stop_in=1"]
    assert main(words) == 0
    folder = Path("runs/noisy")
    before, rows = figures(folder), history(folder)
    assert before["epochs"] == 2
    assert main([*words, "--resume"]) == 0
    assert figures(folder) == before
    assert history(folder) == rows
    assert main([*words, "--resume", "model.stop_in=null"]) == 0
    assert figures(folder)["epochs"] == 4


def test_a_row_that_the_checkpoint_knows_and_the_history_lacks_is_written(config: str) -> None:
    whole, cut = ["fit", "--config", config, "--run-dir=runs/whole"], ["fit", "--config", config, "--run-dir=runs/cut"]
    assert main(whole) == 0
    assert main([*cut, "trainer.max_epochs=2"]) == 0
    path = Path("runs/cut/metrics.csv")
    lines = path.read_text().splitlines(keepends=True)
    # Killed after the checkpoint of epoch 1, while its row was being written.
    path.write_text("".join(lines[:-2]) + lines[-2][:7])
    assert main([*cut, "--resume"]) == 0
    assert history(Path("runs/cut"))[-2:] == history(Path("runs/whole"))[-2:]
    assert [row["epochs"] for row in history(Path("runs/cut")) if row["epochs"]] == ["1.0", "2.0", "3.0", "4.0"]


@pytest.mark.parametrize("name", ["record.json", "config.yaml", "checkpoints/last.ckpt"])
@pytest.mark.parametrize("content", ["", "{", "\x00"])
def test_a_damaged_file_of_a_run_is_named(
    config: str, name: str, content: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["fit", "--config", config, "trainer.max_epochs=1"]) == 0
    (Path("runs/noisy") / name).write_text(content)
    capsys.readouterr()
    assert main(["fit", "--run-dir", "runs/noisy", "--resume"]) == 2
    error = capsys.readouterr().err.strip().splitlines()[-1]
    assert error.startswith("physid: ")
    assert Path(name).name in error or "runs/noisy" in error


def test_a_second_fit_in_a_folder_is_refused_and_harms_nothing(config: str, capsys: pytest.CaptureFixture[str]) -> None:
    with one_writer(Path("runs/noisy")):
        assert main(["fit", "--config", config]) == 2
    assert "runs/noisy is being written by process" in capsys.readouterr().err
    assert not (Path("runs/noisy") / "config.yaml").exists()


def test_a_run_with_a_link_or_a_pipe_in_it_is_not_written_to(config: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["fit", "--config", config, "trainer.max_epochs=1"]) == 0
    run, home = Path("runs/noisy"), Path("home")
    home.mkdir()
    (home / "mine").write_text("precious")
    run.joinpath("checkpoints").rename(home / "checkpoints")
    kept = {path: path.read_bytes() for path in home.rglob("*") if path.is_file()}
    stands: dict[str, Callable[[Path], None]] = {
        "config.yaml.part": lambda path: path.symlink_to(home.resolve() / "mine"),
        "hparams.yaml": lambda path: path.symlink_to(home.resolve() / "mine"),
        "metrics.json.part": os.mkfifo,
        "predictions.part": lambda path: path.symlink_to(home.resolve()),
        "checkpoints": lambda path: path.symlink_to(home.resolve() / "checkpoints"),
    }
    commands = (
        ["fit", "--resume", "trainer.max_epochs=2"],
        ["fit", "--overwrite"],
        ["test"],
        ["validate"],
        ["predict"],
    )
    for name, stand in stands.items():
        (run / name).unlink(missing_ok=True)
        stand(run / name)
        for words in commands if name == "checkpoints" else commands[:1]:
            capsys.readouterr()
            assert main([*words, "--run-dir", str(run)]) == 2
            (line,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("physid: ")]
            assert f"{name}: expected nothing but files and folders where physid writes, found a" in line
        (run / name).unlink()
    assert {path: path.read_bytes() for path in home.rglob("*") if path.is_file()} == kept


@pytest.mark.parametrize("stage", ["test", "validate"])
def test_sigterm_ends_an_evaluation_at_once(config: str, stage: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["fit", "--config", config]) == 0
    before = signal.getsignal(signal.SIGTERM)
    capsys.readouterr()
    assert main([stage, "--run-dir", "runs/noisy", "model.terminate=true"]) == 143
    assert capsys.readouterr().err.strip().startswith("terminated")
    assert signal.getsignal(signal.SIGTERM) == before


def test_a_class_of_an_unknown_package_is_refused_before_it_is_imported(
    config: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["fit", "--config", config]) == 2
    assert f"--allow {__name__}" in capsys.readouterr().err
