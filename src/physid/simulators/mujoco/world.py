"""A scene stepped by MuJoCo, with the same inputs as the PhysicsLayer."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from physid.scenes.scene import Scene
from physid.scenes.setup import Excitation
from physid.simulators.motion import Motion
from physid.simulators.mujoco.engine import Engine

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
    """Step a scene through several force sequences.

    Row t of a wrench is held from frame t to frame t+1, the last row is not used.

    Args:
        scene: The scene, with the parameters to simulate.
        excitations: First states and commanded wrenches, of any lengths.
        effects: Effects of the catalogue, used unchanged, in this order.
        substeps: Steps of MuJoCo between two frames.
        clocks: Times that effects see at the first frames [s]; None for 0.

    Returns:
        The motion of each.

    Raises:
        ValueError: If an excitation does not fit the scene, or a motion is not finite.
    """
    for excitation in excitations:
        if (bodies := excitation.wrench.shape[1]) != len(scene.bodies):
            raise ValueError(f"excitation must be for the {len(scene.bodies)} bodies of {scene.name}, got {bodies}")
    if effects:
        raise ValueError("MuJoCo cannot simulate effects yet; choose another simulator, or leave effects out")
    return [_alone(scene, excitation, substeps) for excitation in excitations]


def _alone(scene: Scene, excitation: Excitation, substeps: int) -> Motion:
    """Simulate one trajectory without effects."""
    engine = Engine(scene, scene.time_step / substeps)
    engine.set_state(excitation.pose, excitation.twist)
    seen = [engine.read()]
    for wrench in excitation.wrench[:-1]:
        engine.push(wrench)
        for _ in range(substeps):
            engine.advance()
        seen.append(engine.read())
    pose, twist = (np.stack(values) for values in zip(*seen, strict=True))
    if not np.isfinite(pose).all():
        raise ValueError(f"MuJoCo left the finite numbers in scene {scene.name}; check masses, sizes and forces")
    return Motion(pose, twist)
