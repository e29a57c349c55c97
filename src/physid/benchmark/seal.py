"""Make a bank: recording sets with hidden effects, and the labels sealed apart."""

from __future__ import annotations

import json
import os
import secrets
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np

from physid.benchmark.acting import acting_phases
from physid.benchmark.bank import SEALED, SETS, Bank, Purpose, Size, write_bank
from physid.benchmark.hidden import ROLES, SHARES, Hidden, Role, build, candidates, scaled
from physid.benchmark.labels import Label, Part, write_labels
from physid.benchmark.severity import severity
from physid.data.files import write_text
from physid.data.generate import generate
from physid.data.generation import GenerateConfig, Noise
from physid.data.splits import assign_splits
from physid.physics.effect import Effect
from physid.record import checksum
from physid.scenes.catalogue import SETUPS, find_setup

FAMILIES: Mapping[Purpose, int] = {"score": 1, "calibration": 2}
SPLIT = {"fit": 4, "select": 2, "report_same": 2, "report_transfer": 4}
CELLS = [(setup.scene.name, protocol) for setup in SETUPS for protocol in ("paper", "rich")]
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
}
POSITION, ROTATION = (3e-4, 1.5e-3), (1e-3, 5e-3)  # [m], [rad] noise of the sensor
GUESS = (0.6, 1.7)  # first guess of an unknown parameter over its true value
NEAR = 1.5  # factor within which a severity is met
FAINT = 1e-4  # severity below which an effect does not show at all
LEAST, MOST = 3e-3, 15.0  # multiples of the typical size that are tried
TRIES = 60
EPOCH = 1_700_000_000  # every file gets this date


@dataclass(frozen=True)
class Plan:
    """What a bank is made from; sealed with the labels.

    Attributes:
        purpose: score or calibration; their seeds never meet.
        seed: The bank's seed.
        size: How large it is.
    """

    purpose: Purpose
    seed: int
    size: Size

    def generator(self, *place: int) -> np.random.Generator:
        """Return the source of randomness for one place of the bank."""
        return np.random.default_rng([FAMILIES[self.purpose], self.seed, *place])


@dataclass(frozen=True)
class Task:
    """One set of the bank.

    Attributes:
        name: Its name, which says nothing.
        role: What it is for.
        turn: The how many-th of its role it is.
    """

    name: str
    role: Role
    turn: int


def tasks(plan: Plan) -> list[Task]:
    """Deal the sets of a bank out to roles, in an order that says nothing."""
    turns = dict.fromkeys(ROLES, 0)
    dealt = []
    names = plan.generator(0).permutation(plan.size.sets)
    shares = {str(role): share for role, share in SHARES.items()}
    for number, role in zip(names, assign_splits(plan.size.sets, shares), strict=True):
        known = cast(Role, role)
        dealt.append(Task(f"{number:03d}", known, turns[known]))
        turns[known] += 1
    return sorted(dealt, key=lambda task: task.name)


def seal(folder: Path, plan: Plan, workers: int = 1, *, quiet: bool = False) -> Bank:
    """Make a bank, or go on with one that was interrupted.

    Args:
        folder: Where it shall lie.
        plan: What to make.
        workers: Processes; the recordings do not depend on it.
        quiet: Whether to hide the progress bar.

    Returns:
        The bank.

    Raises:
        ValueError: If the folder holds another bank.
    """
    import joblib
    from tqdm import tqdm

    _keep_apart(folder, plan)
    jobs = (joblib.delayed(_make)(folder.absolute(), plan, task) for task in tasks(plan))
    parallel = joblib.Parallel(n_jobs=workers, return_as="generator_unordered", batch_size=1)
    labels = dict(tqdm(parallel(jobs), total=plan.size.sets, desc="sealing", disable=quiet or None))
    mark = seal_all(folder, labels)
    sums = {name: checksum(folder / SETS / name) for name in sorted(labels)}
    bank = Bank(folder, plan.purpose, sums, mark)
    write_bank(bank)
    return bank


def seal_all(folder: Path, labels: Mapping[str, Label]) -> str:
    """Give all recordings one date, and seal the labels with a fresh salt; returns the seal."""
    for path in sorted((folder / SETS).rglob("*"), reverse=True):
        os.utime(path, (EPOCH, EPOCH))
    return write_labels(folder, labels, secrets.token_hex(32))


def _keep_apart(folder: Path, plan: Plan) -> None:
    """Refuse to mix two banks in one folder."""
    path = folder / SEALED / "plan.json"
    values = json.loads(json.dumps(asdict(plan)))
    if path.is_file() and json.loads(path.read_text(encoding="utf-8")) != values:
        raise ValueError(
            f"{folder} holds a bank of another seed, size or purpose; choose another folder, or delete this one first"
        )
    write_text(path, json.dumps(values) + "\n")


def _make(folder: Path, plan: Plan, task: Task) -> tuple[str, Label]:
    """Make one set, or return its label where it is there."""
    kept = folder / SEALED / "parts" / f"{task.name}.json"
    if kept.is_file():
        return task.name, Label.from_mapping(json.loads(kept.read_text(encoding="utf-8")))
    config, effects, label = invent(plan, task)
    truth = folder / SEALED / "truth" / f"{task.name}.yaml"
    whole = GenerateConfig.from_mapping(config.to_mapping() | {"truth_file": str(truth)})
    generate(whole, folder / SETS / task.name, effects=effects, quiet=True)
    write_text(kept, json.dumps(label.to_mapping()) + "\n")
    return task.name, label


def invent(plan: Plan, task: Task) -> tuple[GenerateConfig, tuple[Effect, ...], Label]:
    """Draw a recording set, and what is hidden in it, of a severity that is drawn as well.

    Returns:
        Its configuration without effects, the effects, and the label.
    """
    generator = plan.generator(1, int(task.name))
    cells = [cell for cell in CELLS if candidates(task.role, *cell)]
    turn = task.turn + int(plan.generator(2, ROLES.index(task.role)).integers(len(cells)))
    scene, protocol = cells[turn % len(cells)]
    config = _configuration(plan.size, scene, protocol, generator)
    menu = candidates(task.role, scene, protocol)
    order = plan.generator(3, ROLES.index(task.role)).permutation(len(menu))
    for attempt in range(TRIES):
        hidden = menu[order[(task.turn + attempt) % len(menu)]]
        parts = _sizes(config, hidden, generator)
        if parts is None:
            continue
        effects = tuple(build(kind, part.parameters) for kind, part in zip(hidden.kinds, parts, strict=True))
        return config, effects, _label(config, hidden, parts, effects)
    raise ValueError(
        f"no effect for the role {task.role} shows in {scene} ({protocol}) as it should; take another seed"
    )


def _configuration(size: Size, scene: str, protocol: str, generator: np.random.Generator) -> GenerateConfig:
    """Draw everything about a set that has nothing to do with what is hidden."""
    body = find_setup(scene).scene.bodies[0]
    true = {"mass": body.mass * generator.uniform(0.6, 1.6), "friction": body.friction * generator.uniform(0.7, 1.6)}
    if body.restitution:
        true["restitution"] = generator.uniform(0.15, 0.5)
    unknown = UNKNOWN[scene]
    other = {"paper": "rich", "rich": "paper"}[protocol]
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


def _sizes(config: GenerateConfig, hidden: Hidden, generator: np.random.Generator) -> tuple[Part, ...] | None:
    """Find a size for each effect at which it shows as much as is drawn; None where one cannot."""
    parts = []
    for kind in hidden.kinds:
        target = float(np.exp(generator.uniform(*np.log(SEVERITIES[hidden.role]))))
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
    size = 1.0
    for _ in range(5):
        values = scaled(kind, direction, size)
        try:
            shown = severity(config, (build(kind, values),))
        except ValueError:  # the bodies leave the view, or PyBullet cannot do it
            return None
        if target / NEAR <= shown <= target * NEAR:
            return values, shown
        if shown < FAINT:
            return None
        size = min(max(size * target / shown, LEAST), MOST)
    return None


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
        effects=parts,
        right=tuple(tuple(names) for names in hidden.right(config.scene)),
        noise=config.noise.position,
        parameters=config.true_parameters(),
        **moving,
    )
