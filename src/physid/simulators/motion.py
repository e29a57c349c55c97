"""What every simulator gives, and what a camera reports of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from physid.scenes import Excitation, Scene

if TYPE_CHECKING:
    from torch import Tensor

    from physid.physics import Effect

Array = NDArray[np.float64]
ROUNDING = 1e-9  # [-] times that differ by no more are the same


@dataclass(frozen=True)
class Motion:
    """What the bodies did, before any camera or sensor.

    Attributes:
        pose: Poses at each frame, shape (T, N, 7).
        twist: Twists at each frame, angular [rad/s] and linear [m/s], shape (T, N, 6).
    """

    pose: Array
    twist: Array


def actuated(wrench: Array, effects: Sequence[Effect], time_step: float) -> Array:
    """Return what commanded wrenches (T, N, 6), each held for a time step [s], become before they act."""
    if not effects:
        return wrench
    import torch

    acting = torch.from_numpy(wrench)[None]
    time = time_step * torch.arange(len(wrench), dtype=torch.float64)[None]
    for effect in effects:
        acting = effect.actuate(acting, time)
    return np.asarray(acting[0].numpy())


def observed(pose: Array, effects: Sequence[Effect], time: Array, frames: NDArray[np.intp] | None = None) -> Array:
    """Return the poses (F, N, 7) that a camera reports under effects: of its clock first, then the others in order.

    When poses are taken is looked up among all instants that were simulated. What else a camera does, it does to its
    own frames: a filter averages these, not what nobody saw between them.

    Args:
        pose: At all instants, shape (T, N, 7).
        effects: In their order.
        time: Of the instants [s], shape (T,).
        frames: Instants of the frames, shape (F,); None for all.
    """
    from physid.physics import Effect

    clocks = [each for each in effects if type(each).elapse is not Effect.elapse]
    seen = _observed(pose, clocks, time)
    if frames is not None:
        seen, time = seen[frames], time[frames]
    return _observed(seen, [each for each in effects if each not in clocks], time)


def _observed(pose: Array, effects: Sequence[Effect], time: Array) -> Array:
    """Let effects change poses (T, N, 7) at times (T,) [s]."""
    if not effects:
        return pose
    import torch

    seen, stamps = torch.from_numpy(pose)[None], torch_stamps(time)
    for effect in effects:
        seen = effect.observe(seen, stamps)
    return np.asarray(seen[0].numpy())


def between_frames(effect: Effect) -> bool:
    """Return whether an effect changes what acts, or when poses are taken, between two frames."""
    from physid.physics import Effect

    return type(effect).actuate is not Effect.actuate or type(effect).elapse is not Effect.elapse


def earliest(effects: Sequence[Effect]) -> float:
    """Return how long before the first frame a camera under the effects takes it [s]."""
    first = 0.0
    for effect in effects:
        first = min(first, float(effect.elapse(torch_stamps(np.array([first])))[0, 0]))
    return -first


def taken(effects: Sequence[Effect], time: Array, end: float) -> NDArray[np.bool_]:
    """Return which poses with stamps (T,) [s] a camera under the effects takes before the end of a motion [s].

    What comes after the last instant nobody has simulated.
    """
    stamps = torch_stamps(time)
    for effect in effects:
        stamps = effect.elapse(stamps)
    inside: NDArray[np.bool_] = (stamps[0] <= end * (1 + ROUNDING)).numpy()
    return inside


def torch_stamps(time: Array) -> Tensor:
    """Return times (T,) as effects take them, shape (1, T)."""
    import torch

    return torch.from_numpy(time)[None]


def check_fit(scene: Scene, excitations: Sequence[Excitation]) -> None:
    """Check that excitations are for the bodies of a scene.

    Raises:
        ValueError: If one is not.
    """
    for excitation in excitations:
        if (bodies := excitation.wrench.shape[1]) != len(scene.bodies):
            raise ValueError(f"excitation must be for the {len(scene.bodies)} bodies of {scene.name}, got {bodies}")


def check_finite(scene: Scene, pose: Array, simulator: str) -> None:
    """Check that a motion stayed within the finite numbers.

    Raises:
        ValueError: If it did not.
    """
    if not np.isfinite(pose).all():
        raise ValueError(f"{simulator} left the finite numbers in scene {scene.name}; check masses, sizes and forces")
