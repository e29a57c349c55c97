"""Free flight with spin: a parabola for the centre, Euler's equations for the attitude."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from physid.scenes.rotations import conjugate, from_vector, multiply, rotate
from physid.simulators.closed_form.path import Path

Array = NDArray[np.float64]
ACCURACY = 1e-12  # relative error of a step of the integration of Euler's equations


def fly(pose: Array, twist: Array, acceleration: Array, drag: float, time_step: float) -> tuple[Array, Array]:
    """Follow the centre of a body that touches nothing.

    Args:
        pose: First pose, shape (7,).
        twist: First twist, shape (6,).
        acceleration: By force and gravity, held from frame to frame, shape (T, 3) [m/s^2].
        drag: Coefficient of viscous drag per mass [1/s].
        time_step: Between frames [s].

    Returns:
        Positions (T, 3) and velocities (T, 3) at the frames.
    """
    places, speeds = [pose[:3]], [twist[3:]]
    for held in acceleration[:-1]:
        paths = [Path(float(x), float(v), float(a), drag) for x, v, a in zip(places[-1], speeds[-1], held, strict=True)]
        places.append(np.array([path.place_at(time_step) for path in paths]))
        speeds.append(np.array([path.speed_at(time_step) for path in paths]))
    return np.stack(places), np.stack(speeds)


def spin(quaternion: Array, angular: Array, moments: Array, times: Array) -> tuple[Array, Array]:
    """Follow the attitude of a body without torque: I w' = -w x I w in the body's axes.

    With equal moments the angular velocity is constant, and the rotation is its exponential; else an integration of
    order 8 (Dormand & Prince 1980).

    Args:
        quaternion: First attitude, shape (4,).
        angular: First angular velocity, world frame [rad/s], shape (3,).
        moments: Principal moments [kg m^2], shape (3,).
        times: [s], shape (T,), the first 0.

    Returns:
        Quaternions (T, 4) and angular velocities, world frame, (T, 3).
    """
    if not angular.any() or np.ptp(moments) == 0:
        turned = multiply(from_vector(times[:, None] * angular), quaternion)
        return turned, np.broadcast_to(angular, (len(times), 3)).copy()

    def slope(_: float, state: Array) -> Array:
        q, w = state[:4], state[4:]
        return np.concatenate([0.5 * multiply(q, np.append(w, 0.0)), np.cross(moments * w, w) / moments])

    start = np.concatenate([quaternion, rotate(conjugate(quaternion), angular)])
    found = solve_ivp(slope, (0.0, times[-1]), start, "DOP853", times, rtol=ACCURACY, atol=ACCURACY)
    turned = found.y[:4].T / np.linalg.norm(found.y[:4].T, axis=1, keepdims=True)
    return turned, rotate(turned, found.y[4:].T)
