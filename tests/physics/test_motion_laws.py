"""Motion of bodies apart from contacts, against conservation laws; units of the contact problem."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from physics.worlds import boxes
from physid.physics import State, StepInputs, World
from physid.physics.case import nominal_inputs
from physid.physics.rotations import conjugate, exponential, logarithm, multiply, normalize, rotate, to_matrix
from physid.physics.schemes.motion import MassCentres, acting, drift, drifted, moved, newton_euler, state_of
from physid.physics.schemes.units import FINE, STANDARD_GRAVITY, Units, velocity_unit

DTYPE = torch.float64
H = 1 / 60
FALL = STANDARD_GRAVITY * H
MOMENTS = torch.tensor([0.5, 0.8, 1.2], dtype=DTYPE)


def uniform(*shape: int, seed: int = 0) -> Tensor:
    return 2 * torch.rand(*shape, generator=torch.Generator().manual_seed(seed), dtype=DTYPE) - 1


def one(value: float) -> Tensor:
    return torch.tensor([value], dtype=DTYPE)


def free(spin: Tensor, time: float, *, gyroscopic: bool = True) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Return quaternions and angular velocities (body frame) before and after a time in which nothing acts."""
    batch = len(spin)
    quaternion = normalize(uniform(batch, 1, 4, seed=1))
    twist = torch.cat([rotate(quaternion, spin[:, None]), uniform(batch, 1, 3, seed=2)], -1)
    centre = uniform(batch, 1, 3, seed=3)
    place, turned, after = drift(
        centre, quaternion, twist, MOMENTS.expand(batch, 1, 3), one(time), gyroscopic=gyroscopic
    )
    torch.testing.assert_close(place, centre + time * twist[..., 3:])
    assert torch.equal(after[..., 3:], twist[..., 3:])
    return quaternion[:, 0], spin, turned[:, 0], rotate(conjugate(turned), after[..., :3])[:, 0]


@pytest.mark.parametrize("speed", [0.01, 3.0, 30.0, 3e3])
def test_a_free_body_keeps_its_angular_momentum_however_fast_and_its_energy_in_turns_below_a_radian(
    speed: float,
) -> None:
    before, spin, after, spin_after = free(speed * uniform(50, 3, seed=4), H / 2)
    momentum = rotate(before, MOMENTS * spin)
    torch.testing.assert_close(rotate(after, MOMENTS * spin_after), momentum, rtol=1e-12, atol=1e-12 * speed)
    energy, energy_after = ((MOMENTS * each.square()).sum(1) for each in (spin, spin_after))
    if speed * H / 2 < 1:
        torch.testing.assert_close(energy_after, energy, rtol=1e-8, atol=0)
    assert bool((energy_after <= energy * MOMENTS.max() / MOMENTS.min()).all())


@pytest.mark.parametrize("speed", [0.5, 10.0])
def test_the_mean_spin_is_half_the_sum_of_those_before_and_after_times_the_tangent_of_the_turn(speed: float) -> None:
    """I W - (t / 2) tan(x) / x (I W) x W = I w with x = t |W| / 2, by the tangent itself."""
    before, spin, after, _ = free(speed * uniform(50, 3, seed=5), H / 2)
    mean = logarithm(multiply(conjugate(before), after)) / (H / 2)
    x = H / 4 * mean.norm(dim=1, keepdim=True)
    left = MOMENTS * mean - H / 4 * torch.tan(x) / x * torch.linalg.cross(MOMENTS * mean, mean)
    torch.testing.assert_close(left, MOMENTS * spin, rtol=0, atol=1e-9 * speed)


def test_without_the_gyroscopic_term_and_about_a_principal_axis_the_angular_velocity_is_kept() -> None:
    before, spin, after, spin_after = free(20 * uniform(50, 3, seed=6), H, gyroscopic=False)
    torch.testing.assert_close(spin_after, spin)
    torch.testing.assert_close(to_matrix(after), to_matrix(multiply(before, exponential(H * spin))))
    before, spin, after, spin_after = free(20 * torch.eye(3, dtype=DTYPE), H)
    torch.testing.assert_close(spin_after, spin)
    torch.testing.assert_close(to_matrix(after), to_matrix(multiply(before, exponential(H * spin))))


def described(bodies: int = 2, batch: int = 5) -> tuple[State, StepInputs]:
    """Return bodies in motion whose centres of mass are off their centres, and what acts on them."""
    quaternion = normalize(uniform(batch, bodies, 4, seed=1))
    now = State(torch.cat([uniform(batch, bodies, 3, seed=2), quaternion], -1), uniform(batch, bodies, 6, seed=3))
    known = boxes(mass=[1.0 + n for n in range(bodies)])
    inputs = nominal_inputs(now, uniform(batch, 1, bodies, 6, seed=4), known, World())
    return now, inputs.replace(
        centre_of_mass=0.1 * uniform(batch, bodies, 3, seed=5), inertia=MOMENTS.expand(batch, bodies, 3)
    )


def test_the_centre_of_mass_moves_as_a_point_of_the_body() -> None:
    now, inputs = described()
    seen = MassCentres.of(now, inputs)
    torch.testing.assert_close(seen.position, now.position + rotate(now.quaternion, inputs.centre_of_mass))
    step = 1e-6
    later = drifted(now, inputs, one(step), gyroscopic=False)
    speed = (MassCentres.of(later, inputs).position - seen.position) / step
    torch.testing.assert_close(seen.twist[..., 3:], speed, rtol=0, atol=1e-8)
    torch.testing.assert_close(moved(seen.twist, -seen.arm), now.twist)
    back = state_of(seen.position, now.quaternion, seen.twist, inputs)
    torch.testing.assert_close(back.pose, now.pose)
    torch.testing.assert_close(back.twist, now.twist)


def test_bodies_are_displaced_by_a_way_and_a_turn_in_the_world() -> None:
    now, inputs = described()
    motion = 0.3 * uniform(5, 2, 6, seed=6)
    centre, quaternion = MassCentres.of(now, inputs).displaced(motion)
    torch.testing.assert_close(centre - MassCentres.of(now, inputs).position, motion[..., 3:])
    torch.testing.assert_close(logarithm(multiply(quaternion, conjugate(now.quaternion))), motion[..., :3])


@pytest.mark.parametrize("gyroscopic", [True, False])
def test_momentum_changes_by_the_forces_on_the_centre_of_mass(gyroscopic: bool) -> None:
    now, inputs = described()
    bodies = MassCentres.of(now, inputs)
    mass, momentum = newton_euler(bodies, inputs, one(H), gyroscopic=gyroscopic)
    axes = to_matrix(now.quaternion)
    inertia = axes @ torch.diag_embed(inputs.inertia) @ axes.mT
    spin = bodies.twist[..., :3]
    angular = (inertia @ spin[..., None])[..., 0]
    torque = inputs.wrench[..., :3] - torch.linalg.cross(bodies.arm, inputs.wrench[..., 3:])
    torque = torque - torch.linalg.cross(spin, angular) * gyroscopic
    force = inputs.wrench[..., 3:] + inputs.mass[..., None] * inputs.gravity
    torch.testing.assert_close(momentum[..., :3], angular + H * torque)
    torch.testing.assert_close(momentum[..., 3:], inputs.mass[..., None] * bodies.twist[..., 3:] + H * force)
    torch.testing.assert_close((mass @ bodies.twist[..., None])[..., :3, 0], angular)
    torch.testing.assert_close(
        (mass @ bodies.twist[..., None])[..., 3:, 0], inputs.mass[..., None] * bodies.twist[..., 3:]
    )


def test_effects_see_the_pose_after_a_time_with_the_velocity_before() -> None:
    now, _ = described()
    assert acting(now, None) is now
    seen = acting(now, one(1e-3))
    torch.testing.assert_close(seen.position, now.position + 1e-3 * now.velocity)
    turned = multiply(exponential(1e-3 * now.angular_velocity), now.quaternion)
    torch.testing.assert_close(seen.quaternion, turned, rtol=0, atol=1e-9)  # but for a third-order angle
    assert torch.equal(seen.twist, now.twist)
    torch.testing.assert_close(seen.quaternion.norm(dim=-1), torch.ones(5, 2, dtype=DTYPE))


@pytest.mark.parametrize("midpoint", [True, False])
@pytest.mark.parametrize("step", [FINE / 10, FINE, 10 * FINE])
def test_velocities_are_in_units_of_g_h_and_under_midpoint_not_of_finer_steps(step: float, midpoint: bool) -> None:
    expected = STANDARD_GRAVITY * (max(step, FINE) if midpoint else step)
    units = Units.of(one(step), torch.tensor([[1.0, 4.0]], dtype=DTYPE), midpoint=midpoint)
    assert velocity_unit(step, midpoint=midpoint) == pytest.approx(expected)
    assert float(units.velocity) == pytest.approx(expected)
    assert (float(units.mass), float(units.impulse)) == pytest.approx((2.5, 2.5 * expected))
