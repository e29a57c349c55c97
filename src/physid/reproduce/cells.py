"""The cells: which experiment each is, what it must reach, and what the paper reached."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, final

from physid.estimation.measurement.unexplained import unexplained_kinds
from physid.estimation.prediction.coordinates import Unknown, logged_names
from physid.reproduce.results import RESULTS, Result, over_seeds, read_results, write_results
from physid.yaml_files import read_text

if TYPE_CHECKING:
    from physid.configuration import Configuration

PERCENT = 100.0
DEGREES = (1.0, "deg")
LEFT = "fit/position_share"
ENCODED, TURNED = "test/encoded_position_error", "test/encoded_rotation_error"
GENTLE_RATE = 1e-4
"""Of learning, of an encoder that has been learned."""


@dataclass(frozen=True)
class Recordings:
    """A recording set that cells share.

    Attributes:
        name: The file of configs/generate.
        trajectories: How many.
        video: Whether it has frames.
    """

    name: str
    trajectories: int
    video: bool = False

    @property
    def folder(self) -> str:
        """The name of its folder: one set with frames and one without may be there."""
        return f"{self.name}_film" if self.video else self.name


class Cell(ABC):
    """One experiment of a profile.

    Attributes:
        name: What it is called, and its folder.
        recordings: What it is made with, if anything.
        minutes: About how long it takes on one core; the ratios between cells give the remaining time.
    """

    name: str
    recordings: Recordings | None
    minutes: float

    def absent(self) -> str | None:
        """Say what is missing that this project cannot make, and where to get it; None if nothing is."""
        return None

    def finished(self, folder: Path) -> bool:
        """Return whether its results are in its folder."""
        return (folder / RESULTS).exists()

    @abstractmethod
    def run(self, configs: Path, data: Path, folder: Path) -> list[Result]:
        """Run the experiment.

        Args:
            configs: The folder configs/ of the repository.
            data: Folder of the recording set.
            folder: Where the run goes.

        Returns:
            What it measured.
        """


@final
@dataclass(frozen=True)
class Fit(Cell):
    """A `physid fit` whose figures are compared.

    Attributes:
        name: METHOD/CELL.
        recordings: What it is fitted to.
        file: METHOD/FILE if the configuration is not configs/METHOD/CELL.yaml.
        parameter: Largest relative error of a parameter [%].
        position: Largest position error relative to the size of the object [%]; of films, that of refined poses.
        rotation: Largest rotation error [degrees]; of films likewise.
        by_gradient: Largest relative error of a parameter that the gradient of a video's losses alone has found [%].
        encoder_position: Largest position error of the encoder itself [%].
        encoder_rotation: Largest rotation error of the encoder itself [degrees].
        evaluations: Most evaluations.
        paper_position: The paper's position error [%]; of films, that of its encoder.
        paper_rotation: The paper's rotation error [degrees]; of films likewise.
        overrides: Further settings, key=value.
        minutes: See `Cell`.
        seeds: How many runs with seeds 0, 1, ... there are; each has a folder of its own if they are several.
        encoder: A cell with the same recordings and method, whose encoder this one takes over if it was run before.
    """

    name: str
    recordings: Recordings
    file: str | None = None
    parameter: float | None = None
    position: float | None = None
    rotation: float | None = None
    by_gradient: float | None = None
    encoder_position: float | None = None
    encoder_rotation: float | None = None
    evaluations: float | None = None
    paper_position: float | None = None
    paper_rotation: float | None = None
    overrides: tuple[str, ...] = ()
    minutes: float = 0.05
    seeds: int = 1
    encoder: str | None = None

    @property
    def configuration(self) -> str:
        """The path of the configuration within configs/."""
        return f"{self.file or self.name}.yaml"

    def finished(self, folder: Path) -> bool:
        """Return whether its results are there, and those of every seed that is wanted: fewer may have been run."""
        seeds = range(self.seeds if self.seeds > 1 else 0)
        return super().finished(folder) and all((folder / f"seed_{n}" / RESULTS).exists() for n in seeds)

    def run(self, configs: Path, data: Path, folder: Path) -> list[Result]:
        """Fit, test and compare (see `Cell.run`)."""
        if self.seeds == 1:
            return self._run(configs, data, folder)
        return over_seeds([self._seed(configs, data, folder / f"seed_{n}", n) for n in range(self.seeds)])

    def _seed(self, configs: Path, data: Path, folder: Path, seed: int) -> list[Result]:
        """Return the results of one seed, which are kept beside its run: a finished seed is not tested again."""
        kept = folder / RESULTS
        if not kept.exists():
            write_results(kept, self._run(configs, data, folder, f"seed_everything={seed}"))
        return read_results(kept)

    def _run(self, configs: Path, data: Path, folder: Path, *settings: str) -> list[Result]:
        """Carry out one fit; one that was interrupted goes on."""
        from physid.configuration import compose
        from physid.runs import open_folder
        from physid.training.runs.run import fit

        overrides = [f"data.folder={data}", *self.overrides, *settings]
        configuration = compose([str(configs / self.configuration)], overrides)
        donor = self.encoder and Path(str(folder).replace(self.name, self.encoder))
        if donor and _may_take(folder, donor):
            configuration = compose([str(configs / self.configuration)], [*overrides, *_taking(configuration, donor)])
        with open_folder(configuration, folder, resume=True):
            return self.results(fit(configuration.values, folder, resume=True))

    def results(self, figures: Mapping[str, float]) -> list[Result]:
        """Select what is compared from the figures of a run.

        The paper's errors of films are those of its encoder, and stand beside ours of that; refined poses, where there
        are any, are a measure of their own.
        """
        found = self._parameters(figures)
        filmed = ENCODED in figures
        refined = filmed and figures[ENCODED] != figures["test/position_error"]
        percent, whole = (PERCENT, "% of size"), None if filmed else self.paper_position
        rows: list[tuple[str, str, tuple[float, str], float | None, float | None]] = [
            (ENCODED, "position error, encoder", percent, self.paper_position, self.encoder_position),
            (TURNED, "rotation error, encoder", DEGREES, self.paper_rotation, self.encoder_rotation),
        ]
        if refined or not filmed:
            name = ", refined" if filmed else ""
            paper = None if filmed else self.paper_rotation
            rows += [
                ("test/position_error", f"position error{name}", percent, whole, self.position),
                ("test/rotation_error", f"rotation error{name}", DEGREES, paper, self.rotation),
            ]
        rows += [
            ("test/whole_position_error", "position error, whole trajectory", percent, whole, None),
            (LEFT, "lack of fit: left of the motion, beyond noise", (PERCENT, "%"), None, None),
            ("test/predicted_position_error", "position error, rolled out", percent, None, None),
            ("test/predicted_rotation_error", "rotation error, rolled out", DEGREES, None, None),
            ("test/psnr", "rolled-out video, PSNR", (1.0, "dB"), None, None),
            ("test/held_psnr", "first frame held, PSNR", (1.0, "dB"), None, None),
            ("test/background_psnr", "background alone, PSNR", (1.0, "dB"), None, None),
            ("test/ssim", "rolled-out video, SSIM", (1.0, "-"), None, None),
            ("evaluations", "evaluations", (1.0, ""), None, self.evaluations),
            ("seconds", "time", (1.0, "s"), None, None),
        ]
        for key, metric, (scale, unit), paper, target in rows:
            if key in figures and not (key == LEFT and "position" not in unexplained_kinds(figures)):
                found.append(Result(self.name, metric, scale * figures[key], unit, paper, target))
        return found

    def _parameters(self, figures: Mapping[str, float]) -> list[Result]:
        """Return truth, estimate, error and, where there is one, interval of each parameter."""
        found = []
        for name in logged_names(figures, "estimate"):
            for key, metric in (
                ("true", "true value"),
                ("estimate", "estimate"),
                ("low", "90 % interval from"),
                ("high", "90 % interval to"),
            ):
                value = figures.get(f"params/{name}/{key}")
                if value is not None:
                    found.append(Result(self.name, f"{name}, {metric}", value, Unknown.of(name).unit or "-"))
            error = PERCENT * figures[f"params/{name}/relative_error"]
            found.append(Result(self.name, f"{name}, error", error, "%", target=self.parameter))
            descended = figures.get(f"params/{name}/by_gradient_relative_error")
            if descended is not None:
                metric = f"{name}, error by the video's gradient alone"
                found.append(Result(self.name, metric, PERCENT * descended, "%", target=self.by_gradient))
        return found


@final
@dataclass(frozen=True)
class Identifiable(Cell):
    """A `physid identifiability`: whether mass and friction can be told apart.

    Attributes:
        name: identifiability/CELL; the configuration is configs/identifiability/SCENE.yaml.
        scene: Which configuration.
        overrides: Further settings, key=value.
        minutes: See `Cell`.
    """

    name: str
    scene: str
    overrides: tuple[str, ...] = ()
    recordings: Recordings | None = None
    minutes: float = 0.05

    def run(self, configs: Path, data: Path, folder: Path) -> list[Result]:
        """Judge the scene (see `Cell.run`); a deviation that is not finite is a parameter that is not observed."""
        from physid.configuration import compose
        from physid.training.identifiability.planned_experiment import IdentifiabilityConfig, analyse

        file = configs / "identifiability" / f"{self.scene}.yaml"
        configuration = compose([str(file)], self.overrides, reads=IdentifiabilityConfig)
        found = analyse(IdentifiabilityConfig.from_mapping(configuration.values)).result
        results = [
            Result(self.name, f"{verdict.name}: {verdict.kind}, expected deviation", PERCENT * verdict.deviation, "%")
            for verdict in found.verdicts()
        ]
        return [*results, Result(self.name, "condition number", found.condition, "")]


def _may_take(folder: Path, donor: Path) -> bool:
    """Return whether a run takes the encoder of another one: if that is done, unless this one has begun without."""
    begun = folder / "config.yaml"
    return (donor / "metrics.json").exists() and (not begun.exists() or str(donor) in read_text(begun))


def _taking(configuration: Configuration, donor: Path) -> list[str]:
    """Return settings by which a run begins with the encoder of another one instead of warming up its own."""
    from physid.runs import CHECKPOINT

    values = configuration.values
    epochs = values["trainer"]["max_epochs"] - values["model"]["init_args"]["phases"]["warm_up"]
    return [
        f"model.vision.weights={donor / CHECKPOINT}",
        f"model.optimizer.init_args.lr={GENTLE_RATE}",
        "model.phases.warm_up=0",
        f"trainer.max_epochs={epochs}",
    ]
