"""Record a trajectory: draw it, film it, add the noise of a sensor, write it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from physid.data import Recording, trajectory_path, write_trajectory
from physid.data.generation.draw import MOST_REDRAWS, add_noise, draw
from physid.data.generation.settings import GenerateConfig
from physid.simulators import observed
from physid.simulators.filming import film
from physid.simulators.motion import taken

if TYPE_CHECKING:
    from physid.physics import Effect


def record(config: GenerateConfig, folder: Path, index: int, split: str, effects: tuple[Effect, ...]) -> int:
    """Write trajectory `index`, with all effects at work, and return how many draws were thrown away."""
    protocol = config.protocol_for(split)
    excitation, motion, redrawn = draw(config, index, protocol, effects)
    scene, sampling = config.true_scene(), config.sampling(effects)
    before = len(motion.pose) - len(excitation.wrench)
    stamps = sampling.stamps(np.arange(len(motion.pose)) - before)
    frames = sampling.draw_frames(np.random.default_rng([config.seed, index, MOST_REDRAWS + 1]), config.missing)
    pose = observed(motion.pose, effects, stamps, before + frames)
    disturbed = bool(config.noise) or not np.array_equal(pose, motion.pose[before + frames])
    images = {}
    if scene.camera is not None:
        images = film(scene, pose)
    else:
        pose[~taken(effects, stamps[before + frames], float(stamps[-1]))] = np.nan
    uneven = bool(config.jitter or config.missing or config.force_rate)
    recording = Recording(
        pose=add_noise(pose, config.noise, np.random.default_rng([config.seed, index, MOST_REDRAWS])),
        # Velocities come from the simulator, not from the sensor: a disturbed set must not carry them.
        twist=None if disturbed else motion.twist[before + frames],
        split=split,
        protocol=protocol,
        wrench=excitation.wrench[sampling.forces],
        time=sampling.stamps(frames) if uneven else None,
        wrench_time=sampling.stamps(sampling.forces) if uneven else None,
        **images,
    )
    write_trajectory(trajectory_path(folder, index), recording)
    return redrawn
