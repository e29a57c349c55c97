"""Make a recording set with a simulator: in parallel, resumable, the same bytes for any number of workers."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from physid.data.format import DESCRIPTION, read_scene, trajectory_path, write_scene, write_sums
from physid.data.generation.settings import GenerateConfig, Noise
from physid.data.recording import Recording
from physid.data.trajectory import write_trajectory
from physid.data.truth import FILE, Truth, read_truth, write_truth
from physid.scenes.catalogue import find_setup
from physid.scenes.rotations import from_vector, multiply
from physid.scenes.setup import Excitation
from physid.simulators.filming import film
from physid.simulators.motion import Motion, observed
from physid.simulators.protocol import find_simulator
from physid.simulators.sampling import Sampling

if TYPE_CHECKING:
    from physid.physics.effect import Effect

Array = NDArray[np.float64]
MOST_REDRAWS = 200
VIEW_MARGIN = 1.0  # [pixel]
SAME_INSTANT = 1e-6  # [frame] times that differ by rounding only


@dataclass(frozen=True)
class Generated:
    """What a run of `generate` did.

    Attributes:
        folder: The recording set.
        written: Trajectories written by this run.
        kept: Trajectories that were there already.
        redrawn: Draws of this run that were thrown away because a body left the view.
    """

    folder: Path
    written: int
    kept: int
    redrawn: int


def generate(
    config: GenerateConfig, out: Path | str, workers: int = 1, *, effects: Sequence[Effect] = (), quiet: bool = False
) -> Generated:
    """Make a recording set, or go on with one that was interrupted.

    Args:
        config: What to make.
        out: Folder of the set.
        workers: Processes; the result does not depend on it.
        effects: Effects beside those of the configuration, say from outside the catalogue.
        quiet: Whether to hide the progress bar.

    Returns:
        What was done.

    Raises:
        ValueError: If the folder holds another set, or no trajectory stays in view.
    """
    import joblib
    from tqdm import tqdm

    folder = Path(out)
    _describe(config, folder, effects)
    indices = range(config.trajectories)
    missing = [index for index in indices if not trajectory_path(folder, index).exists()]
    splits = config.splits()
    jobs = (joblib.delayed(_write_one)(config, folder, index, splits[index], tuple(effects)) for index in missing)
    parallel = joblib.Parallel(n_jobs=workers, return_as="generator_unordered", batch_size="auto")
    bar = tqdm(parallel(jobs), total=len(missing), desc=f"{config.scene} ({config.protocol})", disable=quiet or None)
    redrawn = sum(bar)
    write_sums(folder)
    return Generated(folder, len(missing), len(indices) - len(missing), redrawn)


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
        The commanded excitation and the motion at the instants of `config.sampling()`, which are the frames unless
        stamps wander or forces have a rate of their own; and the number of draws thrown away.

    Raises:
        ValueError: If no draw stays in view.
    """
    scene, sampling, simulator = config.true_scene(), config.sampling(), find_simulator(config.simulator)
    fine = dataclasses.replace(scene, time_step=sampling.step)
    camera = find_setup(config.scene).scene.camera
    for attempt in range(MOST_REDRAWS):
        excitation = _excite(config, protocol, sampling, np.random.default_rng([config.seed, index, attempt]))
        (motion,) = simulator.simulate(fine, [excitation], effects, sampling.substeps)
        if camera is None or camera.sees(motion.pose, scene.sizes, VIEW_MARGIN).all():
            return excitation, motion, attempt
    raise ValueError(
        f"trajectory {index} of {config.scene}, {config.steps * scene.time_step:.3g} s long: "
        f"a body left the view in all of {MOST_REDRAWS} draws; "
        f"lower steps, or change masses, friction or effects so that bodies travel less"
    )


def _excite(config: GenerateConfig, protocol: str, sampling: Sampling, generator: np.random.Generator) -> Excitation:
    """Draw an excitation at the scene's own frame rate, and hold its forces as the set's rows of forces do."""
    setup = find_setup(config.scene)
    own = dataclasses.replace(config.true_scene(), time_step=setup.scene.time_step)
    rows = np.floor(sampling.forces * (sampling.step / own.time_step) + SAME_INSTANT).astype(int)
    drawn = setup.draw(own, protocol, generator, int(rows[-1]) + 1)
    return dataclasses.replace(drawn, wrench=drawn.wrench[rows[sampling.held()]])


def _write_one(config: GenerateConfig, folder: Path, index: int, split: str, extra: tuple[Effect, ...]) -> int:
    """Write trajectory `index` and return how many draws were thrown away."""
    effects = (*config.build_effects(), *extra)
    protocol = config.protocol_for(split)
    excitation, motion, redrawn = draw(config, index, protocol, effects)
    scene, sampling = config.true_scene(), config.sampling()
    seen = observed(motion.pose, effects, sampling.stamps(np.arange(len(motion.pose))))
    frames = sampling.draw_frames(np.random.default_rng([config.seed, index, MOST_REDRAWS + 1]), config.missing)
    pose = seen[frames]
    images = {}
    if scene.camera is not None:
        images = film(scene, pose)
    disturbed = bool(config.noise) or seen is not motion.pose
    uneven = bool(config.jitter or config.missing or config.force_rate)
    recording = Recording(
        pose=_add_noise(pose, config.noise, np.random.default_rng([config.seed, index, MOST_REDRAWS])),
        # Velocities come from the simulator, not from the sensor: a disturbed set must not carry them.
        twist=None if disturbed else motion.twist[frames],
        split=split,
        protocol=protocol,
        wrench=excitation.wrench[sampling.forces],
        time=sampling.stamps(frames) if uneven else None,
        wrench_time=sampling.stamps(sampling.forces) if uneven else None,
        **images,
    )
    write_trajectory(trajectory_path(folder, index), recording)
    return redrawn


def _add_noise(pose: Array, noise: Noise, generator: np.random.Generator) -> Array:
    """Return poses (T, N, 7) with white noise on positions and rotations."""
    if not noise:
        return pose
    shift = noise.position * generator.standard_normal((*pose.shape[:2], 3))
    turn = from_vector(noise.rotation * generator.standard_normal((*pose.shape[:2], 3)))
    return np.concatenate([pose[..., :3] + shift, multiply(turn, pose[..., 3:])], -1)


def _describe(config: GenerateConfig, folder: Path, extra: Sequence[Effect]) -> None:
    """Write recording.yaml and the truth, or check that those in the folder are of the same set."""
    place = Path(config.truth_file) if config.truth_file else folder / FILE
    named = {effect.name: {name: float(value) for name, value in effect.values().items()} for effect in extra}
    truth = Truth(config.true_parameters(), {**config.effects, **named}, config.to_mapping())
    scene = config.known_scene()
    if (folder / DESCRIPTION).exists():
        before = read_truth(place)
        # Sets made before a key was there had its default.
        then = {} if before is None else GenerateConfig.from_mapping(before.generation).to_mapping()
        # More trajectories may be added to a set; anything else would mix two sets in one folder.
        other = [key for key, value in truth.generation.items() if key != "trajectories" and then.get(key) != value]
        if read_scene(folder) != scene or other:
            what = f" ({other[0]}: {then.get(other[0])!r} there, {truth.generation[other[0]]!r} here)" if other else ""
            raise ValueError(
                f"{folder} holds another recording set{what}; choose another folder, or delete this one first"
            )
    write_scene(folder, scene)
    write_truth(place, truth)
