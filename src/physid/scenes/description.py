"""recording.yaml: a scene as a file describes it, in every version of the format."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from physid.scenes.camera import Camera, Triple
from physid.scenes.scene import SEMI_IMPLICIT_EULER, Body, Ground, Integration, Scene
from physid.typed_files import CLOSED, check_as

FORMAT = "physid-recordings"
VERSION = 2
GENERATED = "pybullet"  # the `source` of all that version 1 of the format generated, always with one step per frame


@dataclass(frozen=True)
class Description:
    """The content of recording.yaml; see `Scene` for what the entries mean."""

    __pydantic_config__: ClassVar[Any] = CLOSED
    format: Literal["physid-recordings"]
    version: Literal[1, 2]
    scene: str
    time_step: float
    gravity: Triple
    ground: Ground
    bodies: tuple[Body, ...]
    unknown: tuple[str, ...] | None = ()
    camera: Camera | None = None
    source: str | None = ""
    integration: Integration | None = None

    def to_scene(self) -> Scene:
        """Return the scene; version 1, as physid wrote it, left unsaid what all its sets had in common."""
        scene = Scene(
            name=self.scene,
            time_step=self.time_step,
            ground=self.ground,
            bodies=self.bodies,
            unknown=self.unknown or (),
            camera=self.camera,
            gravity=self.gravity,
            source=self.source or "",
            integration=self.integration,
        )
        if self.version == 1 and self.source == GENERATED:
            step = self.integration or Integration(SEMI_IMPLICIT_EULER, self.time_step)
            scene = dataclasses.replace(scene, integration=step)
            if self.scene == "collide":
                scene = scene.with_bodies(dataclasses.replace(body, material="wood") for body in self.bodies)
        return scene


def read_description(content: object) -> Scene:
    """Return the scene that the content of recording.yaml describes.

    Raises:
        ValueError: If a key is missing or unknown, or a value is off.
    """
    return check_as(Description, content).to_scene()


def describe(scene: Scene) -> dict[str, Any]:
    """Return the content of recording.yaml, as plain values, in the order of the format's description."""
    plain = dataclasses.asdict(scene)
    order = [field.name for field in dataclasses.fields(Description)][3:]
    content = {"format": FORMAT, "version": VERSION, "scene": scene.name} | {name: plain[name] for name in order}
    if scene.integration is None:
        del content["integration"]
    listed: dict[str, Any] = json.loads(json.dumps(content))  # tuples as lists
    return listed
