"""The cells: which experiment each is, what it must reach, and what the paper reached."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import final

from physid.reproduce.results import Result

PERCENT = 100.0


@dataclass(frozen=True)
class Recordings:
    """A recording set that cells share.

    Attributes:
        name: Its folder, and the file of configs/generate.
        trajectories: How many.
        video: Whether it has frames.
    """

    name: str
    trajectories: int
    video: bool = False


class Cell(ABC):
    """One experiment of a profile."""

    name: str
    recordings: Recordings | None

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
        name: METHOD/CELL; the configuration is configs/METHOD/CELL.yaml.
        recordings: What it is fitted to.
        parameter: Largest relative error of a parameter [%].
        position: Largest position error relative to the size of the object [%].
        rotation: Largest rotation error [degrees].
        evaluations: Most evaluations.
        paper_position: The paper's position error [%].
        paper_rotation: The paper's rotation error [degrees].
        overrides: Further settings, key=value.
    """

    name: str
    recordings: Recordings
    parameter: float | None = None
    position: float | None = None
    rotation: float | None = None
    evaluations: float | None = None
    paper_position: float | None = None
    paper_rotation: float | None = None
    overrides: tuple[str, ...] = ()

    def run(self, configs: Path, data: Path, folder: Path) -> list[Result]:
        """Fit, test and compare (see `Cell.run`)."""
        from physid.configuration import compose
        from physid.runs import open_folder
        from physid.training.run import fit

        settings = [f"data.folder={data}", *self.overrides]
        configuration = compose([str(configs / f"{self.name}.yaml")], settings)
        open_folder(configuration, folder, resume=True)
        return self.results(fit(configuration.values, folder, resume=True))

    def results(self, figures: Mapping[str, float]) -> list[Result]:
        """Select what is compared from the figures of a run."""
        found = []
        names = sorted({key.split("/")[1] for key in figures if key.endswith("/estimate")})
        for name in names:
            found.append(Result(self.name, f"{name}, true value", figures[f"params/{name}/true"], _unit(name)))
            found.append(Result(self.name, f"{name}, estimate", figures[f"params/{name}/estimate"], _unit(name)))
            error = PERCENT * figures[f"params/{name}/relative_error"]
            found.append(Result(self.name, f"{name}, error", error, "%", target=self.parameter))
        position = PERCENT * figures["test/position_error"]
        found.append(Result(self.name, "position error", position, "% of size", self.paper_position, self.position))
        if "test/whole_position_error" in figures:
            whole = PERCENT * figures["test/whole_position_error"]
            found.append(Result(self.name, "position error, whole trajectory", whole, "% of size", self.paper_position))
        rotation = figures.get("test/rotation_error")
        if rotation is not None:
            found.append(Result(self.name, "rotation error", rotation, "deg", self.paper_rotation, self.rotation))
        if "evaluations" in figures:
            found.append(Result(self.name, "evaluations", figures["evaluations"], "", target=self.evaluations))
        found.append(Result(self.name, "time", figures["seconds"], "s"))
        return found


@final
@dataclass(frozen=True)
class Observe(Cell):
    """A `physid observe`: whether mass and friction can be told apart.

    Attributes:
        name: observe/CELL; the configuration is configs/observe/SCENE.yaml.
        scene: Which configuration.
        overrides: Further settings, key=value.
    """

    name: str
    scene: str
    overrides: tuple[str, ...] = ()
    recordings: Recordings | None = None

    def run(self, configs: Path, data: Path, folder: Path) -> list[Result]:
        """Judge the scene (see `Cell.run`); a deviation that is not finite is a parameter that is not observed."""
        from physid.configuration import compose
        from physid.training.observe import ObserveConfig, observe

        configuration = compose([str(configs / "observe" / f"{self.scene}.yaml")], list(self.overrides))
        found = observe(ObserveConfig.from_mapping(configuration.values)).result
        results = [
            Result(self.name, f"{verdict.name}: {verdict.kind}, expected deviation", PERCENT * verdict.deviation, "%")
            for verdict in found.verdicts()
        ]
        return [*results, Result(self.name, "condition number", found.condition, "")]


def _unit(parameter: str) -> str:
    return "kg" if parameter.endswith(".mass") else "-"


PUSH, SLIDE, COLLIDE = (Recordings(name, 32) for name in ("push", "slide", "collide"))

QUICK: tuple[Cell, ...] = (
    Fit("sysid/push_mass", PUSH, parameter=0.1, position=0.1, evaluations=20, paper_position=0.7),
    Fit("sysid/push_friction", PUSH, parameter=0.1, position=0.1, evaluations=20, paper_position=0.5),
    Fit("sysid/slide_friction", SLIDE, parameter=0.1, position=0.1, evaluations=20, paper_position=0.7),
    Fit("sysid/collide_mass", COLLIDE, parameter=1.0, position=1.0, paper_position=1.2),
    Fit("sysid/collide_friction", COLLIDE, parameter=1.0, position=1.0),
    Fit("sysid/collide_both", COLLIDE, parameter=1.0, position=1.0),
    Fit("sysid/collide_paper", COLLIDE),
    Observe("observe/push", "push"),
    Observe("observe/push_constant_force", "push", ("constant_force=5.5",)),
    Observe("observe/slide", "slide"),
    Observe("observe/collide", "collide"),
)

PROFILES: dict[str, tuple[Cell, ...]] = {"quick": QUICK}
