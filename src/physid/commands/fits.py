"""The commands that identify parameters and measure what was identified."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from physid.configuration import Configuration


def fit(
    configuration: Configuration, *, run_dir: Path | None = None, resume: bool = False, overwrite: bool = False
) -> None:
    """Identify the parameters of recorded objects.

    The configuration names a model, its data and the trainer. Everything about the run lands in runs/NAME: the
    resolved configuration, metrics.csv with the history, metrics.json with the final figures, plots and checkpoints.
    Ctrl-C leaves a state from which the same command with --resume goes on exactly; RUN/config.yaml repeats a run.

    Examples:
      physid fit --config configs/sysid/push_friction.yaml
      physid fit --config configs/sysid/push_friction.yaml --run-dir runs/try trainer.max_epochs=3
      physid fit --run-dir runs/try --resume

    Args:
        configuration: What to fit, to which recordings.
        run_dir: Folder of the run; runs/NAME by default.
        resume: Go on from the last checkpoint of the run.
        overwrite: Delete what an earlier run left in the folder.
    """
    from physid.runs import first_process, open_folder, summarize
    from physid.schema import check_keys
    from physid.training import run

    check_keys(configuration, run.GROUPS)
    folder = open_folder(configuration, run_dir, resume=resume, overwrite=overwrite)
    figures = run.fit(configuration.values, folder, resume=resume)
    if first_process():
        print(summarize(figures, folder))


def validate(configuration: Configuration, *, run_dir: Path | None = None, checkpoint: Path | None = None) -> None:
    """Measure a fitted model on the validation split of its recordings.

    Examples:
      physid validate --run-dir runs/push_friction

    Args:
        configuration: As for fit; RUN/config.yaml by default.
        run_dir: Folder of the run; runs/NAME by default.
        checkpoint: Weights to load; the last checkpoint of the run by default.
    """
    _evaluate("validate", configuration, run_dir, checkpoint)


def test(configuration: Configuration, *, run_dir: Path | None = None, checkpoint: Path | None = None) -> None:
    """Measure a fitted model on recordings that the fit has not seen.

    Examples:
      physid test --run-dir runs/push_friction
      physid test --run-dir runs/push_friction data.folder=data/push_rich

    Args:
        configuration: As for fit; RUN/config.yaml by default.
        run_dir: Folder of the run; runs/NAME by default.
        checkpoint: Weights to load; the last checkpoint of the run by default.
    """
    _evaluate("test", configuration, run_dir, checkpoint)


def _evaluate(
    stage: Literal["validate", "test"], configuration: Configuration, run_dir: Path | None, checkpoint: Path | None
) -> None:
    """Run one evaluation stage and print its figures."""
    from physid.runs import folder_of, summarize
    from physid.schema import check_keys
    from physid.training import run

    check_keys(configuration, run.GROUPS)
    folder = folder_of(configuration, run_dir)
    print(summarize(run.evaluate(stage, configuration.values, folder, checkpoint), folder))
