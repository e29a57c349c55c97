"""Real tosses of a cube beside what simulators have been published to reach on them."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import final

from physid.reproduce.cells import PERCENT, Cell, Recordings
from physid.reproduce.results import Result

VARIABLE = "PHYSID_CUBE_TOSSES"
"""Names the folder with the tosses."""
SOURCE = "assets/contactnets_cube of github.com/DAIRLab/dair_pll"
PUBLISHED = {"position": 13.5, "rotation": 16.5}
"""Drake's and Bullet's best, time means [% of the edge, deg]; quoted by third parties, probably in sample."""
OTHERS = {
    "": "",
    "bullet_": ", PyBullet with the same parameters",
    "ballistic_": ", flight frozen at touch-down",
    "held_": ", initial pose held",
}


@final
@dataclass(frozen=True)
class Tosses(Cell):
    """Friction and restitution of a real cube, and the tosses held out, predicted from their first frame to the end.

    Attributes:
        name: real/cube_tosses; the configuration is configs/sysid/cube_tosses.yaml.
        minutes: See `Cell`.
    """

    name: str = "real/cube_tosses"
    recordings: Recordings | None = None
    minutes: float = 1.0

    def absent(self) -> str | None:
        """Say where to get the tosses, if there are none."""
        if any(_folder().glob("*.pt")):
            return None
        return f"no tosses in {_folder()}: get {SOURCE}, and set {VARIABLE} to its folder"

    def run(self, configs: Path, data: Path, folder: Path) -> list[Result]:
        """Import, fit, test and compare (see `Cell.run`)."""
        from physid.configuration import compose
        from physid.data.importers.cube_tosses import import_cube_tosses
        from physid.runs import open_folder
        from physid.training.runs.run import fit

        imported = data / "cube"
        import_cube_tosses(_folder(), imported)
        configuration = compose([str(configs / "sysid" / "cube_tosses.yaml")], [f"data.folder={imported}"])
        with open_folder(configuration, folder, resume=True):
            return self.results(fit(configuration.values, folder, resume=True))

    def results(self, figures: Mapping[str, float]) -> list[Result]:
        """Select what is compared from the figures of a run."""
        found = [
            Result(self.name, f"cube.{name}{words}", figures[f"params/cube.{name}/{key}"], "-")
            for name in ("friction", "restitution")
            for key, words in (("estimate", ""), ("low", ", 90 % interval from"), ("high", ", 90 % interval to"))
            if f"params/cube.{name}/{key}" in figures
        ]
        for kind, unit, scale in (("position", "% of edge", PERCENT), ("rotation", "deg", 1.0)):
            for prefix, words in OTHERS.items():
                paper = None if prefix else PUBLISHED[kind]
                value = scale * figures[f"test/{prefix}{kind}_error"]
                found.append(Result(self.name, f"{kind} error, held out{words}", value, unit, paper))
            deviation = scale * figures[f"test/{kind}_error_deviation"]
            found.append(Result(self.name, f"{kind} error, deviation over tosses", deviation, unit))
        return [*found, Result(self.name, "time", figures["seconds"], "s")]


def _folder() -> Path:
    return Path(os.environ.get(VARIABLE, "data/contactnets_cube"))
