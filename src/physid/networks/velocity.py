"""Velocities from encoded poses, never regressed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from physid.networks.symmetry import Symmetry, nearest
from physid.physics import Parameters, check_shape
from physid.physics.rotations import conjugate, logarithm, multiply, rotate


@dataclass(frozen=True)
class VelocityEstimate:
    """Twists, and how far the two intervals that they come from disagree.

    Attributes:
        twist: Angular [rad/s], then linear velocity [m/s], shape (B, N, 6).
        disagreement: Norm of the difference between the two estimates, angular [rad/s] and linear [m/s], shape
            (B, N, 2): far above the noise where a collision lies between the frames.
    """

    twist: Tensor
    disagreement: Tensor


def _acceleration(force: Tensor, quaternion: Tensor, parameters: Parameters) -> Tensor:
    """Divide effective wrenches (B, S, N, 6) by inertia and mass: [rad/s^2], [m/s^2]."""
    turn = quaternion[:, None].expand(*force.shape[:-1], 4)
    inertia = parameters.inertia[:, None]
    angular = rotate(turn, rotate(conjugate(turn), force[..., :3]) / inertia)
    return torch.cat([angular, force[..., 3:] / parameters.mass[:, None, :, None]], -1)


def _average(first: Tensor, second: Tensor, duration: float) -> Tensor:
    """Compute the mean twist (..., 6) between two poses (..., 7), in world axes."""
    turn = multiply(second[..., 3:], conjugate(first[..., 3:]))
    return torch.cat([logarithm(turn), second[..., :3] - first[..., :3]], -1) / duration


def _gain(acceleration: Tensor, time_step: float, within: float) -> tuple[Tensor, Tensor]:
    """Find how the velocity at the start and at the end of S steps differs from its mean over them.

    A step takes v to v + a h and p to p + h v + within a h^2, hence the mean is v(start) + h sum_j a_j (S - 1 - j +
    within) / S.
    """
    steps = acceleration.shape[1]
    share = (steps - 1 + within - torch.arange(steps).to(acceleration)) / steps
    from_start = time_step * (share[:, None, None] * acceleration).sum(1)
    return -from_start, time_step * acceleration.sum(1) - from_start


def velocity_from_poses(
    pose: Tensor,
    force: Tensor,
    parameters: Parameters,
    time_step: float,
    *,
    at: int = 0,
    substeps: int | None = None,
    tolerance: tuple[float, float] = (2.0, 0.3),
    symmetries: Sequence[Symmetry] | None = None,
) -> VelocityEstimate:
    """Estimate the twist at one of three poses from the mean velocities between them (eq. (4) of the paper).

    v(t1) = (p(t1) - p(t0)) / (t1 - t0) + f_eff / (2 m) (t1 - t0), and the like for every pair of interval and
    instant: each interval gives an estimate, carried to the chosen instant by the effective force. The two are
    averaged where they agree, which is exact for constant acceleration; where they differ by more than `tolerance`
    (a collision lies in one of them) the interval that touches the instant counts alone: with r = difference /
    tolerance the other one has the weight exp(-r^2) / (1 + exp(-r^2)). At the middle pose both touch it, and both count
    half, as in the paper.

    Args:
        pose: Three poses of each body, S frames apart; shape (B, 3, N, 7).
        force: Effective torque [N m] and force [N] on each body, friction and weight included, held from frame to
            frame over the 2 S frames that the poses span; shape (B, 2 S, N, 6). Eq. (4) has S = 1.
        parameters: Masses and inertias.
        time_step: Time between frames [s].
        at: Which of the three poses the velocity belongs to: 0, 1 or 2.
        substeps: None for motion in continuous time as in eq. (4); n for frames made by n steps of a semi-implicit
            integrator (v += a h, then p += v h), whose mean velocity lies (1 - 1 / n) a h / 2 before that at the end.
        tolerance: Difference that noise explains, angular [rad/s] and linear [m/s].
        symmetries: One of each body; poses are then compared modulo it.

    Returns:
        The twists at the chosen pose and the disagreement.

    Raises:
        ValueError: If a shape is off, or `at` is not one of the three.
    """
    check_shape("pose", pose, (None, 3, None, 7))
    check_shape("force", force, (len(pose), None, pose.shape[2], 6))
    if force.shape[1] % 2 or not force.shape[1]:
        raise ValueError(f"force must span two equal intervals, an even number of frames, got {force.shape[1]}")
    if at not in (0, 1, 2):
        raise ValueError(f"at must be 0, 1 or 2, one of the three poses, got {at}")
    pose = _unwrapped(pose, symmetries or [Symmetry.NONE] * pose.shape[2])
    stride = force.shape[1] // 2
    within = 0.5 if substeps is None else (1 + 1 / substeps) / 2
    acceleration = _acceleration(force, pose[:, at, :, 3:], parameters)
    estimates = []
    for interval in (0, 1):
        mean = _average(pose[:, interval], pose[:, interval + 1], stride * time_step)
        during, other = torch.split(acceleration, stride, 1)[:: 1 - 2 * interval]
        to_start, to_end = _gain(during, time_step, within)
        touches = at in (interval, interval + 1)
        carry = to_end if at > interval else to_start
        # From the pose that both intervals share, onwards or back through the other interval.
        beyond = torch.zeros_like(carry) if touches else time_step * other.sum(1) * (1 if at == 2 else -1)
        estimates.append(mean + carry + beyond)
    return _merged(estimates, at, pose.new_tensor(tolerance))


def _unwrapped(pose: Tensor, symmetries: Sequence[Symmetry]) -> Tensor:
    """Choose, of the rotations that look alike, those nearest to the middle pose."""
    turn = nearest(pose[..., 3:], pose[:, 1:2, :, 3:].expand_as(pose[..., 3:]), symmetries)
    return torch.cat([pose[..., :3], turn], -1)


def _merged(estimates: list[Tensor], at: int, tolerance: Tensor) -> VelocityEstimate:
    """Average two estimates (B, N, 6), each of angular and linear velocity by itself."""
    first, second = (torch.unflatten(e, -1, (2, 3)) for e in estimates)
    near, far = (second, first) if at == 2 else (first, second)
    disagreement = (second - first).norm(dim=-1)
    agree = torch.exp(-((disagreement.detach() / tolerance) ** 2))
    weight = (agree / (1 + agree))[..., None] if at != 1 else 0.5
    return VelocityEstimate((near + weight * (far - near)).flatten(-2), disagreement)
