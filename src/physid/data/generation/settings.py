"""What a generated recording set shall be: the typed, closed configuration."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from physid.data import DESCRIPTION, SPLITS, assign_splits
from physid.data.files import YAML
from physid.scenes import Integration, Scene, bodies_of, find_setup, with_parameters
from physid.simulators import MOST_JITTER, Sampling, find_simulator, sample
from physid.strict import LARGEST, RATES, is_seen, nearest, number, quoted, whole
from physid.typed_files import CLOSED, check_as, without_nulls

if TYPE_CHECKING:
    from physid.physics import Effect

MOST_MISSING = 0.9  # [-] of the frames, so that a few are left


@dataclass(frozen=True)
class Noise:
    """White noise on the observed poses.

    Attributes:
        position: Standard deviation of each coordinate [m].
        rotation: Standard deviation of each component of a rotation vector [rad].
    """

    __pydantic_config__: ClassVar[Any] = CLOSED
    position: float = 0.0
    rotation: float = 0.0

    def __post_init__(self) -> None:
        number(self.position, "noise.position", low=0.0)
        number(self.rotation, "noise.rotation", low=0.0)

    def __bool__(self) -> bool:
        return self.position > 0 or self.rotation > 0


@dataclass(frozen=True)
class GenerateConfig:
    """What a generated recording set shall be.

    Attributes:
        scene: push, slide, collide or toss.
        simulator: Who makes the motion: pybullet, mujoco or closed_form.
        frame_rate: Frames per second [Hz]; None for the scene's own 240.
        substeps: Steps of the simulator between two frames; None for its own choice. Where stamps wander or forces have
            a rate of their own there are at least 20, for both lie on steps.
        jitter: Largest share of the time between frames by which a frame is off its time [-]; `time` holds true times.
        missing: Share of the frames that are lost [-].
        force_rate: Rows of the forces per second [Hz]; None for that of the frames. Forces are drawn for the scene's
            own 240 frames per second, and change at these rows only.
        protocol: How trajectories are excited: paper, rich or straight (along one line), and for toss flight.
        protocol_of_split: Another protocol for some splits, by the split's name.
        trajectories: Number of trajectories.
        steps: Frames T of each trajectory; the force of a step is held from its frame to the next.
        seed: Seed of the set; each trajectory's own seed follows from it and its index.
        video: Whether to render frames, masks and background.
        split: Shares of the splits; {train: 9, test: 1} gives every tenth trajectory to test.
        true_values: True parameters that differ from the scene's own, by name ("block.friction").
        unknown: Parameters that recording.yaml shall give as a first guess only.
        guess_factor: First guess over true value, for the unknown parameters.
        effects: Effects that the nominal model lacks, by name, with the values of their parameters.
        noise: Noise on the observed poses.
        truth_file: Where the truth goes, a file .yaml; None for truth.yaml in the set's folder.

    Raises:
        ValueError: If a value is of the wrong kind or names something that does not exist.
    """

    __pydantic_config__: ClassVar[Any] = CLOSED
    scene: str
    simulator: str = "pybullet"
    frame_rate: float | None = None
    substeps: int | None = None
    jitter: float = 0.0
    missing: float = 0.0
    force_rate: float | None = None
    protocol: str = "paper"
    protocol_of_split: Mapping[str, str] = field(default_factory=dict)
    trajectories: int = 1000
    steps: int = 300
    seed: int = 0
    video: bool = True
    split: Mapping[str, float] = field(default_factory=lambda: {"train": 9, "test": 1})
    true_values: Mapping[str, float] = field(default_factory=dict)
    unknown: tuple[str, ...] = ()
    guess_factor: float = 2.0
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    noise: Noise = field(default_factory=Noise)
    truth_file: str | None = None

    def __post_init__(self) -> None:
        setup = find_setup(self.scene)
        find_simulator(self.simulator)
        if self.frame_rate is not None:
            number(self.frame_rate, "frame_rate", low=RATES[0], high=RATES[1])
        if self.substeps is not None:
            whole(self.substeps, "substeps", low=1, high=LARGEST["substeps"])
        if self.force_rate is not None:
            number(self.force_rate, "force_rate", low=RATES[0], high=RATES[1])
        for name, most in (("jitter", MOST_JITTER), ("missing", MOST_MISSING)):
            if number(getattr(self, name), name, low=0.0) > most:
                raise ValueError(f"{name} must be at most {most:g}, got {getattr(self, name):g}")
        whole(self.trajectories, "trajectories", low=1, high=LARGEST["trajectories"])
        most = LARGEST["film" if self.video else "steps"]
        whole(self.steps, f"steps{' (with video)' * self.video}", low=2, high=most)
        whole(self.seed, "seed", low=0)
        number(self.guess_factor, "guess_factor", low=0.0, strict=True)
        for name, share in self.split.items():
            number(share, f"split.{name}", low=0.0, strict=True)
        for split in (*self.split, *self.protocol_of_split):
            if split not in SPLITS:
                raise ValueError(f'unknown split "{split}"{nearest(split, SPLITS)}')
        for protocol in (self.protocol, *self.protocol_of_split.values()):
            if protocol not in setup.protocols:
                there = nearest(protocol, setup.protocols)
                raise ValueError(f"scene {self.scene} has no protocol {quoted(protocol)}{there}")
        if self.truth_file is not None:
            _require_yaml(self.truth_file)
        self.known_scene()

    @classmethod
    def from_mapping(cls, values: object) -> GenerateConfig:
        """Build a configuration from a resolved mapping.

        Raises:
            ValueError: If a key is unknown or a value is off; the message names the nearest key.
        """
        return check_as(cls, without_nulls(values), "generate")

    def to_mapping(self) -> dict[str, Any]:
        """Return the configuration as plain values; `from_mapping` reads them back."""
        return dataclasses.asdict(self) | {"unknown": list(self.unknown)}

    def true_scene(self) -> Scene:
        """Return the scene with its true parameters."""
        return self._true_scene

    @cached_property
    def _true_scene(self) -> Scene:
        own = find_setup(self.scene).scene
        step = own.time_step if self.frame_rate is None else 1 / self.frame_rate
        simulator = find_simulator(self.simulator)
        grid = self._sample(step)
        shared = simulator.integration(grid.step / (grid.substeps or simulator.substeps_for(grid.step)))
        scene = dataclasses.replace(
            with_parameters(own, self.true_values),
            time_step=step,
            source=self.simulator,
            integration=None if shared is None else check_as(Integration, dict(shared)),
        )
        return scene if self.video else dataclasses.replace(scene, camera=None)

    def sampling(self, effects: Sequence[Effect] = ()) -> Sampling:
        """Return when forces change and poses are taken, on instants that some effects are simulated at."""
        return self._sample(self.true_scene().time_step, effects)

    def _sample(self, time_step: float, effects: Sequence[Effect] = ()) -> Sampling:
        return sample(
            time_step,
            self.steps,
            find_simulator(self.simulator),
            substeps=self.substeps,
            jitter=self.jitter,
            force_rate=self.force_rate,
            effects=effects,
        )

    def known_scene(self) -> Scene:
        """Return the scene as recording.yaml shall describe it: a first guess for what is unknown."""
        scene = self.true_scene()
        guess = {name: self.guess_factor * scene.value(name) for name in self.unknown}
        return dataclasses.replace(with_parameters(scene, guess), unknown=self.unknown)

    def true_parameters(self) -> dict[str, float]:
        """Return the true value of every parameter that could be asked for, by name."""
        scene = self.true_scene()
        names = [f"{body.name}.{each}" for body in scene.bodies for each in ("mass", "friction", "restitution")]
        owners = {name: scene.bodies[bodies_of(scene, name)[0]].name for name in names}
        return {name: scene.value(name) for name in names if name.startswith(f"{owners[name]}.")}

    def splits(self) -> list[str]:
        """Return the split of each trajectory."""
        return assign_splits(self.trajectories, self.split)

    def protocol_for(self, split: str) -> str:
        """Return the protocol of the trajectories of a split."""
        return self.protocol_of_split.get(split, self.protocol)

    def build_effects(self) -> tuple[Effect, ...]:
        """Build the effects, of the catalogue or admitted (see `physid.effects.admit`).

        Raises:
            ValueError: If an effect or a parameter does not exist.
        """
        if not self.effects:
            return ()
        from physid.effects import from_values

        return tuple(from_values(name, values) for name, values in self.effects.items())


def _require_yaml(truth_file: str) -> None:
    """Refuse a truth file whose name says that it is something else: a configuration from elsewhere may name it."""
    path = Path(truth_file)
    if path.suffix not in YAML or path.name == DESCRIPTION or not is_seen(truth_file):
        raise ValueError(
            f"truth_file: expected a file {' or '.join(YAML)}, and not {DESCRIPTION}, got {quoted(truth_file)}"
        )
