"""What identification must reach, from PyBullet's recordings and from real ones."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from physid.cli import main

ROOT = Path(__file__).parents[2]
CONFIGS = ROOT / "configs"
TOSSES = Path(os.environ.get("PHYSID_CUBE_TOSSES", ROOT.parent / "shared" / "real" / "cube_tosses"))
ONE_BODY = {"parameter": 1e-3, "position": 1e-3, "evaluations": 20}
TWO_BODIES = {"parameter": 1e-2, "position": 1e-2, "evaluations": 60}

Recorded = Callable[[str], Path]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """Return twenty whole trajectories of a scene."""
    folder = tmp_path_factory.mktemp("recorded")

    def make(scene: str) -> Path:
        made = folder / scene
        if not made.exists():
            some = ["trajectories=20", "video=false", "--workers=1", "--quiet", f"--out={made}"]
            assert main(["generate", "--config", str(CONFIGS / "generate" / f"{scene}.yaml"), *some]) == 0
        return made

    return make


def identify(name: str, data: Path, folder: Path) -> dict[str, float]:
    config = str(CONFIGS / "sysid" / f"{name}.yaml")
    assert main(["fit", "--config", config, f"data.folder={data}", f"--run-dir={folder}"]) == 0
    figures: dict[str, float] = json.loads((folder / "metrics.json").read_text())
    return figures


@pytest.mark.parametrize(
    ("name", "wanted"),
    [
        pytest.param("push_mass", ONE_BODY, marks=pytest.mark.slow),
        pytest.param("push_friction", ONE_BODY, marks=pytest.mark.slow),
        pytest.param("slide_friction", ONE_BODY, marks=pytest.mark.slow),
        pytest.param("collide_mass", TWO_BODIES, marks=pytest.mark.slow),
        pytest.param("collide_friction", TWO_BODIES, marks=pytest.mark.slow),
        pytest.param("collide_both", TWO_BODIES, marks=pytest.mark.slow),
    ],
)
def test_a_guess_that_is_twice_too_large_ends_at_the_truth(
    name: str, wanted: dict[str, float], recorded: Recorded, tmp_path: Path
) -> None:
    figures = identify(name, recorded(name.partition("_")[0]), tmp_path)
    errors = {key: value for key, value in figures.items() if key.endswith("/relative_error")}
    assert errors
    assert all(error <= wanted["parameter"] for error in errors.values()), errors
    assert figures["test/position_error"] <= wanted["position"]
    assert figures["evaluations"] <= wanted["evaluations"]


@pytest.mark.slow
@pytest.mark.skipif(
    not any(TOSSES.glob("*.pt")),
    reason="no cube tosses: get assets/contactnets_cube of github.com/DAIRLab/dair_pll, set PHYSID_CUBE_TOSSES to it",
)
def test_real_tosses_give_the_friction_of_a_tilt_test_and_beat_the_baselines(tmp_path: Path) -> None:
    assert main(["import", "cube-tosses", str(TOSSES), "--out", str(tmp_path / "cube")]) == 0
    figures = identify("cube_tosses", tmp_path / "cube", tmp_path / "run")
    assert figures["params/cube.friction/estimate"] == pytest.approx(0.18, abs=0.02)
    assert 0 < figures["params/cube.restitution/estimate"] < 0.3
    assert figures["test/position_error"] < 0.17
    assert figures["test/rotation_error"] < 23
    for other in ("bullet", "ballistic", "held"):
        assert figures["test/position_error"] < figures[f"test/{other}_position_error"]
