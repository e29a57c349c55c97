"""A step of the compiled engine, its sections run one after the other on numbers (see `formulas`)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from tests.physics.formulas import Records, constants
from torch import Tensor

from physid.physics import Plane, State, StepInputs, World
from physid.physics.contact import Penetrating, Split
from physid.physics.fused import sections
from physid.physics.fused.formulas.layouts import OF_BODY, OF_WORLD
from physid.physics.fused.packing import shape_of
from physid.physics.rotations import exponential, multiply, rotate
from physid.physics.schemes.integration import Midpoint

TILTED = Plane((0.1, -0.2, 1.0), 0.03)
WORLDS = {
    "speculative": World(ground=TILTED),
    "penetrating": World(ground=TILTED, contact=Penetrating(correction=0.3, speed_limit=0.5), gyroscopic=False),
    "split": World(ground=TILTED, contact=Split(correction=0.3, slop=1e-4)),
    "midpoint": World(ground=TILTED, integration=Midpoint(), time_step=1 / 60),
    "a short step": World(ground=TILTED, integration=Midpoint(), time_step=1 / 4000),
    "no ground": World(ground=None),
}
BATCH = 48


def uniform(*shape: int, low: float = 0.0, high: float = 1.0, seed: int = 0) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    return low + (high - low) * torch.rand(*shape, generator=generator, dtype=torch.float64)


def placed(bodies: int, world: World, seed: int = 0) -> tuple[State, StepInputs]:
    """Draw boxes that lie, stand on an edge or a corner, or fly, beside each other or one on the other."""
    ground = world.ground or TILTED
    up = torch.tensor(ground.normal, dtype=torch.float64)
    size = uniform(BATCH, bodies, 3, low=0.15, high=0.25, seed=seed)
    tilt = torch.tensor([0.0, 1e-3, 0.05, 0.7], dtype=torch.float64)[torch.arange(BATCH) % 4]
    turn = exponential(tilt[:, None, None] * uniform(BATCH, bodies, 3, low=-1, high=1, seed=seed + 1))
    place = uniform(BATCH, bodies, 3, low=-3e-3, high=3e-3, seed=seed + 2)
    place[..., 2] += size[..., 2] / 2
    rises = ((torch.arange(BATCH) // 4) % 2 == 1).double()
    if bodies == 2:
        place[:, 1, 0] += 0.03 + (1 - rises) * (size[..., 0].mean(1) - 0.03)
        place[:, 1, 2] += rises * size[:, 0, 2]
    axis = torch.linalg.cross(torch.tensor([0, 0, 1.0], dtype=torch.float64), up)
    level = exponential(axis / axis.norm().clamp_min(1e-300) * torch.acos(up[2])).expand(BATCH, bodies, 4)
    pose = torch.cat([rotate(level, place) + ground.offset * up, multiply(level, turn)], -1)
    twist = uniform(BATCH, bodies, 6, low=-1, high=1, seed=seed + 4) * 10 ** uniform(BATCH, 1, 1, low=-2, high=0.5)
    like = pose[..., 0]
    given = {
        "wrench": uniform(BATCH, bodies, 6, low=-3, high=3, seed=seed + 5),
        "gravity": torch.tensor(world.gravity, dtype=torch.float64) + uniform(BATCH, bodies, 3, high=0.1),
        "size": size,
        "mass": uniform(*like.shape, low=0.5, high=2, seed=seed + 6),
        "inertia": uniform(*like.shape, 3, low=0.004, high=0.01, seed=seed + 7),
        "friction": uniform(*like.shape, low=0.1, high=0.9, seed=seed + 8),
        "restitution": uniform(*like.shape, high=0.9, seed=seed + 9).round(decimals=1),
        "ground_normal": up,
        "ground_offset": torch.tensor(ground.offset if world.ground else -math.inf, dtype=torch.float64),
        "ground_friction": uniform(*like.shape, low=0.5, high=1.5, seed=seed + 10),
        "ground_restitution": uniform(*like.shape, low=-0.5, high=0.2, seed=seed + 11),
        "body_friction": uniform(BATCH, low=0.5, high=1.5, seed=seed + 12),
        "body_restitution": uniform(BATCH, low=-0.3, high=0.2, seed=seed + 13),
        "centre_of_mass": uniform(*like.shape, 3, low=-0.02, high=0.02, seed=seed + 14),
        "compliance": 1e-4 * uniform(*like.shape, low=-1, high=1, seed=seed + 15).clamp_min(0),
    }
    return State(pose, twist), StepInputs.nominal(pose, given)


@dataclass
class Compiled:
    """The records of a step of the compiled engine, up to the contact problem."""

    records: Records
    bodies: int
    world: World

    @classmethod
    def of(cls, state: State, inputs: StepInputs, world: World) -> Compiled:
        """Write the contact problem of a batch."""
        bodies, shape = state.pose.shape[1], shape_of(world, state.pose.shape[1])
        records = Records(constants=constants(world, bodies), lane={})
        batch = len(state.pose)
        records.of["shared"] = {
            name: getattr(inputs, name).expand(batch, width)
            if name.startswith("ground")
            else getattr(inputs, name)[:, None]
            for name, width in OF_WORLD.items()
        }
        for n in range(bodies):
            body = {name: getattr(inputs, name)[:, n].reshape(batch, width) for name, width in OF_BODY.items()}
            body["wrench"] = inputs.wrench[:, n]
            for name in ("start_", "") if world.midpoint else ("",):
                body |= {f"{name}pose": state.pose[:, n], f"{name}twist": state.twist[:, n]}
            records.of[f"body{n}"] = body
        made = {each.name: each for each in [*sections.assembly(shape), *sections.choices(shape)]}
        names = [f"body{n}" for n in range(bodies)]
        for name in names if world.midpoint else []:
            records.call(sections.TO_MIDPOINT, name, "constants")
        records.call(made["average_mass"], "shared", *names)
        for name in names:
            records.call(made["prepare"], name, "shared", "constants")
        for k, (a, b) in enumerate(shape.pairs):
            one, two, patch = f"body{a}", f"body{b}", f"patch{shape.grounds + k}"
            records.call(made["choose_axis"], one, two, patch)
            records.call(made["choose_points"], one, two, patch)
            records.call(made["touch_boxes"], one, two, "shared", "constants", patch)
        for n in range(shape.grounds):
            records.call(made["choose_corners"], f"body{n}", "shared", f"patch{n}")
            beside = [f"patch{p}" for p in shape.beside(n)]
            records.call(made["touch_ground"], f"body{n}", "shared", "constants", f"patch{n}", *beside)
        for k, (a, b) in enumerate(shape.pairs):
            records.call(made["stand_boxes"], "shared", f"patch{a}", f"patch{b}", f"patch{shape.grounds + k}")
        return cls(records, bodies, world)

    def field(self, name: str) -> Tensor:
        """Return a field of all patches, one after the other, (B, ...)."""
        count = shape_of(self.world, self.bodies).patches
        return torch.cat([self.records.of[f"patch{p}"][name] for p in range(count)], 1)


class Solving:
    """The solver of the compiled engine at work on a contact problem, from a cold start."""

    def __init__(self, compiled: Compiled) -> None:
        self.records, self.shape = compiled.records, shape_of(compiled.world, compiled.bodies)
        bodies = compiled.bodies
        used = [*sections.world_sections(), *sections.matrix_sections(bodies, transposed=False)]
        for count in sections.kinds(self.shape):
            used += [*sections.patch_sections(count, slips=self.shape.midpoint), sections.eliminate(count)]
        self.made = {each.name: each for each in used}
        self.call("begin", "lane", "constants")
        self.each_body("gauge", "body#", "lane")
        for p in range(self.shape.patches):
            self.call("recall", f"patch{p}", f"contact{p}", "lane")
        self.call("allow", "lane", "constants")
        self.restart()

    def call(self, section: str, *names: str) -> None:
        """Run a section on some of the records."""
        for name in names:
            self.records.of.setdefault(name, {})
        self.records.call(self.made[section], *names)

    def each_body(self, section: str, *names: str) -> None:
        """Run a section for each body, whose number # stands for."""
        for n in range(self.shape.bodies):
            self.call(section, *(name.replace("#", str(n)) for name in names))

    def by_patch(self, section: str, *names: str) -> None:
        """Run a section for each patch, on the records of its bodies."""
        for p, touching in self.shape.touching:
            more = [name.replace("#", str(n)) for name in names for n in (touching if "#" in name else [0])]
            self.call(f"{section}{len(touching)}", f"patch{p}", f"contact{p}", "lane", *more)

    def restart(self) -> None:
        """Start afresh where the lane says so."""
        self.each_body("start_body", "body#", "lane")
        self.by_patch("start", "body#")
        self.evaluate()

    def evaluate(self) -> None:
        """Work out the errors of all equations."""
        self.call("clear", "lane")
        self.each_body("evaluate_body", "body#", "motion#")
        self.by_patch("evaluate", "constants", "body#", "motion#")
        self.each_body("judge", "motion#", "lane")

    def factorise(self) -> None:
        """Write the Newton matrix and its factors."""
        n, of = self.shape.bodies, self.records.of
        names = [f"block{i}{j}" for i in range(n) for j in range(n)]
        batch = len(of["body0"]["pose"])
        for name in names:
            of[name] = {"entries": torch.zeros(batch, 36, dtype=torch.float64)}
        for k in range(n):
            self.call("fill", f"body{k}", f"block{k}{k}")
        for p, touching in self.shape.touching:
            blocks = [f"block{i}{j}" for i in touching for j in touching]
            self.call(f"eliminate{len(touching)}", f"patch{p}", f"contact{p}", "lane", *blocks)
        of["matrix"] = {"entries": torch.cat([of[name]["entries"] for name in names], 1)}
        self.call("factor", "matrix")

    def direction(self, aim: str) -> None:
        """Write the Newton direction for an aim, from the factors."""
        self.call(aim, "lane", "constants")
        self.each_body("begin_direction", "motion#")
        self.by_patch("gather", "motion#")
        self.call("solve", "matrix", *(f"motion{n}" for n in range(self.shape.bodies)))
        self.by_patch("expand", "motion#")

    def move(self) -> None:
        """Take the step whose length the lane says, and evaluate."""
        self.each_body("move_body", "body#", "motion#", "lane")
        for p in range(self.shape.patches):
            self.call("move", f"contact{p}", "lane")
        self.evaluate()

    def iterate(self) -> None:
        """Take one step of the cold start: a prediction, and the step that it aims."""
        self.factorise()
        self.direction("aim_at_zero")
        self.call("aim", "lane", "constants")
        self.each_body("begin_direction", "motion#")
        self.by_patch("gather", "motion#")
        self.call("solve", "matrix", *(f"motion{n}" for n in range(self.shape.bodies)))
        self.by_patch("expand", "motion#")
        self.call("decide_length", "lane")
        self.move()

    def of_contacts(self, field: str) -> Tensor:
        """Return a field of all contacts, one after the other, shape (B, C, width)."""
        parts = [self.records.of[f"contact{p}"][field].unflatten(1, (4, -1)) for p in range(self.shape.patches)]
        return torch.cat(parts, 1)

    @property
    def unknown(self) -> Tensor:
        """Velocities of the bodies and of the modes, in the order of the reference, shape (B, n)."""
        bodies = [self.records.of[f"body{n}"]["v"] for n in range(self.shape.bodies)]
        modes = [self.records.of[f"contact{p}"]["modes"][:, : len(own)] for p, own in self.shape.touching]
        return torch.cat([*bodies, *modes], 1)
