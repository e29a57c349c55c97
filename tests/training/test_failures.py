"""What a configuration chose and that fails is named in one line; defects of physid and of users are not hidden."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import lightning as L
import pytest
from tests.training import regression

from physid import cli
from physid.training.callbacks.kept_findings import KeptFindings
from physid.training.runs.failures import Chosen, explain

CALLBACKS = "lightning.pytorch.callbacks"
BORING = "lightning.pytorch.demos.boring_classes"
ALLOW = f"--allow={regression.__name__}"


def callback(name: str, arguments: str = "") -> str:
    """Return an override that adds a callback of Lightning."""
    return f"trainer.callbacks=[{{class_path: {CALLBACKS}.{name}, init_args: {{{arguments}}}}}]"


# Lightning's profiler of XLA ends before it has begun.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize(
    ("override", "said"),
    [
        (callback("EarlyStopping", "monitor: nope"), "trainer.callbacks.0: EarlyStopping: Early stopping conditioned"),
        (callback("LearningRateFinder"), "trainer.callbacks.0: LearningRateFinder: "),
        (callback("BatchSizeFinder"), "trainer.callbacks.0: BatchSizeFinder: "),
        (callback("LambdaCallback", "on_fit_start: lightning.seed_everything"), "trainer.callbacks.0: LambdaCallback:"),
        (
            callback("LambdaCallback", "on_fit_end: torch.nn.Identity.extra_repr"),
            "trainer.callbacks.0: LambdaCallback:",
        ),
        ("trainer.strategy=xla", "trainer.strategy: XLAStrategy: Requirement"),
        ("trainer.profiler=xla", "trainer.profiler: XLAProfiler: Requirement"),
        ("trainer.precision=transformer-engine", "trainer.precision: TransformerEnginePrecision: Requirement"),
        ("trainer.max_time={days: 99999999999999}", "trainer: expected times that a clock can count, as max_time"),
        ("trainer.accumulate_grad_batches=0", "command line: trainer.accumulate_grad_batches: expected a number above"),
        ("trainer.check_val_every_n_epoch=0", "command line: trainer.check_val_every_n_epoch: expected a number above"),
        ("trainer.val_check_interval=0", "command line: trainer.val_check_interval: expected a number above 0"),
        (
            callback("ModelCheckpoint", "filename: 'x{epoch:>300000000}'"),
            "command line: trainer.callbacks.0.init_args.filename: expected a width of at most 3 digits",
        ),
        (
            callback("ModelCheckpoint", "filename: 'x{epoch:>{step}}'"),
            "command line: trainer.callbacks.0.init_args.filename: expected a width of at most 3 digits",
        ),
        (
            f"data={{class_path: {BORING}.BoringDataModule}}",
            "command line: data.class_path: expected a RecordingsDataModule (of physid.data.batches), or a class that",
        ),
        (
            f"model={{class_path: {BORING}.BoringModel}}",
            "command line: model.class_path: expected a TrainingModule (of physid.training), or a class that",
        ),
    ],
)
def test_a_choice_that_fails_is_named_in_one_line(
    config: str, override: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["fit", config, override, ALLOW]) == 2
    last = capsys.readouterr().err.strip().splitlines()[-1]
    assert last.startswith(f"physid: {said}")


def test_checkpoints_of_a_users_choice_are_written_beside_the_last_one(config: str) -> None:
    name = callback("ModelCheckpoint", "filename: 'a{epoch:02d}', save_top_k: -1")
    assert cli.main(["fit", config, name, ALLOW, "--run-dir=run"]) == 0
    assert {path.name for path in Path("run/checkpoints").iterdir()} == {
        "aepoch=00.ckpt",
        "aepoch=01.ckpt",
        "last.ckpt",
    }


def test_an_error_of_the_users_own_code_shows_where_it_arose(config: str) -> None:
    with pytest.raises(KeyError, match="the user's own"):
        cli.main(["fit", config, "model.harm=true", callback("LearningRateMonitor"), ALLOW])


def test_a_defect_of_physid_shows_where_it_arose(config: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def defect(self: KeptFindings, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        raise AttributeError("a defect")

    monkeypatch.setattr(KeptFindings, "on_train_start", defect)
    with pytest.raises(AttributeError, match="a defect"):
        cli.main(["fit", config, callback("LearningRateMonitor"), ALLOW])


def test_what_torch_says_of_a_model_is_not_taken_for_a_setting() -> None:
    import torch

    def backward() -> None:
        torch.zeros(1).sum().backward()  # type: ignore[no-untyped-call]

    with pytest.raises(RuntimeError) as raised:
        backward()
    assert explain(raised.value, Chosen.of({"trainer": {"strategy": "auto"}})) is None


@pytest.mark.parametrize(
    "error", [MemoryError(), OSError(5, "input"), RuntimeError("Traceback (most recent call last)")]
)
def test_what_says_all_by_itself_is_left_as_it_is(error: Exception) -> None:
    configuration: dict[str, Any] = {"trainer": {"max_epochs": 1}}
    assert explain(error, Chosen.of(configuration), "last.ckpt") is None
