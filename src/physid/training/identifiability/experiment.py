"""An experiment that is planned: its configuration, and the excitations that it draws."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal, final, get_args

import numpy as np

from physid.physics import Effect
from physid.scenes import Excitation, Scene, find_setup
from physid.strict import LARGEST, nearest, number, whole
from physid.training.parameters import ACCEPT, PhysicalParameters, SensorNoise
from physid.typed_files import CLOSED, check_as, without_nulls

Range = tuple[float, float]
Start = Literal["known", "estimated"]


@final
@dataclass(frozen=True)
class IdentifiabilityConfig:
    """An experiment to judge.

    Attributes:
        scene: push, slide, collide or toss.
        learn: Parameters to identify together ("block.mass", "viscous_drag.coefficient").
        protocol: How trajectories are excited: paper or rich.
        constant_force: Magnitude [N] that replaces the drawn ones, held over each trajectory along its mean direction;
            two different ones are spread evenly over the trajectories. None for the forces as drawn.
        values: Parameters that differ from the scene's own; the judgement holds near them.
        trajectories: How many.
        steps: Frames of each.
        segment: Steps of a segment that starts from a known state; None for whole trajectories.
        start: Whether the initial state of each trajectory or segment is known, or estimated from the same noisy poses.
        noise: What the sensor adds to the poses.
        accept: Largest relative deviation of a parameter that counts as identified.
        seed: Of the excitations.

    Raises:
        ValueError: If a value is of the wrong kind or names something that does not exist.
    """

    __pydantic_config__: ClassVar[Any] = CLOSED
    scene: str
    learn: tuple[str, ...]
    protocol: str = "paper"
    constant_force: Range | None = None
    values: Mapping[str, float] = field(default_factory=dict)
    trajectories: int = 16
    steps: int = 300
    segment: int | None = None
    start: Start = "known"
    noise: SensorNoise = field(default_factory=SensorNoise)
    accept: float = ACCEPT
    seed: int = 0

    def __post_init__(self) -> None:
        protocols = find_setup(self.scene).protocols
        if self.protocol not in protocols:
            raise ValueError(f'scene {self.scene} has no protocol "{self.protocol}"{nearest(self.protocol, protocols)}')
        whole(self.trajectories, "trajectories", low=1, high=LARGEST["trajectories"])
        whole(self.steps, "steps", low=2, high=LARGEST["steps"])
        if self.trajectories * self.steps > LARGEST["poses"]:
            raise ValueError(
                f"trajectories, steps: expected at most {LARGEST['poses']} frames in all, held in memory, got "
                f"{self.trajectories} trajectories of {self.steps} frames; lower one of them"
            )
        whole(self.seed, "seed", low=0)
        if self.segment is not None:
            whole(self.segment, "segment", low=1)
        if self.start not in get_args(Start):
            raise ValueError(f"start must be known or estimated, got {self.start!r}")
        number(self.accept, "accept", low=0.0, strict=True)
        for force in self.constant_force or ():
            number(force, "constant_force", low=0.0)
        if not self.learn:
            raise ValueError("learn must be a list of parameters such as [block.mass], got none")
        self.build_parameters()

    @classmethod
    def from_mapping(cls, values: object) -> IdentifiabilityConfig:
        """Build a configuration from a resolved mapping.

        Raises:
            ValueError: If a key is unknown or a value is off; the message names the nearest key.
        """
        known = without_nulls(values)
        if isinstance(known, dict) and isinstance(known.get("constant_force"), int | float):
            known["constant_force"] = [known["constant_force"]] * 2
        return check_as(cls, known, "identifiability")

    def build_scene(self) -> Scene:
        """Return the scene with its parameters."""
        return self.build_parameters().scene

    def build_parameters(self, effects: Sequence[Effect] = ()) -> PhysicalParameters:
        """Return the parameters to judge, beside effects that are known."""
        return PhysicalParameters(find_setup(self.scene).scene, self.learn, self.values, effects)

    def draw(self) -> list[Excitation]:
        """Draw starts and forces."""
        setup, scene, generator = find_setup(self.scene), self.build_scene(), np.random.default_rng(self.seed)
        drawn = [setup.draw(scene, self.protocol, generator, self.steps) for _ in range(self.trajectories)]
        if self.constant_force is None:
            return drawn
        magnitudes = np.linspace(*self.constant_force, self.trajectories)
        return [_held(one, magnitude) for one, magnitude in zip(drawn, magnitudes, strict=True)]


def _held(drawn: Excitation, magnitude: float) -> Excitation:
    """Return the excitation with each body's force held at `magnitude` along its mean; no force stays none."""
    wrench = np.zeros_like(drawn.wrench)
    mean = drawn.wrench[..., 3:].mean(0)
    length = np.linalg.norm(mean, axis=-1, keepdims=True)
    wrench[..., 3:] = magnitude * np.divide(mean, length, out=np.zeros_like(mean), where=length > 0)
    return dataclasses.replace(drawn, wrench=wrench)
