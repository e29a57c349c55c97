"""The commands that identify parameters, measure what was identified, and draw from what is known of it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from torch import Tensor

    from physid.configuration import Configuration

KINDS = (".csv", ".npz", ".yaml")


def fit(
    configuration: Configuration,
    recordings: Path | None = None,
    *,
    run_dir: Path | None = None,
    resume: bool = False,
    overwrite: bool = False,
) -> None:
    """Identify the parameters of recorded objects.

    Of recordings alone, the scene says what is unknown. A configuration names a model, its data and the trainer.
    Everything about the run lands in runs/NAME: the resolved configuration, metrics.csv with the history, metrics.json
    with the final figures, plots and checkpoints. What the fit leaves is compared with the noise of the poses.
    Ctrl-C leaves a state from which the same command with --resume goes on exactly; RUN/config.yaml repeats a run.

    Examples:
      physid fit data/mine
      physid fit data/mine model.learn=[block.mass] --run-dir runs/mass
      physid fit --config configs/sysid/push_friction.yaml
      physid fit --config configs/sysid/push_friction.yaml --run-dir runs/try trainer.max_epochs=3
      physid fit --run-dir runs/try --resume

    Args:
        configuration: What to fit, to which recordings.
        recordings: Folder of the recording set, instead of the configuration's.
        run_dir: Folder of the run; runs/NAME by default.
        resume: Go on from the last checkpoint of the run.
        overwrite: Delete an earlier run, with all that is in its folder, once the one in its place has a checkpoint.
    """
    from physid.commands.terminal.summary import summarize
    from physid.runs import first_process, open_folder
    from physid.schema.check import check_fit
    from physid.training.runs import run

    if resume and overwrite:
        raise ValueError("fit: expected --resume or --overwrite, found both; an earlier run goes on, or is deleted")
    check_fit(configuration)
    with open_folder(configuration, run_dir, resume=resume, overwrite=overwrite) as folder:
        figures = run.fit(configuration.values, folder, resume=resume, allowed=configuration.allowed)
    if first_process():
        print(summarize(figures, folder, configuration.recordings))


def validate(
    configuration: Configuration,
    recordings: Path | None = None,
    *,
    run_dir: Path | None = None,
    checkpoint: Path | None = None,
) -> None:
    """Measure a fitted model on the trajectories that are kept to choose between models (splits val and select).

    Whoever chooses settings or models by these errors needs others to report: those of `physid test`.

    Examples:
      physid validate --run-dir runs/cube_tosses

    Args:
        configuration: As for fit; RUN/config.yaml by default.
        recordings: Folder of the recording set, instead of the run's; without --run-dir, that of its own fit.
        run_dir: Folder of the run; runs/NAME by default.
        checkpoint: Weights to load; the last checkpoint of the run by default.
    """
    _evaluate("validate", configuration, run_dir, checkpoint)


def test(
    configuration: Configuration,
    recordings: Path | None = None,
    *,
    run_dir: Path | None = None,
    checkpoint: Path | None = None,
) -> None:
    """Measure a fitted model on the trajectories that nothing was chosen by (split test), or on others.

    `physid fit` does so by itself at its end where there are any. `physid validate` measures the same on the
    trajectories that models are chosen by. Of other recordings than the run's, none of which names a split, all are
    predicted; data.test=[train] measures on the trajectories that were fitted.

    Examples:
      physid test --run-dir runs/push_friction
      physid test data/others --run-dir runs/mine

    Args:
        configuration: As for fit; RUN/config.yaml by default.
        recordings: Folder of the recording set, instead of the run's; without --run-dir, that of its own fit.
        run_dir: Folder of the run; runs/NAME by default.
        checkpoint: Weights to load; the last checkpoint of the run by default.
    """
    _evaluate("test", configuration, run_dir, checkpoint)


def predict(
    configuration: Configuration,
    recordings: Path | None = None,
    *,
    run_dir: Path | None = None,
    checkpoint: Path | None = None,
    forces: Path | None = None,
    out: Path | None = None,
    overwrite: bool = False,
) -> None:
    """Predict recordings with a fitted model, or the motion under other forces.

    Each trajectory is predicted from its initial state, under the recorded forces or under planned ones. The result is
    a recording set (docs/recordings.md): predicted poses, velocities and forces under the numbers of the trajectories,
    the scene with the identified parameters; and parameters.json. Planned forces are a CSV file, one row for each time
    step, or at any stamps in a column time, with columns such as block.force_x or block.torque_z, in N and N m, or in
    the unit that stands behind, [mN]; or a .npy array (n, bodies, 6). How far a prediction is from what was recorded is
    said by `physid test`.

    Examples:
      physid predict data/mine
      physid predict data/others --run-dir runs/mine --out runs/others
      physid predict --run-dir runs/push_friction --forces planned.csv --out runs/planned

    Args:
        configuration: As for fit; RUN/config.yaml by default.
        recordings: Folder of the recording set, instead of the run's; without --run-dir, that of its own fit.
        run_dir: Folder of the run; runs/NAME by default.
        checkpoint: Weights to load; the last checkpoint of the run by default.
        forces: File with planned forces, from the first frame on.
        out: Folder of the result; RUN/predictions by default.
        overwrite: Delete an earlier result in that folder.
    """
    from physid.runs import fill_folder, folder_of, refuse_links
    from physid.schema.check import check_fit
    from physid.training.callbacks.predictions import PARAMETERS, Predictions
    from physid.training.runs import run

    check_fit(configuration)
    if forces is not None:
        data = configuration.values["data"]
        data["init_args"] = {**(data.get("init_args") or {}), "forces": str(forces)}
    folder, writer = folder_of(configuration, run_dir), Predictions()
    if out is None:
        refuse_links(folder)
    target = out or folder / "predictions"
    sources = [configuration.recordings]
    with fill_folder(target, marked_by=PARAMETERS, overwrite=overwrite, recordings=sources) as place:
        values, allowed = configuration.values, configuration.allowed
        run.evaluate("predict", values, folder, checkpoint, callbacks=[writer], out=place, allowed=allowed)
    print(f"{target}: {writer.written} of {writer.total} trajectories predicted")
    for line in writer.guesses():
        print(f"  {line}")


def _evaluate(
    stage: Literal["validate", "test"], configuration: Configuration, run_dir: Path | None, checkpoint: Path | None
) -> None:
    """Run one evaluation stage and print its figures."""
    from physid.commands.terminal.summary import summarize
    from physid.runs import folder_of, refuse_links
    from physid.schema.check import check_fit
    from physid.training.runs import run

    check_fit(configuration)
    folder = folder_of(configuration, run_dir)
    refuse_links(folder)  # callbacks of the configuration may write there
    figures = run.evaluate(stage, configuration.values, folder, checkpoint, allowed=configuration.allowed)
    print(summarize(figures, folder))


def sample(run: Path, *, count: int = 100, out: Path | None = None, seed: int = 0) -> None:
    """Draw sets of parameters from what a fit knows of them, for domain randomisation.

    A fit leaves RUN/posterior.json: its estimates, their covariance, units and ranges. Each draw is one world that the
    recordings allow: parameters that the fit knows only together vary together, as a heavier block with less
    friction. Logarithms of masses and friction, and sizes of effects, are drawn from a normal distribution; what lies
    beyond a physical range is drawn again. The result is plain numbers in SI units, one row for each world, for any
    simulator. Intervals allow for the noise and for what differs between trajectories; a model that leaves more than
    noise of the recordings (`physid fit` says so) is not made right by randomisation: diagnose it first.

    Examples:
      physid sample runs/mine
      physid sample runs/mine --count 1000 --seed 7 --out worlds.npz

    Args:
        run: Folder of a fit that has come to its end.
        count: How many sets.
        out: File of the result, .csv, .npz or .yaml; RUN/samples.csv by default. It replaces earlier sets of the same
            parameters, and nothing else.
        seed: Of the draws; the same seed gives the same sets.
    """
    from physid.data.files import require_ending
    from physid.runs import refuse_links
    from physid.training.parameters import read_posterior

    target = out or (run if run.is_dir() else run.parent) / "samples.csv"
    require_ending(target, *KINDS)
    if out is None and run.is_dir():
        refuse_links(run)
    known = read_posterior(run)
    drawn = known.sample(count, seed)
    write_samples(target, known.names, drawn)
    print(f"{target}: {count} set{'s' * (count != 1)} of {len(known.names)} parameter{'s' * (len(known.names) != 1)}")
    for one, mean, spread in zip(known.space.unknowns, drawn.mean(0), drawn.std(0, correction=0), strict=True):
        print(f"  {one.name}: mean {float(mean):.6g}, deviation {float(spread):.2g}{f' {one.unit}' * bool(one.unit)}")


def write_samples(path: Path, names: tuple[str, ...], drawn: Tensor) -> None:
    """Write sets of parameters (count, P), whole or not at all: a table, an array for each name, or a list.

    Raises:
        FileExistsError: If there is a file of that name that does not hold sets of the same parameters.
    """
    import csv
    import io

    import numpy as np
    import yaml

    from physid.data.files import write_text, write_whole
    from physid.training.parameters import holds_samples

    if path.exists() and not holds_samples(path, names):
        raise FileExistsError(
            f"{path}: expected no such file, or earlier sets of the same parameters, found something else; delete it, "
            "or choose another --out"
        )
    if path.suffix.lower() == ".npz":
        columns = dict(zip(names, drawn.T.numpy(), strict=True))

        def save(part: Path) -> None:
            with part.open("wb") as file:
                np.savez(file, **columns)

        write_whole(path, save)
    elif path.suffix.lower() == ".yaml":
        worlds = [dict(zip(names, row, strict=True)) for row in drawn.tolist()]
        write_text(path, yaml.safe_dump(worlds, sort_keys=False))
    else:
        table = io.StringIO()
        writer = csv.writer(table, lineterminator="\n")
        writer.writerow(names)
        writer.writerows(drawn.tolist())
        write_text(path, table.getvalue())
