"""Rigid contact by MuJoCo's solver: the reference acceleration of each contact row is set between its stages.

MuJoCo's own reference is that of a spring and a damper, so that a body bounces off although its restitution is 0, and
its convex cone lifts bodies that slide (by 0.1 to 1.7 mm; docs/decisions/0021-rigid-contact-in-mujoco.md). Here it is

    normal:      a_n = (u - v_n) / h - mu |a - a_t|,  u = -e v_n at an impact, 0 at rest
    tangential:  a_t = -v_t / (s h), what ends the slip (s = 1) or its mean (s = 1/2) in a step if the cone allows it

The second term of the normal row undoes the lift of the convex cone (de Saxce & Feng 1998): its solution accelerates
along the normal by mu |a - a_t| more than the reference, a being the tangential acceleration that comes out. That is
found by iterating the solver. With s = 1/2 friction opposes the mean slip of the step, which is of second order; where
the slip would turn back within the step, s = 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
LIFT_TOLERANCE = 1e-9  # [m/s] how well the lift must be known: 1e-12 m per step of 1 ms, far below what tilts a face
MOST_ROUNDS = 30  # of the solver; each gains a factor of about mu^2
LEAST_FRICTION = 1e-5  # [-] mjMINMU: MuJoCo has no less, so that smooth contacts are given another reference
SOFTER = 100.0  # factor on MuJoCo's least softness, 1e-4: four corners of a face share its load by their softness
SLOW = 1e-5  # [m/s] slip that may turn back within a step without notice


@dataclass(frozen=True)
class Solution:
    """What a step does.

    Attributes:
        velocity: After it, as MuJoCo orders them, shape (6 N,).
        kept: About the part of the step until the first slip ends; 1 if none does.
    """

    velocity: Array
    kept: float


def solve(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    friction: Array,
    least: Array,
    length: float,
    *,
    softness: Array | None,
    slow: float = 0.0,
) -> Solution:
    """Find the velocities after a step whose contacts have been looked for by `mj_step1`.

    Args:
        model: The world.
        data: Its state, and the contacts.
        friction: Coulomb coefficient of each contact [-], shape (C,).
        least: Least normal velocity of each contact after the step [m/s], shape (C,).
        length: Of the step [s].
        softness: Factor on MuJoCo's least softness, shape (C,); None where bodies hit each other: impulses are then
            exact, and friction opposes the slip after them.
        slow: Slip [m/s] that is none: of the point of a turning body that has come to the ground.

    Returns:
        The solution.
    """
    velocity, impact = data.efc_vel.reshape(-1, 3).copy(), softness is None
    if softness is not None:
        data.efc_R.reshape(-1, 3)[:] *= softness[:, None]
        data.efc_D.reshape(-1, 3)[:] /= softness[:, None]
    mujoco.mj_fwdActuation(model, data)
    mujoco.mj_fwdAcceleration(model, data)
    slip = velocity[:, 1:]
    size = np.hypot(slip[:, 0], slip[:, 1])
    share = np.where((size > slow + SLOW) & (not impact), 0.5, 1.0)
    rest = (least - velocity[:, 0]) / length
    while True:
        change = _accelerate(model, data, friction, rest, share * length)
        turned = (slip * (slip + length * change)).sum(1) < 0
        early = turned & (share < 1)
        if not early.any():
            break
        share[early] = 1.0
    after = slip + length * change
    size_after = np.hypot(after[:, 0], after[:, 1])
    kept = 1.0 if impact else _before_turning(size, size_after, turned, data.efc_force[::3] > 0, slow + SLOW)
    return Solution(np.asarray(data.qvel + length * data.qacc), kept)


def _before_turning(size: Array, size_after: Array, turned: Flags, pressed: Flags, slow: float) -> float:
    """Return the part of a step until the first slip ends, half of it where it stays at rest; 1 if none ends."""
    ends = pressed & (size > slow) & (turned | (size_after <= slow))
    if not ends.any():
        return 1.0
    return float(np.where(size_after > slow, size / (size + size_after), 0.5)[ends].min())


def _accelerate(model: mujoco.MjModel, data: mujoco.MjData, friction: Array, rest: Array, time: Array) -> Array:
    """Solve for the accelerations, beginning with those of the step before.

    Args:
        model: The world.
        data: Its state, and the contacts.
        friction: Coulomb coefficient of each contact [-], shape (C,).
        rest: Least normal accelerations [m/s^2], shape (C,).
        time: In which friction is to end the slip [s], shape (C,).

    Returns:
        Tangential accelerations of the contacts, shape (C, 2).
    """
    jacobian, acceleration, forces = data.efc_J.reshape(-1, model.nv), data.qacc, data.efc_force
    wanted = data.efc_aref.reshape(-1, 3)  # MuJoCo's own, not a copy
    np.divide(-data.efc_vel.reshape(-1, 3), time[:, None], out=wanted)
    smooth = friction < LEAST_FRICTION
    if smooth.any():
        wanted[smooth, 1:] = (jacobian @ data.qacc_smooth).reshape(-1, 3)[smooth, 1:]
    softness, tangential = data.efc_R.copy(), wanted[:, 1:]
    missed = (jacobian @ data.qacc_warmstart).reshape(-1, 3)[:, 1:] - tangential
    lift = friction * np.hypot(missed[:, 0], missed[:, 1])
    eased, enough = 1 / (1 + friction**2), LIFT_TOLERANCE / float(time.min())
    for _ in range(MOST_ROUNDS):
        np.subtract(rest, lift, out=wanted[:, 0])
        mujoco.mj_fwdConstraint(model, data)
        found = (jacobian @ acceleration).reshape(-1, 3)[:, 1:]
        missed = found - tangential + (softness * forces).reshape(-1, 3)[:, 1:]
        off = friction * np.hypot(missed[:, 0], missed[:, 1]) - lift
        if max(map(abs, off.tolist())) < enough:
            break
        lift = lift + off * eased
    data.qacc_warmstart[:] = acceleration
    return np.asarray(found)
