"""Physics under stress: random contact problems, energy, resting stacks, and the two backends side by side.

    python benchmarks/stress.py                            a million problems, some ten minutes
    python benchmarks/stress.py --problems 5000 --scenes "two boxes" --schemes midpoint

Boxes of 1 mm to 10 m with masses of 0.01 to 100 kg, friction from 0 to 3, restitution from 0 to 1 (half of them 0),
steps from 1/10000 to 1/30 s, speeds to some m/s, spins to 100 rad/s, gaps and overlaps of up to a tenth of the box.
Four things are looked at:

* Status. What the solver calls solved is held against Newton, Signorini and Coulomb, which are evaluated in the
  reference's formulation whoever solved it; what it calls failed is counted.
* Energy. Contacts take kinetic energy, T(v+) <= T(v without contacts) at the pose of the step, beside what their rule
  asks for: sum of lambda_n (-c) where they bounce or overlap, and under Midpoint -lambda_t . (mean slip). Of the energy
  at hand. Under Midpoint, T + V of a whole step is printed too, of rigid bodies apart that turn by less than 0.1 rad
  and move by less than a tenth of their shortest edge.
* Backends. Compiled steps against those of the torch reference, on a sample.
* Rest. Stacks of one to three boxes for 10,000 steps: how far they creep and turn.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import torch
from torch import Tensor

from physid.physics import Parameters, PhysicsLayer, State, StepInputs, World
from physid.physics.case import nominal_inputs
from physid.physics.contact_problem.formulation import formulate
from physid.physics.contact_problem.lcp import ContactProblem, SolverSettings
from physid.physics.contact_problem.rows import patches_of
from physid.physics.fused.stepping import Stepper
from physid.physics.rotations import rotate, to_matrix
from physid.physics.schemes.integration import Integration, Midpoint, SemiImplicit
from physid.physics.schemes.motion import drifted
from physid.physics.schemes.units import STANDARD_GRAVITY
from physid.physics.step import Step, advance

BATCH = 2500
SCHEMES: dict[str, Integration] = {"semi-implicit": SemiImplicit(), "midpoint": Midpoint()}
SHORTEST, LONGEST = 1e-4, 1 / 30
SMALLEST, LARGEST = 2e-3, 5.0
"""[m] of the middle edge of a world; edges are half to twice as long."""
HONEST = 1e-5
"""Largest violation of a law by what is called solved, of the largest number at hand; compliance makes 1e-6 [-]."""
PASSIVE = 1e-6
"""Largest part of the energy at hand that a step may create: smoothing makes 1e-8 [-]."""
SAME = 1e-4
"""Largest difference between the backends, of the fastest velocity at hand [-]."""
RESOLVED = 0.1
"""Turn in a step [rad], and way in parts of the shortest edge, from which on a step is too long for what it steps."""
SAMPLE = 100
"""Worlds of each batch that both backends solve."""
STILL = 1e-3
"""Largest motion of a resting stack, of its size, or turn [rad]: friction that sticks creeps with the smoothing."""
CHUNK = 500
"""Steps of the stacks that are rolled out at once."""


@dataclass(frozen=True)
class Problems:
    """A batch of worlds, each before a step of a length of its own."""

    state: State
    parameters: Parameters
    step: Tensor

    def inputs(self, world: World) -> StepInputs:
        """Return the inputs of the step, without forces."""
        wrench = torch.zeros(*self.state.pose.shape[:1], 1, self.state.pose.shape[1], 6, dtype=torch.float64)
        return nominal_inputs(self.state, wrench, self.parameters, world)

    def select(self, worlds: Tensor) -> Problems:
        """Return those that a mask or a list names."""
        p = self.parameters
        known = Parameters(*(value[worlds] for value in (p.size, p.mass, p.inertia, p.friction, p.restitution)))
        return Problems(State(self.state.pose[worlds], self.state.twist[worlds]), known, self.step[worlds])


def uniform(low: float, high: float, *shape: int) -> Tensor:
    """Draw numbers uniformly."""
    return low + (high - low) * torch.rand(*shape, dtype=torch.float64)


def spread(low: float, high: float, *shape: int) -> Tensor:
    """Draw numbers of which the logarithm is uniform."""
    return torch.exp(uniform(math.log(low), math.log(high), *shape))


def materials(bodies: int) -> tuple[Parameters, Tensor]:
    """Draw boxes, and the scale of each world [m], shape (BATCH, 1)."""
    scale = spread(SMALLEST, LARGEST, BATCH, 1)
    size = scale[..., None] * spread(0.5, 2.0, BATCH, bodies, 3)
    restitution = uniform(0, 1, BATCH, bodies) * (torch.rand(BATCH, 1) < 0.5)
    friction = uniform(0, 1, BATCH, bodies)  # a pair has the product: only one of the bodies goes to 3
    friction = friction * torch.where(torch.arange(bodies) == torch.randint(bodies, (BATCH, 1)), 3.0, 1.0)
    return Parameters.of_boxes(size, spread(0.01, 100, BATCH, bodies), friction, restitution), scale


def twists(bodies: int) -> Tensor:
    """Draw velocities of up to some m/s and spins of up to 100 rad/s; one world in ten at rest."""
    direction = torch.nn.functional.normalize(torch.randn(BATCH, bodies, 3, dtype=torch.float64), dim=-1)
    spin = direction * spread(0.1, 100, BATCH, bodies, 1)
    speed = torch.randn(BATCH, bodies, 3, dtype=torch.float64) * spread(0.01, 3, BATCH, bodies, 1)
    return torch.cat([spin, speed], -1) * (torch.rand(BATCH, 1, 1) < 0.9)


def attitudes(bodies: int, *, upright: bool) -> Tensor:
    """Draw quaternions, about the vertical only where boxes stand upright."""
    quaternion = torch.randn(BATCH, bodies, 4, dtype=torch.float64)
    if upright:  # but for a hair, so that corners of the same height are told apart
        quaternion[..., :2] *= 1e-9
    return torch.nn.functional.normalize(quaternion, dim=-1)


def gaps(scale: Tensor) -> Tensor:
    """Draw gaps: a third nearly none, the others up to a tenth of the box, half of them overlaps; shape (BATCH,)."""
    near = torch.rand(BATCH) < 1 / 3
    return torch.where(near, uniform(-1, 1, BATCH) * 1e-5, uniform(-0.1, 0.1, BATCH)) * scale[:, 0]


def lowered(pose: Tensor, parameters: Parameters, body: int, gap: Tensor) -> None:
    """Put a body so that its lowest corner has a gap to the ground."""
    half = (to_matrix(pose[:, body, 3:])[:, 2].abs() * parameters.size[:, body]).sum(-1) / 2
    pose[:, body, 2] = half + gap


def one_box(*, upright: bool) -> Problems:
    """Draw boxes at the ground."""
    parameters, scale = materials(1)
    pose = torch.cat([torch.zeros(BATCH, 1, 3, dtype=torch.float64), attitudes(1, upright=upright)], -1)
    lowered(pose, parameters, 0, gaps(scale))
    return Problems(State(pose, twists(1)), parameters, spread(SHORTEST, LONGEST, BATCH))


def two_boxes(*, upright: bool) -> Problems:
    """Draw two boxes that touch each other, at the ground."""
    parameters, scale = materials(2)
    pose = torch.cat([torch.zeros(BATCH, 2, 3, dtype=torch.float64), attitudes(2, upright=upright)], -1)
    for body in range(2):
        lowered(pose, parameters, body, gaps(scale))
    heading = uniform(-math.pi, math.pi, BATCH)
    towards = torch.stack([heading.cos(), heading.sin(), torch.zeros(BATCH)], -1)
    radius = parameters.size.norm(dim=-1).sum(1) / 2
    pose[:, 1, :2] += (radius[:, None] * towards)[:, :2]
    world, still = World(ground=None), torch.zeros(BATCH, 2, 6, dtype=torch.float64)
    for _ in range(4):  # along the line between them, until the gap is what was drawn
        problems = Problems(State(pose, still), parameters, torch.ones(BATCH))
        patch = patches_of(problems.state.pose, problems.inputs(world), world)[0]
        gap = torch.where(patch.active, patch.gap, math.inf).amin(1)
        away = (patch.frame[:, 0] * towards).sum(1).clamp_min(0.2)
        pose[:, 1, :2] -= torch.where(gap.isfinite(), 0.9 * gap / away, 0.0)[:, None] * towards[:, :2]
    pose[:, 1, :2] += gaps(scale)[:, None] * towards[:, :2]
    return Problems(State(pose, twists(2)), parameters, spread(SHORTEST, LONGEST, BATCH))


def stack(bodies: int = 3, *, at_rest: bool = False) -> Problems:
    """Draw boxes that stand on each other, turned at random; where they rest, each stands over the one below."""
    parameters, scale = materials(bodies)
    if at_rest:  # no higher than wide, the mass above within the face below
        flat = torch.cat([parameters.size[..., :2], parameters.size[..., :2].amin(-1, keepdim=True)], -1)
        still = torch.zeros_like(parameters.mass)
        parameters = Parameters.of_boxes(flat, parameters.mass, parameters.friction.clamp_min(0.05), still)
    pose = torch.cat([torch.zeros(BATCH, bodies, 3, dtype=torch.float64), attitudes(bodies, upright=True)], -1)
    height = torch.zeros(BATCH, dtype=torch.float64)
    for body in range(bodies):
        height = height + (0.0 if at_rest else gaps(scale)) + parameters.size[:, body, 2]
        pose[:, body, 2] = height - parameters.size[:, body, 2] / 2
        pose[:, body, :2] = scale * uniform(-0.05, 0.05, BATCH, 2)
    twist = torch.zeros(BATCH, bodies, 6, dtype=torch.float64) if at_rest else twists(bodies)
    return Problems(State(pose, twist), parameters, spread(SHORTEST, LONGEST, BATCH))


SCENES: dict[str, Callable[[], Problems]] = {
    "flat box": lambda: one_box(upright=True),
    "tumbling box": lambda: one_box(upright=False),
    "two boxes, upright": lambda: two_boxes(upright=True),
    "two boxes, tumbling": lambda: two_boxes(upright=False),
    "stack of three": stack,
}


def solve(problems: Problems, world: World, settings: SolverSettings, *, compiled: bool) -> Step:
    """Advance the worlds by one step."""
    inputs = problems.inputs(world)
    with torch.no_grad():
        if compiled:
            return Stepper(world, settings)(problems.state, inputs, problems.step)
        return advance(problems.state, inputs, world, settings, problems.step)


@dataclass(frozen=True)
class Solved:
    """A step as its contact problem has it, in units of g h and m g h.

    Attributes:
        problem: In the reference's formulation.
        impulse: lambda, shape (B, C, 3).
        velocity: v+ that the impulses give, shape (B, n).
        free: v+ without contacts, shape (B, n).
        relative: u+ at the contacts, shape (B, C, 3).
        unit: g h [m/s], shape (B,).
        size: The largest number that is at hand, at least 1, shape (B,).
    """

    problem: ContactProblem
    impulse: Tensor
    velocity: Tensor
    free: Tensor
    relative: Tensor
    unit: Tensor
    size: Tensor

    @classmethod
    def of(cls, problems: Problems, world: World, step: Step) -> Solved:
        """Formulate the problem at the poses of the step, and see what the impulses of a step do in it."""
        state, inputs, h = problems.state, problems.inputs(world), problems.step
        acting = drifted(state, inputs, h / 2, gyroscopic=True) if world.midpoint else state
        formulation = formulate(acting, state, inputs, world, h)
        problem, units = formulation.problem, formulation.units
        impulse = step.impulse / units.impulse[:, None, None]
        pushed = problem.momentum + torch.einsum("bckn,bck->bn", problem.jacobian, impulse)
        velocity, free = (torch.linalg.solve(problem.mass, value) for value in (pushed, problem.momentum))
        relative, without = (torch.einsum("bckn,bn->bck", problem.jacobian, value) for value in (velocity, free))
        size = torch.cat([value.flatten(1).abs() for value in (relative, without, impulse)], 1).amax(1).clamp_min(1)
        return cls(problem, impulse, velocity, free, relative, units.velocity, size)

    def violation(self, after: State, rigid: Tensor, *, midpoint: bool) -> Tensor:
        """Return the worst violation of Newton, Signorini and Coulomb, of the largest number at hand, shape (B,).

        Contacts that had to be made compliant may give way: Signorini's law is asked of the others, `rigid` (B,).
        """
        normal, tangent = self.impulse[..., 0], self.impulse[..., 1:]
        parted = self.relative[..., 0] + self.problem.offset
        slip = self.relative[..., 1:] + self.problem.slip
        bound, length = self.problem.friction * normal, tangent.norm(dim=-1)
        bodies = after.twist.shape[1]
        moved_by = self.velocity[:, : 6 * bodies].unflatten(1, (bodies, 6)) * self.unit[:, None, None]
        newton = ((moved_by - after.twist) / self.unit[:, None, None])[..., 3 if midpoint else 0 :].flatten(1)
        size = self.size[:, None]
        laws = (
            newton.abs() / size,
            -normal / size,
            -parted / size * rigid[:, None],
            (parted * normal).abs() / size**2 * rigid[:, None],
            (length - bound) / size,
            ((tangent * slip).sum(-1) + bound * slip.norm(dim=-1)).abs() / size**2,
        )
        return torch.cat(laws, 1).amax(1)

    def created(self) -> Tensor:
        """Return the kinetic energy that contacts create beyond what their rule asks for, of that at hand; (B,)."""
        asked = (self.impulse[..., 0] * (-self.problem.offset).clamp_min(0)).sum(1)
        asked = asked - (self.impulse[..., 1:] * self.problem.slip).sum((1, 2)).clamp_max(
            0
        )  # friction by the mean slip
        before, after = (torch.einsum("bn,bnm,bm->b", v, self.problem.mass, v) / 2 for v in (self.free, self.velocity))
        return (after - before - asked) / (before + asked + 1)


def energy(state: State, parameters: Parameters) -> tuple[Tensor, Tensor]:
    """Return kinetic and potential energy [J], shapes (B,)."""
    body = rotate(state.quaternion * state.pose.new_tensor([-1, -1, -1, 1]), state.twist[..., :3])
    kinetic = (parameters.inertia * body**2).sum((1, 2)) / 2
    kinetic = kinetic + (parameters.mass * state.twist[..., 3:].square().sum(-1)).sum(1) / 2
    return kinetic, STANDARD_GRAVITY * (parameters.mass * state.pose[..., 2]).sum(1)


def gained(problems: Problems, after: State) -> Tensor:
    """Return how much energy a step has made, of the kinetic energy and m (g h)^2, shape (B,)."""
    kinetic, potential = energy(problems.state, problems.parameters)
    now = energy(after, problems.parameters)
    least = problems.parameters.mass.sum(1) * (STANDARD_GRAVITY * problems.step) ** 2
    return (now[0] + now[1] - kinetic - potential) / (kinetic + least)


@dataclass
class Case:
    """What was found in a scene with a scheme; counts, and the worst of each law.

    Attributes:
        problems: How many.
        failed: Not solved, and said so.
        repeated: Solved with a larger compliance.
        steps: Newton steps in all.
        most: Of one problem.
        wrong: Called solved, but no numbers or in breach of a law.
        violation: The worst breach of a contact law.
        created: The most energy that contacts made, beyond what their rule asks for.
        gained: The most kinetic and potential energy that a step of `Midpoint` made, where that is a law.
        compared: Problems that both backends solved.
        apart: Of those, differing in velocities or in status.
        difference: The largest in velocities.
    """

    problems: int = 0
    failed: int = 0
    repeated: int = 0
    steps: int = 0
    most: int = 0
    wrong: int = 0
    violation: float = 0.0
    created: float = -math.inf
    gained: float = -math.inf
    compared: int = 0
    apart: int = 0
    difference: float = 0.0

    @property
    def sound(self) -> bool:
        """Whether no law was broken."""
        return self.wrong == 0 and self.apart == 0

    def row(self) -> str:
        """Return the cells of a table."""
        gained = f"{self.gained:.0e}" if math.isfinite(self.gained) else ""
        newton = f"{self.steps / max(self.problems, 1):.1f} | {self.most}"
        worst = f"{self.violation:.0e} | {self.created:.0e} | {gained}"
        backends = f"{self.apart} of {self.compared} | {self.difference:.0e}"
        return f"{self.problems} | {self.failed} | {self.repeated} | {newton} | {self.wrong} | {worst} | {backends}"


COLUMNS = (
    "problems", "failed", "repeated, more compliant", "Newton steps", "most", "wrong", "violation", "energy created",
    "energy gained", "backends apart", "difference",
)  # fmt: skip


def examine(case: Case, problems: Problems, world: World) -> None:
    """Solve a batch, and add to a case what is found."""
    once = SolverSettings(compliance=SolverSettings().compliance[:1])
    rigid = solve(problems, world, once, compiled=True).converged
    step = solve(problems, world, SolverSettings(), compiled=True)
    solved = Solved.of(problems, world, step)
    good = step.converged
    worst = solved.violation(step.state, rigid, midpoint=world.midpoint)
    created = solved.created()
    numbers = torch.cat([step.state.pose, step.state.twist], -1).isfinite().flatten(1).all(1)
    case.problems += len(good)
    case.failed += int((~good).sum())
    case.repeated += int((good & ~rigid).sum())
    case.steps += int(step.newton_steps.sum())
    case.most = max(case.most, int(step.newton_steps.max()))
    case.wrong += int((good & ~(numbers & (worst <= HONEST) & (created <= PASSIVE))).sum())
    case.violation = max(case.violation, float(worst[good].max()))
    case.created = max(case.created, float(created[good].max()))
    if world.midpoint:
        law = good & plain(problems, step.state, world)
        case.gained = max([case.gained, *gained(problems, step.state)[law].tolist()])
    few = problems.select(torch.arange(SAMPLE))
    other = solve(few, world, SolverSettings(), compiled=False)
    speed = step.state.twist[:SAMPLE].abs().amax((1, 2)) + solved.unit[:SAMPLE]
    difference = (other.state.twist - step.state.twist[:SAMPLE]).abs().amax((1, 2)) / speed
    both = other.converged & good[:SAMPLE] & rigid[:SAMPLE]
    case.compared += SAMPLE
    case.apart += int((other.converged != good[:SAMPLE]).sum()) + int((difference[both] > SAME).sum())
    case.difference = max(case.difference, float(difference[both].max()))


def plain(problems: Problems, after: State, world: World) -> Tensor:
    """Return which worlds `Midpoint` must not give energy: rigid, apart, and resolved by the step.

    That is, turns of less than `RESOLVED`, and ways of less than this share of the shortest edge, with the velocities
    before the step and after it.
    """
    patches = patches_of(problems.state.pose, problems.inputs(world), world)
    gap = torch.stack([torch.where(patch.active, patch.gap, math.inf).amin(1) for patch in patches], 1).amin(1)
    twist, edge = torch.cat([problems.state.twist, after.twist], 1), problems.parameters.size.amin((1, 2))
    turn, way = (twist[..., part].norm(dim=-1).amax(1) * problems.step for part in (slice(0, 3), slice(3, 6)))
    resolved = (turn < RESOLVED) & (way < RESOLVED * edge)
    return (gap > 0) & (problems.parameters.restitution == 0).all(1) & resolved


def rest(bodies: int, world: World, steps: int, worlds: int) -> tuple[int, int, float, float, float]:
    """Let stacks stand that a step resolves, in which a box falls less than a tenth of its least edge.

    Returns:
        How many there were, how many moved by more than `STILL`, and of the others the median and the largest way, of
        their size, and the largest turn [rad].
    """
    drawn = stack(bodies, at_rest=True)
    resolved = STANDARD_GRAVITY * world.step**2 < 0.1 * drawn.parameters.size.amin((1, 2))
    drawn = drawn.select(resolved.nonzero()[:worlds, 0])
    state, layer = drawn.state, PhysicsLayer(world)
    still = torch.zeros(len(drawn.step), 1, bodies, 6, dtype=torch.float64)
    with torch.no_grad():
        for _ in range(0, steps, CHUNK):
            rollout = layer.rollout(state, still.expand(-1, CHUNK, -1, -1), drawn.parameters)
            state = State(rollout.pose[:, -1], rollout.twist[:, -1])
    ways = (state.position - drawn.state.position).norm(dim=-1).amax(1) / drawn.parameters.size.amax((1, 2))
    turns = 2 * (state.quaternion - drawn.state.quaternion).norm(dim=-1).amax(1)
    stood = torch.maximum(ways, turns) <= STILL
    return (
        len(ways),
        int((~stood).sum()),
        float(ways[stood].median()),
        float(ways[stood].max()),
        float(turns[stood].max()),
    )


def main() -> None:
    """Print a row for each scene and scheme, and for the stacks."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--problems", type=int, default=100_000, help="for each scene and scheme")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--scenes", nargs="+", default=list(SCENES), choices=list(SCENES))
    parser.add_argument("--schemes", nargs="+", default=list(SCHEMES), choices=list(SCHEMES))
    parser.add_argument("--rest", type=int, default=10_000, help="steps of the resting stacks; 0 for none")
    options = parser.parse_args()
    torch.set_num_threads(1)
    print("| scene | scheme | " + " | ".join(COLUMNS) + " |\n|" + "---|" * (len(COLUMNS) + 2), flush=True)
    cases, start = [], time.process_time()
    for name in options.scenes:
        for scheme in options.schemes:
            torch.manual_seed(options.seed)
            cases.append(Case())
            while cases[-1].problems < options.problems:
                examine(cases[-1], SCENES[name](), World(integration=SCHEMES[scheme]))
            print(f"| {name} | {scheme} | {cases[-1].row()} |", flush=True)
    moving = 0
    if options.rest:
        print(
            "\n| boxes | scheme | step [s] | stacks | moving | median way, of their size | largest way | largest turn |"
        )
        print("|---|---|---|---|---|---|---|---|", flush=True)
        for bodies, scheme, step in product((1, 2, 3), options.schemes, (LONGEST, 1 / 240, SHORTEST)):
            torch.manual_seed(options.seed)
            world = World(time_step=step, integration=SCHEMES[scheme])
            stacks, moved, *ways = rest(bodies, world, options.rest, 64)
            cells = " | ".join(f"{way:.0e}" for way in ways)
            print(f"| {bodies} | {scheme} | {step:.2g} | {stacks} | {moved} | {cells} |", flush=True)
            moving += moved
    total = sum(case.problems for case in cases)
    broken = sum(case.wrong + case.apart for case in cases)
    print(f"\n{total} problems, {sum(case.failed for case in cases)} failed, {broken} wrong, {moving} stacks moving")
    print(f"{time.process_time() - start:.0f} CPU s")
    sys.exit(broken + moving > 0)


if __name__ == "__main__":
    main()
