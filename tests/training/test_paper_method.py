"""The paper's own methods end to end: each configuration fits some films and does what it is named for."""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from physid.cli import main
from physid.configuration import compose
from physid.physics.contact_problem.friction import Pyramid
from physid.training.callbacks.converged import Converged
from physid.training.learners.sysid import SysID
from physid.training.vision.initial_state import Start

CONFIGS = Path(__file__).parent.parent.parent / "configs"
CELLS = sorted(path.stem for path in (CONFIGS / "paper_method").glob("[!_]*.yaml"))
SMALL = [
    "trainer.max_epochs=4",
    "model.phases.warm_up=2",
    "data.batch_size=5",
    "data.draw=1",
    "trainer.accelerator=cpu",
    "wandb=disabled",
]
MOST_SHARE = 0.05  # of the divergence in the loss of images that are compared relative to the empty scene
WEAK = 1e-3  # squares of images blurred by 128 pixels, per pixel, relative to those of the empty scene


@pytest.fixture(scope="module")
def films(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    made = {}
    for scene in ("push", "push_rich", "slide", "collide"):
        made[scene] = tmp_path_factory.mktemp("films") / scene
        config = str(CONFIGS / "generate" / f"{scene}.yaml")
        small = ["trajectories=6", "split={train: 2, test: 1}", "steps=25", "--workers=1", "--quiet"]
        assert main(["generate", "--config", config, *small, f"--out={made[scene]}"]) == 0
    return made


def fitted(cell: str, films: Mapping[str, Path], run: Path, *settings: str) -> dict[str, float]:
    """Fit a cell to a few films and return its figures."""
    config = CONFIGS / "paper_method" / f"{cell}.yaml"
    folder = films[Path(compose([config]).values["data"]["init_args"]["folder"]).name]
    assert main(["fit", "--config", str(config), f"--run-dir={run}", f"data.folder={folder}", *SMALL, *settings]) == 0
    figures: dict[str, float] = json.loads((run / "metrics.json").read_text())
    return figures


@pytest.mark.slow
@pytest.mark.parametrize("cell", CELLS)
def test_a_cell_learns_by_the_papers_losses_alone(cell: str, films: dict[str, Path], tmp_path: Path) -> None:
    figures = fitted(cell, films, tmp_path / "run")
    terms = {key.removeprefix("train/") for key in figures if key.startswith("train/")} - {"loss", "loss_epoch"}
    if cell.startswith("supervised"):
        assert terms == {"encoded_position", "encoded_rotation", "rolled_position", "rolled_rotation"}
    else:
        assert terms == {"encoded_image", "rolled_image", "divergence"}
    for name in {key.split("/")[1] for key in figures if key.endswith("/estimate")}:
        assert figures[f"params/{name}/estimate"] == figures[f"params/{name}/by_gradient_estimate"]
        assert f"params/{name}/low" not in figures, "Gauss and Newton had no part in it"
    assert figures["test/position_error"] == figures["test/encoded_position_error"], "no pose is refined"


@pytest.mark.slow
def test_kernels_go_from_128_to_5_and_the_divergence_stays_a_small_share_of_relative_squares_alone(
    films: dict[str, Path], tmp_path: Path
) -> None:
    shares, values = {}, {}
    for relative in (True, False):
        run = tmp_path / str(relative)
        fitted("self_supervised_push_friction", films, run, f"model.objective.relative={str(relative).lower()}")
        with (run / "metrics.csv").open() as file:
            rows = list(csv.DictReader(file))
        kernels = [float(row["blur/kernel"]) for row in rows if row.get("blur/kernel")]
        assert (kernels[0], kernels[-1]) == (128, 5)
        first = next(row for row in rows if row.get("train/encoded_image"))
        values[relative] = float(first["train/encoded_image"])
        shares[relative] = float(first["train/divergence"]) / values[relative]
    assert values[False] < WEAK * values[True]
    assert shares[True] < MOST_SHARE < 1 < shares[False]


@pytest.mark.slow
def test_velocities_follow_from_three_poses_where_films_start_with_motion(
    films: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    speeds: list[float] = []
    call = Start.__call__

    def noted(self: Start, *what: Any) -> Any:
        state = call(self, *what)
        speeds.append(float(state.twist.detach().abs().max()))
        return state

    monkeypatch.setattr(Start, "__call__", noted)
    fitted("supervised_push_moving", films, tmp_path / "run")
    assert min(speeds) > 0


@pytest.mark.slow
def test_the_pyramid_of_a_configuration_is_what_predicts(films: dict[str, Path], tmp_path: Path) -> None:
    config = str(CONFIGS / "sysid" / "push_friction_pyramid.yaml")
    built: list[SysID] = []
    attach = SysID.attach
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(SysID, "attach", lambda self, scene: (built.append(self), attach(self, scene))[1])
        fit = ["fit", "--config", config, f"--run-dir={tmp_path / 'run'}", f"data.folder={films['push']}"]
        assert main([*fit, "wandb=disabled"]) == 0
    assert isinstance(built[0].layer.world.friction, Pyramid)
    figures = json.loads((tmp_path / "run" / "metrics.json").read_text())
    # Pushes along the axes are where the pyramid is exact.
    assert figures["params/block.friction/relative_error"] < 1e-3


@pytest.mark.slow
def test_whole_trajectories_of_hits_are_predicted_as_well_as_in_the_paper(tmp_path: Path) -> None:
    made, config = tmp_path / "collide", str(CONFIGS / "generate" / "collide.yaml")
    assert main(["generate", "--config", config, "trajectories=18", "video=false", "--quiet", f"--out={made}"]) == 0
    lengths: list[int | None] = []
    grow = Converged._set
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Converged, "_set", lambda self, module: (grow(self, module), lengths.append(module.segment))[0])
        fit = ["fit", "--config", str(CONFIGS / "sysid" / "collide_paper.yaml"), f"data.folder={made}"]
        assert main([*fit, f"--run-dir={tmp_path / 'run'}", "wandb=disabled"]) == 0
    assert lengths == [100, None]
    figures = json.loads((tmp_path / "run" / "metrics.json").read_text())
    assert figures["test/position_error"] < 0.015
    assert not figures["fit/position_explained"], "engines turn bodies differently after a hit, and the fit says so"
