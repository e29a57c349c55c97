"""The same trajectories, and their gradients, in physid and in other engines, taken alternately in one run.

    pip install -e '.[peers]'
    python benchmarks/peers.py
    python benchmarks/peers.py --engines physid pybullet --rounds 1

A block of 2 kg is pushed along x, slides down an incline of 20 degrees, or runs into a second block; the outcome is its
last x. All engines take steps of 1/240 s, 300 per trajectory. The gradient is that by the mass and the friction of the
block: by reverse mode in physid and Brax, by central differences elsewhere (of a relative width of 1e-3, or 1e-2 in
MuJoCo, where it does better). The error is the largest deviation from the truth among all trajectories, over
the largest gradient: the truth is a closed form for the push and the incline (Coulomb friction, semi-implicit Euler
steps), and for the collision the central differences of physid's torch implementation. A deviation there is a different
model of contact, or noise; the last column tells noise: how far central differences of that and of twice that width
disagree.
"""

from __future__ import annotations

import argparse
import math
import os
import statistics
import time
from abc import ABC, abstractmethod
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from physid.physics import Parameters, PhysicsLayer, Plane, State, World

Array = NDArray[np.float64]
STEP, STEPS, G = 1 / 240, 300, 9.81
SIZE = (0.3, 0.25, 0.2)
MASS, FRICTION, OTHER_MASS = 2.0, 0.12, 1.0


@dataclass(frozen=True)
class Case:
    """A scene: slope of the ground, number of blocks, and per trajectory the force on and the velocity of the first."""

    name: str
    angle: float
    bodies: int
    force: Array
    speed: Array

    def closed_form(self, mass: float, friction: float) -> Array | None:
        """Return the last x of a block that slides all the way, or None if it meets another."""
        if self.bodies > 1:
            return None
        normal, along = math.cos(self.angle), math.sin(self.angle)
        acceleration = self.force / mass + G * (along - friction * normal)
        steps = STEPS * (STEPS + 1) / 2
        return (self.speed * STEPS * STEP + acceleration * steps * STEP**2) * normal

    def starts(self) -> Array:
        """Return the first positions (N, 3) of the blocks."""
        tilt = np.array([math.sin(self.angle), 0.0, math.cos(self.angle)])
        return np.array([[0.36 * n, 0.0, 0.0] for n in range(self.bodies)]) + 0.5 * SIZE[2] * tilt


def cases(count: int) -> list[Case]:
    """Return the scenes, with so many trajectories each."""
    generator = np.random.default_rng(0)
    still = np.zeros(count)
    return [
        Case("push", 0.0, 1, generator.uniform(3.0, 10.0, count), still),
        Case("slide", math.radians(20), 1, still, generator.uniform(0.0, 1.0, count)),
        Case("collide", 0.0, 2, generator.uniform(3.0, 6.0, count), generator.uniform(0.3, 1.5, count)),
    ]


class Engine(ABC):
    """An engine that rolls out all trajectories of a case."""

    name: str
    width = 1e-3
    """Relative width of central differences."""

    most_bodies = 2
    """The largest scene that is worth the wait."""

    def __init__(self, case: Case) -> None:
        self.case = case

    @abstractmethod
    def last_x(self, mass: float, friction: float) -> Array:
        """Return the last x of the first block of every trajectory."""

    def gradient(self, mass: float, friction: float, width: float) -> Array:
        """Return the gradient (trajectories, 2) by mass and friction, by central differences."""
        columns = []
        for dm, df in ((mass * width, 0.0), (0.0, friction * width)):
            above, below = self.last_x(mass + dm, friction + df), self.last_x(mass - dm, friction - df)
            columns.append((above - below) / (2 * (dm + df)))
        return np.stack(columns, 1)


class Physid(Engine):
    """physid, compiled, with its reverse mode."""

    name = "physid"
    backend = "fused"

    def _rollout(self, mass: torch.Tensor, friction: torch.Tensor) -> torch.Tensor:
        case, bodies, count = self.case, self.case.bodies, len(self.case.force)
        half = case.angle / 2
        quaternion = torch.tensor([0.0, math.sin(half), 0.0, math.cos(half)], dtype=torch.float64)
        place = torch.from_numpy(case.starts())
        pose = torch.cat([place, quaternion.expand(bodies, 4)], 1).expand(count, bodies, 7)
        twist = torch.zeros(count, bodies, 6, dtype=torch.float64)
        twist[:, 0, 3] = torch.from_numpy(case.speed * math.cos(case.angle))
        twist[:, 0, 5] = torch.from_numpy(-case.speed * math.sin(case.angle))
        wrench = torch.zeros(count, STEPS, bodies, 6, dtype=torch.float64)
        wrench[:, :, 0, 3] = torch.from_numpy(case.force)[:, None]
        masses = torch.cat([mass, torch.full((count, bodies - 1), OTHER_MASS, dtype=torch.float64)], 1)
        # The friction of a pair is a product: of the block and the ground, whose coefficient is 1.
        frictions = torch.cat([friction] * bodies, 1)
        size = torch.tensor(SIZE, dtype=torch.float64).expand(1, bodies, 3)
        ground = Plane((math.sin(case.angle), 0.0, math.cos(case.angle)))
        layer = PhysicsLayer(World(time_step=STEP, ground=ground), backend=self.backend)  # type: ignore[arg-type]
        return layer.rollout(State(pose, twist), wrench, Parameters.of_boxes(size, masses, frictions)).pose[:, -1, 0, 0]

    def _given(self, mass: float, friction: float) -> tuple[torch.Tensor, torch.Tensor]:
        count = len(self.case.force)
        one = torch.ones(count, 1, dtype=torch.float64)
        return mass * one, friction * one

    def last_x(self, mass: float, friction: float) -> Array:
        """Roll out without gradient."""
        with torch.no_grad():
            return np.asarray(self._rollout(*self._given(mass, friction)))

    def gradient(self, mass: float, friction: float, width: float) -> Array:
        """Roll out and back."""
        given = [value.requires_grad_() for value in self._given(mass, friction)]
        slopes = torch.autograd.grad(self._rollout(*given).sum(), given)
        return np.asarray(torch.cat(slopes, 1))


class Reference(Physid):
    """physid in torch, by central differences: the truth of the collision."""

    name = "reference"
    backend = "reference"
    gradient = Engine.gradient


class PyBullet(Engine):
    """PyBullet, one trajectory after the other."""

    name = "pybullet"

    def __init__(self, case: Case) -> None:
        import pybullet

        super().__init__(case)
        self._api = pybullet
        self._on = {"physicsClientId": pybullet.connect(pybullet.DIRECT)}
        pybullet.setGravity(0, 0, -G, **self._on)
        pybullet.setPhysicsEngineParameter(fixedTimeStep=STEP, numSubSteps=0, **self._on)
        half, tilt = case.angle / 2, np.array([math.sin(case.angle), 0.0, math.cos(case.angle)])
        self._turn = (0.0, math.sin(half), 0.0, math.cos(half))
        self._blocks = [self._box(SIZE, MASS if n == 0 else OTHER_MASS, np.zeros(3)) for n in range(case.bodies)]
        ground = self._box((40.0, 40.0, 2.0), 0.0, -tilt)
        pybullet.changeDynamics(ground, -1, lateralFriction=1.0, **self._on)

    def _box(self, size: tuple[float, ...], mass: float, place: Array) -> int:
        shape = self._api.createCollisionShape(self._api.GEOM_BOX, halfExtents=[s / 2 for s in size], **self._on)
        body = self._api.createMultiBody(mass, shape, -1, list(place), self._turn, **self._on)
        self._api.changeDynamics(body, -1, linearDamping=0, angularDamping=0, **self._on)
        return int(body)

    def last_x(self, mass: float, friction: float) -> Array:
        """Roll out one by one."""
        api, last = self._api, []
        for n, block in enumerate(self._blocks):
            api.changeDynamics(block, -1, mass=mass if n == 0 else OTHER_MASS, lateralFriction=friction, **self._on)
        along = np.array([math.cos(self.case.angle), 0.0, -math.sin(self.case.angle)])
        for force, speed in zip(self.case.force, self.case.speed, strict=True):
            for n, (block, place) in enumerate(zip(self._blocks, self.case.starts(), strict=True)):
                api.resetBasePositionAndOrientation(block, list(place), self._turn, **self._on)
                api.resetBaseVelocity(block, list(speed * along * (n == 0)), [0, 0, 0], **self._on)
            for _ in range(STEPS):
                if force:
                    at = api.getBasePositionAndOrientation(self._blocks[0], **self._on)[0]
                    api.applyExternalForce(self._blocks[0], -1, [force, 0, 0], at, api.WORLD_FRAME, **self._on)
                api.stepSimulation(**self._on)
            last.append(api.getBasePositionAndOrientation(self._blocks[0], **self._on)[0][0])
        return np.array(last)


def mujoco_text(case: Case) -> str:
    """Return a case in MuJoCo's language: elliptic friction cones, semi-implicit Euler."""
    half, box = math.degrees(case.angle), " ".join(str(s / 2) for s in SIZE)
    blocks = "".join(
        f'<body pos="{" ".join(map(str, place))}" euler="0 {half} 0"><freejoint/>'
        f'<geom type="box" size="{box}" mass="{MASS if n == 0 else OTHER_MASS}" friction="{FRICTION}"/></body>'
        for n, place in enumerate(case.starts())
    )
    return (
        f'<mujoco><option timestep="{STEP}" cone="elliptic" gravity="0 0 {-G}"/><worldbody>'
        f'<geom type="plane" size="0 0 1" euler="0 {half} 0" friction="{FRICTION}"/>{blocks}</worldbody></mujoco>'
    )


def mujoco_model(case: Case) -> Any:
    """Return the MuJoCo model of a case."""
    import mujoco

    return mujoco.MjModel.from_xml_string(mujoco_text(case))


class Mujoco(Engine):
    """MuJoCo, one trajectory after the other."""

    name = "mujoco"
    width = 1e-2

    def __init__(self, case: Case) -> None:
        super().__init__(case)
        self._model = mujoco_model(case)

    def last_x(self, mass: float, friction: float) -> Array:
        """Roll out one by one."""
        import mujoco

        model, last = self._model, []
        model.geom_friction[:, 0] = friction
        model.body_inertia[1] *= mass / model.body_mass[1]
        model.body_mass[1] = mass
        data = mujoco.MjData(model)
        mujoco.mj_setConst(model, data)
        for force, speed in zip(self.case.force, self.case.speed, strict=True):
            mujoco.mj_resetData(model, data)
            data.qvel[:3] = speed * np.array([math.cos(self.case.angle), 0.0, -math.sin(self.case.angle)])
            data.xfrc_applied[1, 0] = force
            for _ in range(STEPS):
                mujoco.mj_step(model, data)
            last.append(float(data.qpos[0]))
        return np.array(last)


class Mjx(Engine):
    """MuJoCo in JAX, all trajectories at once, compiled."""

    name = "mjx"
    width = 1e-2
    most_bodies = 1  # two boxes compile for more than ten minutes

    def __init__(self, case: Case) -> None:
        import jax
        from mujoco import mjx

        super().__init__(case)
        model = mjx.put_model(mujoco_model(case))
        along = np.array([math.cos(case.angle), 0.0, -math.sin(case.angle)])

        def roll(mass: Any, friction: Any, force: Any, speed: Any) -> Any:
            changed = model.replace(
                geom_friction=model.geom_friction.at[:, 0].set(friction),
                body_mass=model.body_mass.at[1].set(mass),
                body_inertia=model.body_inertia.at[1].multiply(mass / model.body_mass[1]),
            )
            data = mjx.make_data(changed)
            pushed = data.xfrc_applied.at[1, 0].set(force)
            data = data.replace(qvel=data.qvel.at[:3].set(speed * along), xfrc_applied=pushed)
            return jax.lax.fori_loop(0, STEPS, lambda _, d: mjx.step(changed, d), data).qpos[0]

        self._roll = jax.jit(jax.vmap(roll, in_axes=(None, None, 0, 0)))

    def last_x(self, mass: float, friction: float) -> Array:
        """Roll out all at once."""
        return np.asarray(self._roll(mass, friction, self.case.force, self.case.speed), dtype=np.float64)


class Brax(Engine):
    """Brax's spring pipeline, all trajectories at once, compiled, with its own reverse mode."""

    name = "brax"
    most_bodies = (
        1  # two boxes: compiles for 80 s, then positions are 0.4 m off and gradients hundreds of times too large
    )

    def __init__(self, case: Case) -> None:
        import jax
        import jax.numpy as jnp
        from brax.io import mjcf
        from brax.spring import pipeline

        super().__init__(case)
        jax.config.update("jax_enable_x64", True)
        # Without these its spring pipeline changes masses and inertias, and damps.
        plain = ("spring_mass_scale", "spring_inertia_scale", "ang_damping", "vel_damping", "elasticity")
        numbers = "".join(f'<numeric name="{name}" data="0"/>' for name in plain)
        text = mujoco_text(case).replace('cone="elliptic"', "")  # its own friction is a circular cone
        system = mjcf.loads(text.replace("<worldbody>", f"<custom>{numbers}</custom><worldbody>"))
        along = np.array([math.cos(case.angle), 0.0, -math.sin(case.angle)])

        def roll(mass: Any, friction: Any, force: Any, speed: Any) -> Any:
            inertia = system.link.inertia
            heavy = inertia.replace(mass=inertia.mass.at[0].set(mass), i=inertia.i.at[0].multiply(mass / MASS))
            frictions = system.geom_friction.at[:, 0].set(friction)
            changed = system.replace(link=system.link.replace(inertia=heavy), geom_friction=frictions)

            def step(state: Any, _: Any) -> tuple[Any, None]:
                vel = state.xd_i.vel.at[0, 0].add(force / mass * STEP)
                state = state.replace(xd_i=state.xd_i.replace(vel=vel))
                return pipeline.step(changed, state, jnp.zeros(changed.act_size())), None

            first = pipeline.init(changed, changed.init_q, jnp.zeros(6 * case.bodies).at[:3].set(speed * along))
            return jax.lax.scan(step, first, None, length=STEPS)[0].x_i.pos[0, 0]

        batch = (None, None, 0, 0)
        self._roll = jax.jit(jax.vmap(roll, in_axes=batch))
        self._slope = jax.jit(jax.vmap(jax.grad(roll, (0, 1)), in_axes=batch))

    def last_x(self, mass: float, friction: float) -> Array:
        """Roll out all at once."""
        return np.asarray(self._roll(mass, friction, self.case.force, self.case.speed), dtype=np.float64)

    def gradient(self, mass: float, friction: float, width: float) -> Array:
        """Roll out and back."""
        return np.stack(self._slope(mass, friction, self.case.force, self.case.speed), 1)


ENGINES: dict[str, type[Engine]] = {engine.name: engine for engine in (Physid, Brax, Mujoco, Mjx, PyBullet)}
MODULES = {"brax": "brax", "mjx": "jax", "mujoco": "mujoco", "pybullet": "pybullet"}


def truth(case: Case) -> Array:
    """Return the gradient by mass and friction of every trajectory."""

    def last_x(mass: float, friction: float) -> Array:
        closed = case.closed_form(mass, friction)
        return Reference(case).last_x(mass, friction) if closed is None else closed

    exact = Physid(case)
    exact.last_x = last_x  # type: ignore[method-assign]
    return Engine.gradient(exact, MASS, FRICTION, 1e-5)


def cpu_time(work: Any) -> float:
    """Return the CPU time of a call [s]."""
    start = time.process_time()
    work()
    return time.process_time() - start


def installed() -> list[str]:
    """Return the engines that can be imported."""
    return [name for name in ENGINES if name not in MODULES or find_spec(MODULES[name])]


def measure(engines: list[Engine], rounds: int) -> dict[str, tuple[float, float]]:
    """Return the median CPU times [s] of a rollout and of a gradient, by engine; one round warms up."""
    times: dict[str, list[tuple[float, float]]] = {engine.name: [] for engine in engines}
    for _ in range(rounds + 1):
        for engine in engines:
            forward = cpu_time(lambda e=engine: e.last_x(MASS, FRICTION))
            times[engine.name].append((forward, cpu_time(lambda e=engine: e.gradient(MASS, FRICTION, e.width))))
    return {
        name: (statistics.median(t for t, _ in pairs[1:]), statistics.median(t for _, t in pairs[1:]))
        for name, pairs in times.items()
    }


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--engines", nargs="+", choices=list(ENGINES), default=installed())
    parser.add_argument("--trajectories", type=int, default=64)
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    torch.set_num_threads(1)
    os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1")
    print("| scene | engine | forward [CPU ms] | with gradient [CPU ms] | error of the gradient | noise |")
    print("|---|---|---|---|---|---|")
    for case in cases(options.trajectories):
        expected = truth(case)
        engines = [ENGINES[name](case) for name in options.engines if case.bodies <= ENGINES[name].most_bodies]
        times = measure(engines, options.rounds)
        for engine in engines:
            slopes, wider = (engine.gradient(MASS, FRICTION, k * engine.width) for k in (1, 2))
            scale = np.abs(expected).max()
            error, noise = (np.abs(slopes - other).max() / scale for other in (expected, wider))
            cells = " | ".join(f"{1e3 * taken / options.trajectories:.2f}" for taken in times[engine.name])
            print(f"| {case.name} | {engine.name} | {cells} | {error:.0e} | {noise:.0e} |", flush=True)


if __name__ == "__main__":
    main()
