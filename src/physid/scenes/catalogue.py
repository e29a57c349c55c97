"""The scenes that can be generated. A new one is a file in `setups` and an entry here, or a YAML file of the user's."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from physid.scenes.scene import Body, Ground
from physid.scenes.setup import Setup
from physid.scenes.setups.collide import COLLIDE
from physid.scenes.setups.push import PUSH
from physid.scenes.setups.slide import SLIDE
from physid.scenes.setups.toss import TOSS
from physid.strict import check_keys, nearest, number, quoted, triple
from physid.yaml_files import read_yaml

SETUPS: tuple[Setup, ...] = (PUSH, SLIDE, COLLIDE, TOSS)


def find_setup(name: str) -> Setup:
    """Return the setup of a scene by its name in the catalogue, or from a YAML file (see `read_setup`).

    Raises:
        ValueError: If there is no such scene, or the file does not describe one.
    """
    known = {setup.scene.name: setup for setup in SETUPS}
    if isinstance(name, str) and name.endswith((".yaml", ".yml")):
        return read_setup(Path(name))
    if not isinstance(name, str) or name not in known:
        raise ValueError(f"unknown scene {quoted(name)}{nearest(str(name), known)}; or name a file such as brick.yaml")
    return known[name]


def read_setup(path: Path) -> Setup:
    """Read a scene of one's own: what stands there is in the file, how it is excited is as in a scene of the catalogue.

    Args:
        path: YAML with `scene` (a name) and `like` (whose protocols), and, where they differ from that scene's,
            `bodies` and `ground` as in recording.yaml, `gravity` [m/s^2] and `time_step` [s].

    Raises:
        ValueError: If there is no such file, a key is missing or unknown, or `like` moves more or fewer bodies.
    """
    if not path.is_file():
        raise ValueError(f"no file {path} with a scene in it (looked in {Path.cwd()})")
    known = check_keys(read_yaml(path), str(path), ("scene", "like"), ("bodies", "ground", "gravity", "time_step"))
    like = {setup.scene.name: setup for setup in SETUPS}.get(str(known["like"]))
    if like is None:
        names = [setup.scene.name for setup in SETUPS]
        raise ValueError(f"{path}: like: no scene {quoted(known['like'])}{nearest(str(known['like']), names)}")
    bodies = like.scene.bodies
    if known.get("bodies") is not None:
        if not isinstance(known["bodies"], list) or len(known["bodies"]) != len(bodies):
            raise ValueError(f"{path}: bodies: expected a list of {len(bodies)}, as many as {like.scene.name} moves")
        bodies = tuple(Body.from_mapping(one, index) for index, one in enumerate(known["bodies"]))
    ground, gravity, step = known.get("ground"), known.get("gravity"), known.get("time_step")
    scene = dataclasses.replace(
        like.scene,
        name=str(known["scene"]),
        bodies=bodies,
        ground=like.scene.ground if ground is None else Ground.from_mapping(ground),
        gravity=like.scene.gravity if gravity is None else triple(gravity, "gravity"),
        time_step=like.scene.time_step if step is None else number(step, "time_step", low=0.0, strict=True),
    )
    return dataclasses.replace(like, scene=scene)
