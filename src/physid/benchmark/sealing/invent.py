"""Draw recording sets, and what is hidden in each, at a size at which it shows as much as is wanted."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from physid.benchmark.bank import Size
from physid.benchmark.films import SCENES, filmed
from physid.benchmark.labels import Label, Part
from physid.benchmark.plan import Plan, Recorded, Task
from physid.benchmark.sealing.acting import acting_phases
from physid.benchmark.sealing.hidden import ROLES, Hidden, Role, build, candidates, cells, scaled
from physid.benchmark.sealing.severity import severity
from physid.data.generation.draw import draw
from physid.data.generation.settings import GenerateConfig, Noise
from physid.physics import Effect
from physid.scenes import find_setup
from physid.simulators import find_simulator

SPLIT = {"fit": 4, "select": 2, "report_same": 2, "report_transfer": 4}
UNKNOWN: Mapping[str, tuple[tuple[str, ...], ...]] = {
    "push": (("block.friction",), ("block.mass", "block.friction")),
    "slide": (("block.friction",),),
    "collide": (("block.mass", "block.friction"),),
    "toss": (("block.friction", "block.restitution"),),
}
SEVERITIES: Mapping[Role, tuple[float, float]] = {
    "catalogue": (0.01, 6.0),
    "native": (0.05, 8.0),
    "outside": (0.2, 8.0),
    "alias": (0.3, 8.0),
    "pair": (0.4, 6.0),
    "triple": (0.4, 6.0),
}
POSITION, ROTATION = (3e-4, 1.5e-3), (1e-3, 5e-3)  # [m], [rad] noise of the sensor
GUESS = (0.6, 1.7)  # first guess of an unknown parameter over its true value
NEAR = 1.5  # factor within which a severity is met
FAINT = 1e-4  # severity below which an effect does not show at all
LEAST, MOST = 3e-3, 15.0  # multiples of the typical size that are tried
TRIES = 240  # draws of effects and sizes before a set is given up
SAME = 20  # of them, for which a configuration stays the same: where nothing shows, no effect helps
FEWEST_FRAMES = 20  # of a trajectory
OWN_WAY = Recorded()
REDRAWS = 50  # draws that a trajectory without effects may need; with effects there may be more

Invention = tuple[GenerateConfig, tuple[Effect, ...], Label]


def inventions(plan: Plan, task: Task) -> Iterator[Invention]:
    """Draw a recording set, and what is hidden in it, of a severity that is drawn as well.

    Yields:
        Its configuration without effects, the effects, and the label; then the next choices: other effects, then other
        configurations too.
    """
    generator = plan.generator(1, int(task.name))
    simulator = task.recorded.simulator
    able = [
        cell
        for cell in cells(simulator)
        if candidates(task.role, *cell, simulator) and (cell[0] in SCENES or not task.film)
    ]
    turn = task.turn + int(plan.generator(2, ROLES.index(task.role)).integers(len(able)))
    scene, protocol = able[turn % len(able)]
    menu = candidates(task.role, scene, protocol, simulator)
    order = plan.generator(3, ROLES.index(task.role)).permutation(len(menu))
    for attempt in range(TRIES):
        if attempt % SAME == 0:
            config = in_view(plan.size, scene, protocol, generator, task.recorded, film=task.film)
        hidden = menu[order[(task.turn + attempt) % len(menu)]]
        parts = _sizes(config, hidden, generator, plan.least)
        if parts is None:
            continue
        effects = tuple(build(kind, part.parameters) for kind, part in zip(hidden.kinds, parts, strict=True))
        yield config, effects, _label(config, hidden, parts, effects)


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
    other = {"paper": "rich", "rich": "paper"}.get(protocol, protocol)
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


def _sizes(
    config: GenerateConfig, hidden: Hidden, generator: np.random.Generator, least: float
) -> tuple[Part, ...] | None:
    """Find a size for each effect at which it shows as much as is drawn; None where one cannot."""
    parts = []
    for kind in hidden.kinds:
        low, high = SEVERITIES[hidden.role]
        target = float(np.exp(generator.uniform(*np.log((max(low, NEAR * least), high)))))
        found = _size(config, kind, _direction(kind, generator), target)
        if found is None:
            return None
        parts.append(Part(kind.name, kind.site, *found))
    return tuple(parts)


def _direction(kind: type[Effect], generator: np.random.Generator) -> dict[str, float]:
    """Draw the proportions of an effect's parameters, of length 1; negative ones only where the range has them."""
    quantities = kind.quantities()
    draw = generator.normal(size=len(quantities))
    draw /= np.linalg.norm(draw)
    return {key: float(x if q.low < q.null else abs(x)) for (key, q), x in zip(quantities.items(), draw, strict=True)}


def _size(
    config: GenerateConfig, kind: type[Effect], direction: Mapping[str, float], target: float
) -> tuple[dict[str, float], float] | None:
    """Find the size at which an effect has a severity, within a factor; None where it cannot."""
    size, before = 1.0, None
    for _ in range(5):
        values = scaled(kind, direction, size)
        if values == before:  # at the ends of the ranges, and still not there
            return None
        before = values
        try:
            _check_makeable(config, (build(kind, values),))
            shown = severity(config, (build(kind, values),))
        except ValueError:  # the bodies leave the view, or the simulator cannot do it
            return None
        if target / NEAR <= shown <= target * NEAR:
            return values, shown
        if shown < FAINT:
            return None
        size = min(max(size * target / shown, LEAST), MOST)
    return None


def _check_makeable(config: GenerateConfig, effects: tuple[Effect, ...]) -> None:
    """Let a simulator that knows few motions try one; the others are tried by `severity`.

    Raises:
        ValueError: If it does not know this one.
    """
    if not find_simulator(config.simulator).from_any_state:
        draw(config, 0, config.protocol, effects)


def _label(config: GenerateConfig, hidden: Hidden, parts: tuple[Part, ...], effects: tuple[Effect, ...]) -> Label:
    """Write down the truth about a set."""
    moving: dict[str, Any] = {}
    if effects:
        seen_only = set(hidden.sites) == {"perception"}
        moving["phases"] = () if seen_only else tuple(acting_phases(config, effects))
        moving["severity"] = parts[0].severity if len(parts) == 1 else severity(config, effects)
    return Label(
        role=hidden.role,
        scene=config.scene,
        protocol=config.protocol,
        film=config.video,
        effects=parts,
        right=tuple(tuple(names) for names in hidden.right(config.scene)),
        noise=config.noise.position,
        simulator=config.simulator,
        frame_rate=1 / config.true_scene().time_step,
        uneven=bool(config.jitter or config.missing),
        parameters=config.true_parameters(),
        **moving,
    )
