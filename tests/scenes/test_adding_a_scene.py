"""What docs/adding_a_scene.md shows works as it stands there."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from physid.data.generation.generate import generate
from physid.data.generation.settings import GenerateConfig
from physid.scenes import Setup, find_setup
from physid.simulators import find_simulator

GUIDE = (Path(__file__).parents[2] / "docs" / "adding_a_scene.md").read_text()


def block(language: str) -> str:
    """Return the one block of code of a language in the guide."""
    (found,) = re.findall(rf"```{language}\n(.*?)```", GUIDE, re.DOTALL)
    return str(found)


def test_the_scene_of_the_guide_spins_down_as_the_closed_form_says() -> None:
    names: dict[str, object] = {}
    exec(block("python"), names)
    setup = names["SPIN"]
    assert isinstance(setup, Setup)
    drawn = setup.draw(setup.scene, "paper", np.random.default_rng(0), 240)
    (motion,) = find_simulator("mujoco").simulate(setup.scene, [drawn], (), 8)
    spin = np.abs(motion.twist[:, 0, 2])
    assert spin[0] == pytest.approx(np.abs(drawn.twist[0, 2]), rel=0.05)
    assert (np.diff(spin) < 1e-3).all()
    assert spin[-1] < 0.05
    assert np.abs(motion.pose[-1, 0, :2] - motion.pose[0, 0, :2]).max() < 1e-3


def test_the_yaml_of_the_guide_alone_is_a_scene_that_can_be_generated(tmp_path: Path) -> None:
    (tmp_path / "brick.yaml").write_text(block("yaml"))
    setup = find_setup(str(tmp_path / "brick.yaml"))
    config = GenerateConfig(
        str(tmp_path / "brick.yaml"), trajectories=2, steps=30, video=False, unknown=("brick.friction",)
    )
    generate(config, tmp_path / "set")
    text = (tmp_path / "set" / "recording.yaml").read_text()
    assert setup.scene.name in text
    assert f"friction: {2 * setup.scene.value('brick.friction'):g}" in text


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("like: push", "like: pusch"), 'like: no scene "pusch"; did you mean "push"'),
        (("like: push", "like: collide"), "bodies: expected a list of 2, as many as collide moves"),
        (("like: push", "liek: push"), 'unknown key "liek"; did you mean "like"'),
        (("mass: 1.9", "mass: -1.9"), "mass must be"),
    ],
)
def test_a_file_that_describes_no_scene_is_answered_with_what_is_wrong(
    tmp_path: Path, change: tuple[str, str], message: str
) -> None:
    assert change[0] in block("yaml")
    (tmp_path / "brick.yaml").write_text(block("yaml").replace(*change))
    with pytest.raises(ValueError, match=re.escape(message)):
        find_setup(str(tmp_path / "brick.yaml"))


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"no file .*brick\.yaml with a scene in it"):
        find_setup(str(tmp_path / "brick.yaml"))
