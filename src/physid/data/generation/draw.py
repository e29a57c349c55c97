"""Draw a trajectory: an excitation, the motion that follows, and the noise of a sensor."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from physid.data.generation.settings import GenerateConfig, Noise
from physid.scenes import Excitation, Scene, find_setup
from physid.scenes.rotations import from_vector, multiply
from physid.simulators import Motion, Sampling, find_simulator
from physid.simulators.motion import ROUNDING, earliest

if TYPE_CHECKING:
    from physid.physics import Effect

Array = NDArray[np.float64]
MOST_REDRAWS = 200
VIEW_MARGIN = 1.0  # [pixel]
SAME_INSTANT = 1e-6  # [frame] times that differ by rounding only


class OutOfViewError(ValueError):
    """A trajectory in which no draw keeps the bodies in view."""


def draw(
    config: GenerateConfig, index: int, protocol: str, effects: Sequence[Effect] = ()
) -> tuple[Excitation, Motion, int]:
    """Draw and simulate trajectory `index`, again and again until every body stays in view.

    Args:
        config: What to make.
        index: The trajectory; its randomness follows from the set's seed and this number alone.
        protocol: How to excite it.
        effects: Effects at work.

    Returns:
        The commanded excitation; the motion at the instants of `config.sampling(effects)`, which are the frames unless
        stamps wander, forces have a rate of their own, or an effect acts between frames, and before them, without
        forces, at those that a late camera still shows; and the number of draws thrown away.

    Raises:
        OutOfViewError: If no draw stays in view.
    """
    scene, sampling, simulator = config.true_scene(), config.sampling(effects), find_simulator(config.simulator)
    fine = dataclasses.replace(scene, time_step=sampling.step)
    before = math.ceil(earliest(effects) / sampling.step - ROUNDING)
    camera = find_setup(config.scene).scene.camera
    for attempt in range(MOST_REDRAWS):
        excitation = _excite(config, protocol, sampling, np.random.default_rng([config.seed, index, attempt]))
        wrench = np.concatenate([np.zeros((before, *excitation.wrench.shape[1:])), excitation.wrench])
        acting = dataclasses.replace(laid(excitation, scene, effects), wrench=wrench)
        (motion,) = simulator.simulate(fine, [acting], effects, sampling.substeps, [-before * sampling.step])
        if camera is None or camera.sees(motion.pose, scene.sizes, VIEW_MARGIN).all():
            return excitation, motion, attempt
    raise OutOfViewError(
        f"trajectory {index} of {config.scene}, {config.steps * scene.time_step:.3g} s long: "
        f"a body left the view in all of {MOST_REDRAWS} draws; "
        f"lower steps, or change masses, friction or effects so that bodies travel less"
    )


def laid(excitation: Excitation, scene: Scene, effects: Sequence[Effect]) -> Excitation:
    """Lay the bodies that lie on the ground where their sizes under effects let them lie; others start as drawn."""
    if not effects:
        return excitation
    import torch

    from physid.physics import State
    from physid.scenes.lying import raise_lying, touch_ground
    from physid.simulators.inputs import nominal_inputs

    state = State(torch.from_numpy(excitation.pose)[None], torch.from_numpy(excitation.twist)[None])
    measured = nominal_inputs(scene)
    pose = raise_lying(state, touch_ground(state, measured), measured, effects)
    return dataclasses.replace(excitation, pose=pose[0].numpy())


def _excite(config: GenerateConfig, protocol: str, sampling: Sampling, generator: np.random.Generator) -> Excitation:
    """Draw an excitation at the scene's own frame rate, and hold its forces as the set's rows of forces do."""
    setup = find_setup(config.scene)
    own = dataclasses.replace(config.true_scene(), time_step=setup.scene.time_step)
    rows = np.floor(sampling.forces * (sampling.step / own.time_step) + SAME_INSTANT).astype(int)
    drawn = setup.draw(own, protocol, generator, int(rows[-1]) + 1)
    return dataclasses.replace(drawn, wrench=drawn.wrench[rows[sampling.held()]])


def add_noise(pose: Array, noise: Noise, generator: np.random.Generator) -> Array:
    """Return poses (T, N, 7) with white noise on positions and rotations."""
    if not noise:
        return pose
    shift = noise.position * generator.standard_normal((*pose.shape[:2], 3))
    turn = from_vector(noise.rotation * generator.standard_normal((*pose.shape[:2], 3)))
    return np.concatenate([pose[..., :3] + shift, multiply(turn, pose[..., 3:])], -1)
