"""What a planned experiment can tell, before any recording: `physid identifiability`."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, final, get_args

import numpy as np
import torch

from physid.data.files import write_text
from physid.physics.layer import PhysicsLayer
from physid.physics.state import State
from physid.scenes.catalogue import find_setup
from physid.scenes.parameters import with_parameters
from physid.scenes.scene import Scene
from physid.scenes.setup import Excitation
from physid.strict import check_keys, nearest, number, whole
from physid.training.identifiability.identifiability import ACCEPT, Identifiability, SensorNoise, percent
from physid.training.identifiability.plot import draw
from physid.training.initial_states.slopes import slopes, without_initial_states
from physid.training.learners.engine import Engine
from physid.training.parameters.physical_parameters import PhysicalParameters
from physid.training.parameters.trajectories import Trajectories

Range = tuple[float, float]
Start = Literal["known", "estimated"]


@final
@dataclass(frozen=True)
class IdentifiabilityConfig:
    """An experiment to judge.

    Attributes:
        scene: push, slide, collide or toss.
        learn: Parameters to identify together ("block.mass").
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
        whole(self.trajectories, "trajectories", low=1)
        whole(self.steps, "steps", low=2)
        whole(self.seed, "seed", low=0)
        if self.segment is not None:
            whole(self.segment, "segment", low=1)
        if self.start not in get_args(Start):
            raise ValueError(f"start must be known or estimated, got {self.start!r}")
        number(self.accept, "accept", low=0.0, strict=True)
        self.build_parameters()

    @classmethod
    def from_mapping(cls, values: object) -> IdentifiabilityConfig:
        """Build a configuration from a resolved mapping.

        Raises:
            ValueError: If a key is unknown or a value is off; the message names the nearest key.
        """
        names = [each.name for each in dataclasses.fields(cls)]
        known = dict(check_keys(values, "observe", ("scene", "learn"), names))
        learn, given = known["learn"], known.get("values") or {}
        if not isinstance(learn, list | tuple) or not learn or not all(isinstance(one, str) for one in learn):
            raise ValueError(f"learn must be a list of parameters such as [block.mass], got {learn!r}")
        if not isinstance(given, Mapping):
            raise ValueError(f"values must be a mapping from parameters to numbers, got {given!r}")
        noise = check_keys(known.get("noise") or {}, "noise", (), ("position", "rotation"))
        return cls(
            **known
            | {
                "learn": tuple(learn),
                "values": {str(name): number(value, f"values.{name}") for name, value in given.items()},
                "constant_force": _range(known.get("constant_force")),
                "noise": SensorNoise(**noise),
            }
        )

    def build_scene(self) -> Scene:
        """Return the scene with its parameters."""
        return with_parameters(find_setup(self.scene).scene, self.values)

    def build_parameters(self) -> PhysicalParameters:
        """Return the parameters to judge."""
        return PhysicalParameters(self.build_scene(), self.learn)

    def draw(self) -> list[Excitation]:
        """Draw starts and forces."""
        setup, scene, generator = find_setup(self.scene), self.build_scene(), np.random.default_rng(self.seed)
        drawn = [setup.draw(scene, self.protocol, generator, self.steps) for _ in range(self.trajectories)]
        if self.constant_force is None:
            return drawn
        magnitudes = np.linspace(*self.constant_force, self.trajectories)
        return [_held(one, magnitude) for one, magnitude in zip(drawn, magnitudes, strict=True)]


@final
@dataclass(frozen=True)
class IdentifiabilityResult:
    """What was judged, and what was found.

    Attributes:
        config: The experiment.
        result: The verdicts.
        count: Trajectories, or segments.
        bent: How many of them were left out (see `Slopes`).
    """

    config: IdentifiabilityConfig
    result: Identifiability
    count: int
    bent: int

    def table(self) -> str:
        """Return experiment and verdicts as text."""
        config = self.config
        low, high = config.constant_force or (0.0, 0.0)
        held = f", constant force {low:g}{f' to {high:g}' if low != high else ''} N" if config.constant_force else ""
        cut = "" if config.segment is None else f", in segments of {config.segment} steps"
        noise = f"{1e3 * config.noise.position:g} mm and {1e3 * config.noise.rotation:g} mrad"
        length = f"{config.trajectories} trajectories of {config.steps} frames{cut}, initial states {config.start}"
        lines = [
            f"{config.scene}, protocol {config.protocol}{held}: {length}",
            f"expected: one standard deviation, with {noise} of noise on each pose; {percent(config.accept)} is enough",
            "",
            self.result.table(),
        ]
        if self.bent:
            lines.append(f"left out: {self.bent} of {self.count}, too sensitive to rely on; shorter segments help")
        return "\n".join(lines)

    def to_mapping(self) -> dict[str, Any]:
        """Return the content of identifiability.json."""
        plain = dataclasses.asdict(self.config)
        return {"config": plain, "examined": self.count, "left_out": self.bent, **self.result.to_mapping()}

    def write(self, folder: Path) -> None:
        """Write identifiability.json and identifiability.png."""
        write_text(folder / "identifiability.json", json.dumps(self.to_mapping(), indent=2) + "\n")
        draw(self.result, f"{self.config.scene}, protocol {self.config.protocol}", folder / "identifiability.png")


def analyse(config: IdentifiabilityConfig, engine: Engine | None = None) -> IdentifiabilityResult:
    """Judge which parameters an experiment would tell, by the sensitivity of the predicted trajectories.

    Args:
        config: The experiment.
        engine: Rules of the physics; None for the layer's own.

    Returns:
        The verdicts.
    """
    physical, layer = config.build_parameters(), (engine or Engine()).layer(config.build_scene())
    planned = predict(layer, physical, config.draw()).segments(config.segment)
    (answer, keep), spread = slopes(layer, physical, planned), config.noise.spread()
    if config.start == "estimated":
        answer = without_initial_states(layer, physical, planned, answer, spread)
    result = Identifiability.of(physical.names, answer[:, keep], planned.real[keep], spread, config.accept)
    return IdentifiabilityResult(config, result, len(planned), int((~keep).sum()))


@torch.no_grad()
def predict(layer: PhysicsLayer, parameters: PhysicalParameters, excitations: Sequence[Excitation]) -> Trajectories:
    """Predict the trajectories of several excitations, all of T rows.

    Args:
        layer: The physics.
        parameters: The physical parameters.
        excitations: Starts and forces.

    Returns:
        Trajectories of T frames, as the layer sees them.
    """
    pose, twist, wrench = (
        torch.from_numpy(np.stack([getattr(one, name) for one in excitations])) for name in ("pose", "twist", "wrench")
    )
    rollout = layer.rollout(State(pose, twist), wrench[:, :-1], parameters())
    count, frames = rollout.pose.shape[:2]
    return Trajectories(rollout.pose, rollout.twist, wrench, torch.full((count,), frames), torch.arange(count))


def _held(drawn: Excitation, magnitude: float) -> Excitation:
    """Return the excitation with each body's force held at `magnitude` along its mean; no force stays none."""
    wrench = np.zeros_like(drawn.wrench)
    mean = drawn.wrench[..., 3:].mean(0)
    length = np.linalg.norm(mean, axis=-1, keepdims=True)
    wrench[..., 3:] = magnitude * np.divide(mean, length, out=np.zeros_like(mean), where=length > 0)
    return dataclasses.replace(drawn, wrench=wrench)


def _range(value: object) -> Range | None:
    """Return a force [N] or a pair of forces as a range."""
    if value is None:
        return None
    both = value if isinstance(value, list | tuple) else [value, value]
    if len(both) != 2:
        raise ValueError(f"constant_force must be a number, two numbers or null, got {value!r}")
    low, high = (number(one, "constant_force", low=0.0) for one in both)
    return low, high
