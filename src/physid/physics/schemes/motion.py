"""Bodies apart from contacts: mass and momentum under known forces, and the motion of those that nothing acts on."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from physid.physics.effect import StepInputs
from physid.physics.rotations import conjugate, exponential, multiply, normalize, rotate, to_matrix
from physid.physics.state import State

NEWTON_STEPS = (1, 2)
"""Of the mean angular velocity of a step, with the derivative at the first guess and at what came of it."""

DIVERGED = 2.0
"""Newton's method has failed where W.I W exceeds so many times w.I w, which bounds it: turns of some radians [-]."""

TANGENT = ((10395.0, -1260.0, 21.0, 0.0), (10395.0, -4725.0, 210.0, -1.0))
"""tan(x) / x as a ratio of polynomials in x^2, to 1e-13 for x < 0.3 and 1e-9 for x < 1 (Pade)."""


@dataclass(frozen=True)
class MassCentres:
    """Bodies seen at their centres of mass, about which the laws of motion are written.

    Attributes:
        state: The state, that of the centres of the boxes.
        arm: From these to the centres of mass, world frame [m], shape (B, N, 3).
        twist: Angular and linear velocity of the centres of mass, world frame, shape (B, N, 6).
    """

    state: State
    arm: Tensor
    twist: Tensor

    @classmethod
    def of(cls, state: State, inputs: StepInputs) -> MassCentres:
        """See the bodies of a state at their centres of mass."""
        arm = rotate(state.quaternion, inputs.centre_of_mass)
        return cls(state, arm, moved(state.twist, arm))

    @property
    def position(self) -> Tensor:
        """The centres of mass [m], shape (B, N, 3)."""
        return self.state.position + self.arm

    def displaced(self, motion: Tensor) -> tuple[Tensor, Tensor]:
        """Return centres of mass (B, N, 3) and quaternions (B, N, 4) after a turn and a way (B, N, 6) [rad, m]."""
        position = self.position + motion[..., 3:]
        return position, normalize(multiply(exponential(motion[..., :3]), self.state.quaternion))


def state_of(centre: Tensor, quaternion: Tensor, twist: Tensor, inputs: StepInputs) -> State:
    """Return the state of bodies from their centres of mass (B, N, 3), quaternions, and twists of the centres."""
    arm = rotate(quaternion, inputs.centre_of_mass)
    return State(torch.cat([centre - arm, quaternion], -1), moved(twist, -arm))


def newton_euler(bodies: MassCentres, inputs: StepInputs, step: Tensor, *, gyroscopic: bool) -> tuple[Tensor, Tensor]:
    """Return M (B, N, 6, 6) and p = M v + h f (B, N, 6) (eq. (2) of the paper).

    Args:
        bodies: Before the step.
        inputs: Gives masses, moments, and forces.
        step: h [s], shape (B or 1,).
        gyroscopic: Whether the torque -w x I w is one of the forces.
    """
    axes = to_matrix(bodies.state.quaternion)
    inertia = (axes * inputs.inertia[..., None, :]) @ axes.mT
    eye = torch.eye(3, dtype=inertia.dtype, device=inertia.device)
    zero = torch.zeros_like(inertia)
    mass = torch.cat([torch.cat([inertia, zero], -1), torch.cat([zero, inputs.mass[..., None, None] * eye], -1)], -2)
    spin = bodies.twist[..., :3]
    spin_momentum = (inertia @ spin[..., None])[..., 0]
    torque = inputs.wrench[..., :3] - torch.linalg.cross(bodies.arm, inputs.wrench[..., 3:])
    if gyroscopic:
        torque = torque - torch.linalg.cross(spin, spin_momentum)
    force = inputs.wrench[..., 3:] + inputs.mass[..., None] * inputs.gravity
    momentum = torch.cat([spin_momentum, inputs.mass[..., None] * bodies.twist[..., 3:]], -1)
    return mass, momentum + step[:, None, None] * torch.cat([torque, force], -1)


def drift(
    centre: Tensor, quaternion: Tensor, twist: Tensor, inertia: Tensor, time: Tensor, *, gyroscopic: bool
) -> tuple[Tensor, Tensor, Tensor]:
    """Move bodies on which nothing acts, x+ = x + t v and q+ = q exp(t W) with the mean W of the turning (body frame).

    Args:
        centre: Centres of mass [m], shape (B, N, 3).
        quaternion: Shape (B, N, 4).
        twist: Angular and linear velocity of the centre of mass, world frame, shape (B, N, 6).
        inertia: Principal moments [kg m^2], shape (B, N, 3).
        time: t [s], shape (B or 1,).
        gyroscopic: Whether the angular momentum is kept, or else the angular velocity.

    Returns:
        The same three after the time t.
    """
    time = time[:, None, None]
    spin = rotate(conjugate(quaternion), twist[..., :3])
    mean = _mean_spin(spin, inertia, time) if gyroscopic else spin
    turn = exponential(time * mean)
    after = rotate(conjugate(turn), inertia * spin) / inertia if gyroscopic else spin
    quaternion = normalize(multiply(quaternion, turn))
    return centre + time * twist[..., 3:], quaternion, torch.cat([rotate(quaternion, after), twist[..., 3:]], -1)


def moved(twist: Tensor, arm: Tensor) -> Tensor:
    """Return the twists seen at points `arm` away, v + w x arm."""
    return torch.cat([twist[..., :3], twist[..., 3:] + torch.linalg.cross(twist[..., :3], arm)], -1)


def drifted(state: State, inputs: StepInputs, time: Tensor, *, gyroscopic: bool) -> State:
    """Return the states after a time [s], shape (B or 1,), in which nothing acts."""
    bodies = MassCentres.of(state, inputs)
    motion = bodies.position, state.quaternion, bodies.twist
    return state_of(*drift(*motion, inputs.inertia, time, gyroscopic=gyroscopic), inputs)


def acting(state: State, time: Tensor | None) -> State:
    """Return the states that effects see: of pose those after a time [s], shape (B or 1,), with the velocity before.

    None stands for no time. Forces that depend on the pose are then of second order too.
    """
    if time is None:
        return state
    time = time[:, None, None]
    # q + t w q / 2 made a unit again is exp(t w) q but for a third-order angle, at a third of the cost.
    turn = torch.cat([time / 2 * state.angular_velocity, torch.ones_like(state.pose[..., :1])], -1)
    turned = normalize(multiply(turn, state.quaternion))
    return state.replace(pose=torch.cat([state.position + time * state.velocity, turned], -1))


def _mean_spin(spin: Tensor, inertia: Tensor, time: Tensor) -> Tensor:
    """Return the mean W = (w + w+) / 2 of a free body, where I w+ = exp(-t W) I w (all in the body frame).

    The rotation by t W takes the angular momentum along, and changes it across W only, so that w+.I w+ = w.I w:
    momentum and energy are kept, whatever t. With x = t |W| / 2 the condition reads

        I W - (t / 2) tan(x) / x (I W) x W = I w.

    Both ends have the same energy, so that W.I W <= w.I w. Where Newton's method leaves that, as it may in turns of
    some radians, W is w: momentum is kept still, energy no longer.
    """
    mean = spin
    for steps in NEWTON_STEPS:
        # Held constant: its derivative comes with the error, which the last steps leave at zero.
        inverse = torch.linalg.inv(_slope(mean, inertia, time[..., 0] / 2).detach())
        for _ in range(steps):
            mean = mean - (inverse @ _error(mean, spin, inertia, time)[..., None])[..., 0]
    energy, most = (inertia * mean.square()).sum(-1), DIVERGED * (inertia * spin.square()).sum(-1)
    return torch.where((energy > most)[..., None], spin, mean)


def _error(mean: Tensor, spin: Tensor, inertia: Tensor, time: Tensor) -> Tensor:
    """Return I W - (t / 2) tan(x) / x (I W) x W - I w."""
    x = (time / 2) ** 2 * mean.square().sum(-1, keepdim=True)
    above, below = (a + x * (b + x * (c + x * d)) for a, b, c, d in TANGENT)
    error: Tensor = inertia * (mean - spin) - time / 2 * (above / below) * torch.linalg.cross(inertia * mean, mean)
    return error


def _slope(mean: Tensor, inertia: Tensor, half: Tensor) -> Tensor:
    """Return the derivative of the error by W with tan(x) / x = 1, shape (..., 3, 3).

    The components of (I W) x W are (I_y - I_z) W_y W_z and so on.
    """
    x, y, z = mean.unbind(-1)
    i, j, k = inertia.unbind(-1)
    a, b, c = half * (j - k), half * (k - i), half * (i - j)
    rows = ((i, -a * z, -a * y), (-b * z, j, -b * x), (-c * y, -c * x, k))
    return torch.stack([torch.stack(row, -1) for row in rows], -2)
