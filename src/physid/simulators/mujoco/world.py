"""A scene stepped by MuJoCo, with the same inputs and the same effects as the PhysicsLayer."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from physid.scenes.scene import Scene
from physid.scenes.setup import Excitation
from physid.simulators.motion import Motion, actuated, check_finite, check_fit
from physid.simulators.mujoco.engine import Engine, poses_and_twists

if TYPE_CHECKING:
    from physid.physics.effect import Effect

Array = NDArray[np.float64]


def simulate_all(
    scene: Scene,
    excitations: Sequence[Excitation],
    effects: Sequence[Effect] = (),
    substeps: int = 1,
    clocks: Sequence[float] | None = None,
) -> list[Motion]:
    """Step a scene through several force sequences, in worlds of their own that go in step.

    Row t of a wrench is held from frame t to frame t+1, the last row is not used. Effects are asked once per step for
    all worlds; what they do to the observed pose is not part of the motion.

    Args:
        scene: The scene, with the parameters to simulate.
        excitations: Initial states and commanded wrenches, of any lengths.
        effects: Effects of the catalogue, used unchanged, in this order.
        substeps: Steps of MuJoCo between two frames.
        clocks: Times that effects see at the first frames [s]; None for 0.

    Returns:
        The motion of each.

    Raises:
        ValueError: If an excitation does not fit the scene, an effect cannot be simulated, or a motion is not finite.
    """
    check_fit(scene, excitations)
    if not any(_acts(effect) for effect in effects):
        commanded = [actuated(excitation.wrench, effects, scene.time_step) for excitation in excitations]
        engine = Engine(scene, scene.time_step / substeps)
        return [_alone(scene, engine, *each, substeps) for each in zip(excitations, commanded, strict=True)]
    times = [0.0] * len(excitations) if clocks is None else clocks
    order = sorted(range(len(excitations)), key=lambda world: -len(excitations[world].wrench))
    together = _Together(scene, [excitations[k] for k in order], effects, substeps, [times[k] for k in order])
    motions = dict(zip(order, together.motions(), strict=True))
    return [motions[world] for world in range(len(excitations))]


def _acts(effect: Effect) -> bool:
    """Tell whether an effect changes the inputs of a step, or a simulator's own settings."""
    from physid.physics.effect import Effect

    return type(effect).act is not Effect.act or hasattr(effect, "settings")


def _alone(scene: Scene, engine: Engine, excitation: Excitation, wrench: Array, substeps: int) -> Motion:
    """Simulate one trajectory of which no effect changes a step."""
    engine.set_state(excitation.pose, excitation.twist)
    seen = [engine.state()]
    for held in wrench[:-1]:
        engine.push(held)
        for _ in range(substeps):
            engine.advance()
        seen.append(engine.state())
    return _motion(scene, seen)


def _motion(scene: Scene, seen: Sequence[tuple[Array, Array]]) -> Motion:
    """Return the motion that went through some states."""
    pose, twist = poses_and_twists(seen)
    check_finite(scene, pose, "MuJoCo")
    return Motion(pose, twist)


class _Together:
    """Worlds that go in step, the longest first, so that effects are asked once for all.

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
        from physid.simulators.mujoco.hooks import Hooks

        self._scene, self._substeps, self._clock = scene, substeps, np.array(clocks)
        self._wrench = [actuated(excitation.wrench, effects, scene.time_step) for excitation in excitations]
        pose = np.stack([excitation.pose for excitation in excitations])
        twist = np.stack([excitation.twist for excitation in excitations])
        self._hooks = Hooks(scene, effects, pose, twist, scene.time_step / substeps)
        for engine, *state in zip(self._hooks.engines, self._hooks.start(pose), twist, strict=True):
            engine.set_state(*state)

    def motions(self) -> list[Motion]:
        """Step all worlds to their ends."""
        engines = self._hooks.engines
        seen = [[engine.state()] for engine in engines]
        running = len(engines)
        for frame in range(len(self._wrench[0]) - 1):
            still = sum(len(wrench) > frame + 1 for wrench in self._wrench)
            if still < running:
                running = still
                self._hooks.keep(running)
            held = np.stack([wrench[frame] for wrench in self._wrench[:running]])
            for part in range(self._substeps):
                time = self._clock[:running] + self._scene.time_step * (frame + part / self._substeps)
                self._hooks.act(time, held)
                for engine in engines[:running]:
                    engine.advance()
            for world in range(running):
                seen[world].append(engines[world].state())
        return [_motion(self._scene, states) for states in seen]
