"""A scene stepped by PyBullet, with the same inputs and the same effects as the PhysicsLayer."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from physid.scenes.scene import Scene
from physid.scenes.setup import Excitation
from physid.simulators.bullet.engine import Engine, Rows
from physid.simulators.motion import Motion, actuated, check_finite, check_fit, observed

if TYPE_CHECKING:
    from physid.physics.effect import Effect

Array = NDArray[np.float64]
State = tuple[Rows, Rows]  # poses and twists
__all__ = ["AT_ONCE", "Motion", "observed", "simulate", "simulate_all"]
AT_ONCE = 16  # worlds of one batch: more are hardly faster, and each holds 28 MB


def simulate(scene: Scene, excitation: Excitation, effects: Sequence[Effect] = (), substeps: int = 1) -> Motion:
    """Step a scene through a force sequence.

    Row t of the wrench is held from frame t to frame t+1, the last row is not used. Effects change the commanded
    wrenches before they act and the inputs of each step; what they do to the observed pose is `observed`.

    Args:
        scene: The scene, with the parameters to simulate.
        excitation: Initial state and commanded wrenches (T, N, 6).
        effects: Effects of the catalogue, used unchanged, in this order.
        substeps: Steps of PyBullet between two frames.

    Returns:
        The motion at the T frames.

    Raises:
        ValueError: If the excitation does not fit the scene, or the motion is not finite.
    """
    return simulate_all(scene, [excitation], effects, substeps)[0]


def simulate_all(
    scene: Scene,
    excitations: Sequence[Excitation],
    effects: Sequence[Effect] = (),
    substeps: int = 1,
    clocks: Sequence[float] | None = None,
) -> list[Motion]:
    """Step a scene through several force sequences, in worlds of their own that go in step.

    Effects are asked once for all worlds, which takes hardly longer than for one; their parameters have the shape (1,).

    Args:
        scene: The scene, with the parameters to simulate.
        excitations: Initial states and commanded wrenches, of any lengths.
        effects: See `simulate`.
        substeps: Steps of PyBullet between two frames.
        clocks: Times that effects see at the first frames [s]; None for 0.

    Returns:
        The motion of each, see `simulate`.

    Raises:
        ValueError: If an excitation does not fit the scene, or a motion is not finite.
    """
    times = [0.0] * len(excitations) if clocks is None else clocks
    order = sorted(range(len(excitations)), key=lambda world: -len(excitations[world].wrench))
    motions: dict[int, Motion] = {}
    for first in range(0, len(order), AT_ONCE):
        chosen = order[first : first + AT_ONCE]
        run = _Worlds(scene, [excitations[k] for k in chosen], effects, substeps, [times[k] for k in chosen])
        motions |= zip(chosen, run.motions(), strict=True)
    return [motions[world] for world in range(len(excitations))]


class _Worlds:
    """PyBullet worlds that go in step, longest first.

    Args:
        scene: See `simulate_all`.
        excitations: The longest first.
        effects: See `simulate_all`.
        substeps: See `simulate_all`.
        clocks: See `simulate_all`.
    """

    def __init__(
        self,
        scene: Scene,
        excitations: Sequence[Excitation],
        effects: Sequence[Effect],
        substeps: int,
        clocks: Sequence[float],
    ) -> None:
        check_fit(scene, excitations)
        self._scene, self._substeps, self._hooks = scene, substeps, None
        self._clock = np.array(clocks)
        self._wrench = [excitation.wrench for excitation in excitations]
        start = np.stack([excitation.pose for excitation in excitations])
        twist = np.stack([excitation.twist for excitation in excitations])
        step = scene.time_step / substeps
        if effects:
            from physid.simulators.bullet.hooks import Hooks

            self._hooks = Hooks(scene, effects, len(excitations))
            self._wrench = [actuated(wrench, effects, scene.time_step) for wrench in self._wrench]
            self._engines = self._hooks.build(scene, start, twist, step)
            start = self._hooks.start(start)
        else:
            self._engines = [Engine(scene, step) for _ in excitations]
        for engine, *state in zip(self._engines, start, twist, strict=True):
            engine.set_state(*state)

    def motions(self) -> list[Motion]:
        """Step all worlds to their ends."""
        with ExitStack() as stack:
            engines = [stack.enter_context(engine) for engine in self._engines]
            now = [engine.read() for engine in engines]
            seen = [[state] for state in now]
            for frame in range(len(self._wrench[0]) - 1):
                running = sum(len(wrench) > frame + 1 for wrench in self._wrench)
                if running < len(now):
                    now = now[:running]
                    if self._hooks is not None:
                        self._hooks.keep(running)
                loads = [wrench[frame] for wrench in self._wrench[:running]]
                for part in range(self._substeps):
                    self._push(engines[:running], frame + part / self._substeps, now, loads)
                    for world in range(running):
                        engines[world].step()
                        now[world] = engines[world].read()
                for world in range(running):
                    seen[world].append(now[world])
        return [self._motion(states) for states in seen]

    def _push(self, engines: Sequence[Engine], frames: float, now: Sequence[State], loads: Sequence[Array]) -> None:
        """Apply wrenches, and what effects change, so many frames after the first."""
        if self._hooks is None:
            for engine, (place, _), load in zip(engines, now, loads, strict=True):
                engine.push(place, load.tolist())
            return
        time = self._clock[: len(now)] + self._scene.time_step * frames
        places, motions = zip(*now, strict=True)
        self._hooks.act(engines, time, places, motions, np.stack(loads))

    def _motion(self, states: Sequence[State]) -> Motion:
        pose, twist = (_table([state[kind] for state in states]) for kind in (0, 1))
        check_finite(self._scene, pose, "PyBullet")
        return Motion(pose, twist)


def _table(rows: list[Rows]) -> NDArray[np.float64]:
    """Return rows of numbers (T, N, K) as an array; np.array takes several times longer."""
    shape = len(rows), len(rows[0]), len(rows[0][0])
    numbers = chain.from_iterable(chain.from_iterable(rows))
    return np.fromiter(numbers, np.float64, shape[0] * shape[1] * shape[2]).reshape(shape)
