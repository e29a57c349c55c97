"""Drawing how a set is recorded: scene, motions, true values, noise; nothing of what is hidden in it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, replace

import numpy as np

from physid.benchmark.bank import Size
from physid.benchmark.films import filmed
from physid.benchmark.plan import Recorded
from physid.data.generation.draw import draw
from physid.data.generation.settings import GenerateConfig, Noise
from physid.scenes import find_setup

SPLIT = {"fit": 4, "select": 2, "report_same": 2, "report_transfer": 4}
UNKNOWN: Mapping[str, tuple[tuple[str, ...], ...]] = {
    "push": (("block.friction",), ("block.mass", "block.friction")),
    "slide": (("block.friction",),),
    "collide": (("block.mass", "block.friction"),),
    "toss": (("block.friction", "block.restitution"),),
}
POSITION, ROTATION = (3e-4, 1.5e-3), (1e-3, 5e-3)  # [m], [rad] noise of the sensor
GUESS = (0.6, 1.7)  # first guess of an unknown parameter over its true value
FEWEST_FRAMES = 20  # of a trajectory
OWN_WAY = Recorded()
REDRAWS = 50  # draws that a trajectory without effects may need; with effects there may be more
TRIES = 240  # configurations that are drawn before a scene is given up


def in_view(
    size: Size,
    scene: str,
    protocol: str,
    generator: np.random.Generator,
    recorded: Recorded = OWN_WAY,
    *,
    film: bool = False,
) -> GenerateConfig:
    """Draw configurations until one keeps the bodies in view, without any effect, after a few draws at most."""
    for _ in range(TRIES):
        config = _recorded(_configuration(size, scene, protocol, generator), recorded)
        config = filmed(config) if film else config
        looks = enumerate(config.splits())
        try:
            if all(draw(config, index, config.protocol_for(split))[2] <= REDRAWS for index, split in looks):
                return config
        except ValueError:
            continue
    raise ValueError(f"{scene} ({protocol}): bodies leave the view within {size.steps} steps; lower them")


def _configuration(size: Size, scene: str, protocol: str, generator: np.random.Generator) -> GenerateConfig:
    """Draw everything about a set that has nothing to do with what is hidden."""
    body = find_setup(scene).scene.bodies[0]
    true = {"mass": body.mass * generator.uniform(0.6, 1.6), "friction": body.friction * generator.uniform(0.7, 1.6)}
    if body.restitution:
        true["restitution"] = generator.uniform(0.15, 0.5)
    unknown = UNKNOWN[scene]
    other = {"paper": "rich", "rich": "paper", "off_centre": "rich"}.get(protocol, protocol)
    return GenerateConfig(
        scene=scene,
        protocol=protocol,
        protocol_of_split={"report_transfer": other},
        trajectories=size.trajectories,
        steps=size.steps,
        seed=int(generator.integers(2**31)),
        video=False,
        split=SPLIT,
        true_values={f"{body.name}.{name}": float(value) for name, value in true.items()},
        unknown=unknown[int(generator.integers(len(unknown)))],
        guess_factor=float(generator.uniform(*GUESS)),
        noise=Noise(*(float(np.exp(generator.uniform(*np.log(span)))) for span in (POSITION, ROTATION))),
    )


def _recorded(config: GenerateConfig, recorded: Recorded) -> GenerateConfig:
    """Return the configuration of a set that is recorded in another way, over the same time."""
    own, frames = find_setup(config.scene).scene.time_step, config.steps
    if recorded.frame_rate is not None:
        frames = max(FEWEST_FRAMES, round(config.steps * own * recorded.frame_rate))
    return replace(config, steps=frames, **asdict(recorded))
