"""The effect-free simulator, started anew from the true state every now and then."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from physid.data.generation.draw import draw
from physid.data.generation.settings import GenerateConfig
from physid.estimation.measurement import pose_difference
from physid.physics import Effect
from physid.scenes import Excitation, Scene, find_setup
from physid.scenes.rotations import from_vector, multiply
from physid.scenes.setups.placing import span
from physid.simulators import Motion, Simulator, find_simulator, observed

Array = NDArray[np.float64]
SPAN = 0.1  # [s] over which the change of a rate is told
JUDGE = "pybullet"  # starts from any state, and is the fastest; MuJoCo's severities are within 1 % (tests/benchmark)
LANDING_STEPS = 4  # between two frames, of what comes down: where in a step an impact falls must not matter
ROUNDING = 1e-9  # [-] quotients that differ from a whole number by less are one


@dataclass(frozen=True)
class Look:
    """One true trajectory: its commands, its motion with the effects, and who made it.

    Attributes:
        excitation: The commands.
        motion: The motion.
        seen: The poses that the camera shows, shape (T, N, 7).
        simulator: Who made it, and makes it again without the effects.
        substeps: Its steps between two frames.
    """

    excitation: Excitation
    motion: Motion
    seen: Array
    simulator: Simulator
    substeps: int

    def steps(self, scene: Scene) -> list[Motion]:
        """Go one frame from every true state but the last, without effects; motions of two frames."""
        starts = range(len(self.motion.pose) - 1)
        return self._run(scene, starts, 2, self.motion.pose[:-1], self.motion.twist[:-1])

    def replay(self, scene: Scene, segment: float, change: Array | None = None) -> Array:
        """Run the effect-free simulator from the true state at the start of each segment.

        Args:
            scene: The scene.
            segment: Length of a segment [s].
            change: Of initial states, in the axes of the ground: of their poses, and of their rates in 0.1 s; of all
                segments alike (2, N, 6), or of each (W, 2, N, 6).

        Returns:
            Poses, shape (T, N, 7).
        """
        length = length_of(scene, segment)
        starts = range(0, len(self.motion.pose) - 1, length)
        pose, twist = self.motion.pose[list(starts)], self.motion.twist[list(starts)]
        if change is not None:
            each = np.broadcast_to(change, (len(starts), *change.shape[-3:]))
            states = [_disturbed(scene, *state) for state in zip(pose, twist, each, strict=True)]
            pose, twist = (np.stack(values) for values in zip(*states, strict=True))
        joined = np.concatenate([motion.pose for motion in self._run(scene, starts, length, pose, twist)])
        return np.concatenate([joined, self.motion.pose[len(joined) :]])

    def _run(self, scene: Scene, starts: range, length: int, pose: Array, twist: Array) -> list[Motion]:
        """Simulate so many frames from each state; the last segment may be shorter."""
        end = len(self.motion.pose)
        states = [
            Excitation(first, speed, self.excitation.wrench[start : min(start + length, end)])
            for start, first, speed in zip(starts, pose, twist, strict=True)
        ]
        return self.simulator.simulate(scene, states, (), self.substeps)


def steady(config: GenerateConfig) -> GenerateConfig:
    """Return the same experiment at the scene's own frame rate, with every frame at its time and none missing.

    How much an effect shows, and in which phases, is a matter of the motion, not of when it is looked at, nor of who
    makes it: the same simulator judges all sets, with and without the effect.
    """
    setup, frames = find_setup(config.scene), config.steps
    own = setup.scene.time_step
    if config.frame_rate is not None:
        frames = math.floor((config.steps - 1) / (config.frame_rate * own) + ROUNDING) + 1
    parts = LANDING_STEPS if setup.leaves_ground else 1
    return replace(
        config, substeps=parts, frame_rate=None, jitter=0.0, missing=0.0, force_rate=None, steps=frames, simulator=JUDGE
    )


def look_at(config: GenerateConfig, index: int, effects: Sequence[Effect]) -> Look:
    """Draw trajectory `index` of a steady set (see `steady`) with effects."""
    excitation, motion, _ = draw(config, index, config.protocol, effects)
    assert config.substeps is not None
    sampling, before = config.sampling(effects), len(motion.pose) - len(excitation.wrench)
    frames = before + sampling.frames
    seen = observed(motion.pose, effects, sampling.stamps(np.arange(-before, len(motion.pose) - before)), frames)
    return Look(
        replace(excitation, wrench=excitation.wrench[sampling.frames]),
        replace(motion, pose=motion.pose[frames], twist=motion.twist[frames]),
        seen,
        find_simulator(config.simulator),
        config.substeps,
    )


def _disturbed(scene: Scene, pose: Array, twist: Array, change: Array) -> tuple[Array, Array]:
    """Move an initial state in the axes of the ground, see `replay`."""
    axes = axes_of(scene)
    place, rate = change
    shifted = pose[:, :3] + place[:, :3] @ axes
    turned = multiply(from_vector(place[:, 3:] @ axes), pose[:, 3:])
    moved = np.concatenate([rate[:, 3:] @ axes, rate[:, :3] @ axes], 1) / SPAN
    return np.concatenate([shifted, turned], 1), twist + moved


def length_of(scene: Scene, segment: float) -> int:
    """Return how many frames a segment of some seconds has."""
    return max(1, round(segment / scene.time_step))


def axes_of(scene: Scene) -> Array:
    """Return the axes of the ground as rows: two along it, then its normal."""
    return np.concatenate([span(scene.ground), np.array(scene.ground.normal)[None]])


def difference(pose: Array, other: Array, scene: Scene) -> Array:
    """Return positions and rotation vectors by which poses differ, in the axes of the ground, shape (T, N, 6)."""
    apart = pose_difference(torch.from_numpy(pose), torch.from_numpy(other)).numpy()
    turn, shift = apart[..., :3], apart[..., 3:]
    axes = axes_of(scene)
    return np.concatenate([shift @ axes.T, turn @ axes.T], -1)
