"""recording.yaml and the scene are the same thing, and mistakes in it are named."""

import copy
import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from physid.scenes import SETUPS, Body, Integration, bodies_of, find_setup, with_parameters
from physid.scenes.description import describe, read_description
from physid.scenes.scene import SEMI_IMPLICIT_EULER

SAMPLE = yaml.safe_load("""
format: physid-recordings
version: 1
scene: push
time_step: 0.016666666666666666
gravity: [0.0, 0.0, -9.81]
ground: {normal: [0, 0, 1], offset: 0.0}
bodies:
  - {name: block, size: [0.2, 0.2, 0.2], mass: 1.0, friction: 0.3, restitution: 0.0, inertia: null}
unknown: [block.friction]
camera: null
source: pybullet
""")


def changed(path: str, value: object) -> dict[str, Any]:
    mapping = copy.deepcopy(SAMPLE)
    place = mapping
    *parents, last = path.split(".")
    for key in parents:
        place = place[int(key)] if isinstance(place, list) else place[key]
    place[last] = value
    return mapping


def test_the_sample_of_the_format_is_read() -> None:
    scene = read_description(SAMPLE)
    assert scene.bodies == (Body("block", (0.2, 0.2, 0.2), 1.0, 0.3),)
    assert scene.unknown == ("block.friction",)
    assert scene.camera is None


@pytest.mark.parametrize("setup", SETUPS, ids=lambda setup: setup.scene.name)
def test_a_scene_written_and_read_again_is_the_same(setup: Any) -> None:
    text = yaml.safe_dump(describe(setup.scene))
    assert read_description(yaml.safe_load(text)) == setup.scene


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("timestep", 0.1, 'unknown key "timestep"; did you mean "time_step"'),
        ("bodies.0.frction", 0.1, r'bodies\[0\]: unknown key "frction"; did you mean "friction"'),
        ("bodies.0.mass", -1.0, "block.mass must be a number above 0, got -1"),
        ("bodies.0.mass", 1e300, r"block.mass must be a number of at most 1e\+09|block.mass must be .* at most 1e\+09"),
        ("bodies.0.size", [1e10, 0.1, 0.1], "block.size must be positive edge lengths"),
        ("bodies.0.friction", 1e300, r"block.friction must be .* at most 1e\+09"),
        ("bodies.0.inertia", [1.0, 1.0, 3.0], "block.inertia must be moments of which none is more than the sum"),
        ("bodies.0.mass", "heavy", r"bodies\[0\].mass: expected a finite number, found 'heavy'"),
        ("bodies.0.size", [1.0, 2.0], r"bodies\[0\].size: expected a list of 3, found \[1.0, 2.0\]"),
        ("unknown", ["block.fricton"], 'unknown parameter "block.fricton"; did you mean "block.friction"'),
        ("ground", {"normal": [0, 0, 2], "offset": 0.0}, "ground.normal must have length 1, got 2"),
        ("version", 3, "version: expected 1 or 2, found 3"),
        ("integration", {"scheme": "rk4", "step": 0.01}, 'unknown scheme "rk4"; known are semi_implicit_euler; leave'),
        ("integration", {"scheme": "semi_implicit_euler", "step": 0.0}, "integration.step must be a number above 0"),
        ("camera", {"width": 128}, "camera: missing key height, position, target, up, fov_y"),
        ("time_step", 0.0, "time_step must be a number above 0"),
    ],
)
def test_a_mistake_is_named(path: str, value: object, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        read_description(changed(path, value))


def test_what_physid_generated_in_version_1_was_integrated_at_its_time_step() -> None:
    known = Integration(SEMI_IMPLICIT_EULER, SAMPLE["time_step"])
    assert read_description(SAMPLE).integration == known
    assert read_description(changed("source", "my lab")).integration is None
    assert read_description(changed("version", 2)).integration is None
    stated = changed("version", 2) | {"integration": {"scheme": "semi_implicit_euler", "step": 1e-3}}
    assert read_description(stated).integration == Integration(SEMI_IMPLICIT_EULER, 1e-3)
    assert read_description(describe(read_description(SAMPLE))).integration == known


def test_a_uniform_box_has_the_moments_of_the_textbook() -> None:
    assert Body("block", (0.3, 0.2, 0.1), 12.0, 0.1).moments() == pytest.approx([0.05, 0.10, 0.13])


def test_bodies_of_one_material_share_friction_but_not_mass() -> None:
    collide = find_setup("collide").scene
    assert bodies_of(collide, "block.friction") == (0, 1)
    assert bodies_of(collide, "block.mass") == (0,)
    changed_scene = with_parameters(collide, {"block.friction": 0.2, "block.mass": 3.0})
    assert [body.friction for body in changed_scene.bodies] == [0.2, 0.2]
    assert [body.mass for body in changed_scene.bodies] == [3.0, 1.0]


def test_a_material_not_the_name_of_a_scene_says_what_is_shared() -> None:
    collide = find_setup("collide").scene
    renamed = dataclasses.replace(collide, name="collide_of_my_own")
    apart = collide.with_bodies([dataclasses.replace(collide.bodies[0], material=None), collide.bodies[1]])
    assert bodies_of(renamed, "block.restitution") == (0, 1)
    assert bodies_of(apart, "block.friction") == (0,)
    assert read_description(describe(renamed)) == renamed


def test_version_1_of_the_format_wrote_no_materials_down() -> None:
    content = describe(find_setup("collide").scene) | {"version": 1}
    content["bodies"] = [{key: one[key] for key in one if key != "material"} for one in content["bodies"]]
    assert bodies_of(read_description(content), "block.friction") == (0, 1)
    assert bodies_of(read_description(content | {"source": "my lab"}), "block.friction") == (0,)


def test_a_given_inertia_follows_the_mass() -> None:
    body = Body("block", (0.3, 0.2, 0.1), 1.0, 0.1, inertia=(0.1, 0.2, 0.3))
    heavier = with_parameters(find_setup("push").scene.with_bodies([body]), {"block.mass": 2.0})
    assert np.allclose(heavier.bodies[0].moments(), [0.2, 0.4, 0.6])


def test_an_unknown_scene_is_answered_with_the_nearest() -> None:
    with pytest.raises(ValueError, match='unknown scene "colide"; did you mean "collide"'):
        find_setup("colide")


HOSTILE = ("b\x1b[2J", "b\nmass", "b\r", "b\x9b1m", "b\u202eq", "b\u2028q")


@pytest.mark.parametrize("name", HOSTILE)
@pytest.mark.parametrize(
    ("path", "where"),
    [
        ("scene", "scene"),
        ("bodies.0.name", r"bodies\[0\]: body name"),
        ("bodies.0.material", r"bodies\[0\]: block.material"),
    ],
)
def test_names_that_would_move_a_cursor_or_end_a_line_are_refused(path: str, where: str, name: str) -> None:
    with pytest.raises(
        ValueError, match=rf"^{where} must hold characters that are seen, got 'b\\.*'; rename it$"
    ) as one:
        read_description(changed(path, name))
    assert str(one.value).isprintable()


SCRIPTS = (
    *("名", "brique n\u00ba 2", "a/b", "$x"),
    *("\u6728\u3000\u7bb1", "\u0645\u06cc\u0632\u200c\u06a9\u0627\u0631", "n\u00b0\u00a02"),
)
"""Persian needs joiners between letters, and a space may be of any width."""


@pytest.mark.parametrize("name", SCRIPTS)
def test_names_in_any_script_are_taken(name: str) -> None:
    mapping = changed("bodies.0.name", name) | {"unknown": [f"{name}.friction"], "scene": name}
    assert read_description(mapping).bodies[0].name == name


@pytest.mark.parametrize("name", HOSTILE)
def test_a_scene_of_ones_own_with_such_names_is_refused_with_its_file(tmp_path: Path, name: str) -> None:
    body = {"name": name, "size": [0.1, 0.1, 0.1], "mass": 1.0, "friction": 0.2}
    (tmp_path / "a.yaml").write_text(yaml.safe_dump({"scene": "a", "like": "push", "bodies": [body]}))
    with pytest.raises(ValueError, match=r"a\.yaml: bodies\[0\]: body name must hold characters that are seen"):
        find_setup(str(tmp_path / "a.yaml"))
    (tmp_path / "a.yaml").write_text(yaml.safe_dump({"scene": name, "like": "push"}))
    with pytest.raises(ValueError, match=r"a\.yaml: scene must hold characters that are seen"):
        find_setup(str(tmp_path / "a.yaml"))


@pytest.mark.parametrize("changed", [{"name": "a." * 50_000}, {"material": ["a"] * 50_000}])
def test_what_is_no_name_is_quoted_in_a_few_letters(changed: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="must be a word") as caught:
        Body(**{"name": "block", "size": (1.0, 1.0, 1.0), "mass": 1.0, "friction": 0.1, **changed})
    assert len(str(caught.value)) < 500
