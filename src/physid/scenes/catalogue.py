"""The scenes that can be generated. A new one is a file in `setups` and an entry here, or a YAML file of the user's."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from physid.scenes.scene import Body, Ground
from physid.scenes.setup import Setup
from physid.scenes.setups.collide import COLLIDE
from physid.scenes.setups.push import PUSH
from physid.scenes.setups.slide import SLIDE
from physid.scenes.setups.toss import TOSS
from physid.strict import nearest, quoted
from physid.typed_files import CLOSED, read_yaml_as

SETUPS: tuple[Setup, ...] = (PUSH, SLIDE, COLLIDE, TOSS)


@dataclass(frozen=True)
class OwnScene:
    """A scene of the user's, as its YAML file describes it (see `read_setup`)."""

    __pydantic_config__: ClassVar[Any] = CLOSED
    scene: str
    like: str
    bodies: tuple[Body, ...] | None = None
    ground: Ground | None = None
    gravity: tuple[float, float, float] | None = None
    time_step: float | None = None


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
    own = read_yaml_as(OwnScene, path)
    known = {setup.scene.name: setup for setup in SETUPS}
    like = known.get(own.like)
    if like is None:
        raise ValueError(f"{path}: like: no scene {quoted(own.like)}{nearest(own.like, known)}")
    if own.bodies is not None and len(own.bodies) != len(like.scene.bodies):
        count = len(like.scene.bodies)
        raise ValueError(f"{path}: bodies: expected a list of {count}, as many as {like.scene.name} moves")
    changed = {name: value for name, value in vars(own).items() if name not in ("scene", "like") and value is not None}
    try:
        return dataclasses.replace(like, scene=dataclasses.replace(like.scene, name=own.scene, **changed))
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
