"""A scene stepped by PyBullet, with the same inputs and the same effects as the PhysicsLayer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from physid.bullet.engine import Engine, Rows
from physid.scenes.scene import Scene
from physid.scenes.setup import Excitation

if TYPE_CHECKING:
    from physid.physics.effect import Effect


@dataclass(frozen=True)
class Motion:
    """What the bodies did, before any camera or sensor.

    Attributes:
        pose: Poses at each frame, shape (T, N, 7).
        twist: Twists at each frame, angular [rad/s] and linear [m/s], shape (T, N, 6).
    """

    pose: NDArray[np.float64]
    twist: NDArray[np.float64]


def simulate(scene: Scene, excitation: Excitation, effects: Sequence[Effect] = (), substeps: int = 1) -> Motion:
    """Step a scene through a force sequence.

    Row t of the wrench is held from frame t to frame t+1, the last row is not used. Effects change the commanded
    wrenches before they act and the inputs of each step; what they do to the observed pose is `observed`.

    Args:
        scene: The scene, with the parameters to simulate.
        excitation: First state and commanded wrenches (T, N, 6).
        effects: Effects of the catalogue, used unchanged, in this order.
        substeps: Steps of PyBullet between two frames.

    Returns:
        The motion at the T frames.

    Raises:
        ValueError: If the excitation does not fit the scene, or the motion is not finite.
    """
    bodies = excitation.wrench.shape[1]
    if bodies != len(scene.bodies):
        raise ValueError(f"excitation must be for the {len(scene.bodies)} bodies of {scene.name}, got {bodies}")
    step, wrench, start, hooks = scene.time_step / substeps, excitation.wrench, excitation.pose, None
    if effects:
        from physid.bullet.hooks import Hooks

        hooks = Hooks(scene, effects)
        wrench = hooks.actuate(wrench)
        world = hooks.build(scene, start, excitation.twist, step)
        start = hooks.start(start)
    else:
        world = Engine(scene, step)
    with world as engine:
        engine.set_state(start, excitation.twist)
        place, motion = engine.read()
        places, motions = [place], [motion]
        for frame, load in enumerate(wrench[:-1].tolist()):
            for part in range(substeps):
                if hooks is None:
                    engine.push(place, load)
                else:
                    hooks.act(engine, scene.time_step * frame + step * part, place, motion, load)
                engine.step()
                place, motion = engine.read()
            places.append(place)
            motions.append(motion)
    pose, twist = _table(places), _table(motions)
    if not np.isfinite(pose).all():
        raise ValueError(f"PyBullet left the finite numbers in scene {scene.name}; check masses, sizes and forces")
    return Motion(pose, twist)


def _table(rows: list[Rows]) -> NDArray[np.float64]:
    """Return rows of numbers (T, N, K) as an array; np.array takes several times longer."""
    shape = len(rows), len(rows[0]), len(rows[0][0])
    numbers = chain.from_iterable(chain.from_iterable(rows))
    return np.fromiter(numbers, np.float64, shape[0] * shape[1] * shape[2]).reshape(shape)


def observed(pose: NDArray[np.float64], effects: Sequence[Effect], time_step: float) -> NDArray[np.float64]:
    """Return the poses (T, N, 7) that the camera reports under the effects, in their order."""
    if not effects:
        return pose
    import torch

    seen = torch.from_numpy(pose)[None]
    for effect in effects:
        seen = effect.observe(seen, time_step)
    return np.asarray(seen[0].numpy())
