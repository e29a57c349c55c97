"""A scene stepped by PyBullet, with the same inputs and the same effects as the PhysicsLayer."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from physid.scenes import Excitation, Scene
from physid.simulators.bullet.engine import Engine, Rows
from physid.simulators.in_step import longest_first, step_all
from physid.simulators.motion import Motion, actuated, check_finite, check_fit

if TYPE_CHECKING:
    from physid.physics import Effect
    from physid.simulators.bullet.hooks import Hooks

Array = NDArray[np.float64]
State = tuple[Rows, Rows]  # poses and twists
AT_ONCE = 16  # worlds of one batch: more are hardly faster, and each holds 28 MB


def simulate(scene: Scene, excitation: Excitation, effects: Sequence[Effect] = (), substeps: int = 1) -> Motion:
    """Step a scene through one force sequence (see `physid.simulators.protocol.Simulator.simulate`)."""
    return simulate_all(scene, [excitation], effects, substeps)[0]


def simulate_all(
    scene: Scene,
    excitations: Sequence[Excitation],
    effects: Sequence[Effect] = (),
    substeps: int = 1,
    clocks: Sequence[float] | None = None,
) -> list[Motion]:
    """Step a scene through several force sequences (see `physid.simulators.protocol.Simulator.simulate`)."""
    check_fit(scene, excitations)
    times = np.zeros(len(excitations)) if clocks is None else np.array(clocks)
    order, motions = longest_first(excitations), dict[int, Motion]()
    for first in range(0, len(order), AT_ONCE):
        chosen = order[first : first + AT_ONCE]
        wrenches = [actuated(excitations[k].wrench, effects, scene.time_step) for k in chosen]
        worlds = _Worlds(scene, [excitations[k] for k in chosen], effects, scene.time_step / substeps)
        with ExitStack() as stack:
            for engine in worlds.engines:
                stack.enter_context(engine)
            seen = step_all(worlds, wrenches, times[chosen], scene.time_step, substeps)
        motions |= zip(chosen, (_motion(scene, states) for states in seen), strict=True)
    return [motions[world] for world in range(len(excitations))]


class _Worlds:
    """PyBullet worlds that go in step (see `physid.simulators.in_step.Worlds`).

    Args:
        scene: The scene, with the parameters to simulate.
        excitations: The longest first.
        effects: Effects of the catalogue, in this order.
        step: Length of one step [s].

    Attributes:
        engines: Those that still run.
    """

    def __init__(self, scene: Scene, excitations: Sequence[Excitation], effects: Sequence[Effect], step: float) -> None:
        self._hooks: Hooks | None = None
        start = np.stack([excitation.pose for excitation in excitations])
        twist = np.stack([excitation.twist for excitation in excitations])
        if effects:
            from physid.simulators.bullet.hooks import Hooks

            self._hooks = Hooks(scene, effects, len(excitations))
            self.engines = self._hooks.build(scene, start, twist, step)
        else:
            self.engines = [Engine(scene, step) for _ in excitations]
        for engine, *state in zip(self.engines, start, twist, strict=True):
            engine.set_state(*state)
        self._now = [engine.read() for engine in self.engines]

    def states(self) -> Sequence[State]:
        """Return the present state of each world."""
        return self._now

    def act(self, time: Array, wrench: Array) -> None:
        """Apply wrenches, and what effects change."""
        if self._hooks is None:
            for engine, (place, _), load in zip(self.engines, self._now, wrench.tolist(), strict=True):
                engine.push(place, load)
            return
        places, motions = zip(*self._now, strict=True)
        self._hooks.act(self.engines, time, places, motions, wrench)

    def advance(self) -> None:
        """Take one step."""
        for engine in self.engines:
            engine.step()
        self._now = [engine.read() for engine in self.engines]

    def keep(self, worlds: int) -> None:
        """Go on with the first so many worlds."""
        self.engines, self._now = self.engines[:worlds], self._now[:worlds]
        if self._hooks is not None:
            self._hooks.keep(worlds)


def _motion(scene: Scene, states: Sequence[State]) -> Motion:
    pose, twist = (_table([state[kind] for state in states]) for kind in (0, 1))
    check_finite(scene, pose, "PyBullet")
    return Motion(pose, twist)


def _table(rows: list[Rows]) -> NDArray[np.float64]:
    """Return rows of numbers (T, N, K) as an array; np.array takes several times longer."""
    shape = len(rows), len(rows[0]), len(rows[0][0])
    numbers = chain.from_iterable(chain.from_iterable(rows))
    return np.fromiter(numbers, np.float64, shape[0] * shape[1] * shape[2]).reshape(shape)
