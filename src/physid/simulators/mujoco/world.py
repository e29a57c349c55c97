"""A scene stepped by MuJoCo, with the same inputs and the same effects as the PhysicsLayer."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from physid.scenes import Excitation, Scene
from physid.simulators.in_step import longest_first, step_all
from physid.simulators.motion import Motion, actuated, check_finite, check_fit
from physid.simulators.mujoco.engine import Engine, poses_and_twists

if TYPE_CHECKING:
    from physid.physics import Effect

Array = NDArray[np.float64]


def simulate_all(
    scene: Scene,
    excitations: Sequence[Excitation],
    effects: Sequence[Effect] = (),
    substeps: int = 1,
    clocks: Sequence[float] | None = None,
) -> list[Motion]:
    """Step a scene through several force sequences (see `physid.simulators.protocol.Simulator.simulate`)."""
    check_fit(scene, excitations)
    wrenches = [actuated(excitation.wrench, effects, scene.time_step) for excitation in excitations]
    step = scene.time_step / substeps
    if not any(_acts(effect) for effect in effects):
        engine = Engine(scene, step)
        return [_alone(scene, engine, *each, substeps) for each in zip(excitations, wrenches, strict=True)]
    from physid.simulators.mujoco.hooks import Hooks

    order, times = longest_first(excitations), np.zeros(len(excitations)) if clocks is None else np.array(clocks)
    pose, twist = (np.stack([getattr(excitations[k], name) for k in order]) for name in ("pose", "twist"))
    seen = step_all(
        Hooks(scene, effects, pose, twist, step), [wrenches[k] for k in order], times[order], scene.time_step, substeps
    )
    motions = dict(zip(order, (_motion(scene, states) for states in seen), strict=True))
    return [motions[world] for world in range(len(excitations))]


def _acts(effect: Effect) -> bool:
    """Tell whether an effect changes the inputs of a step, or a simulator's own settings."""
    from physid.physics import Effect

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
