"""Newton-Euler equations of one body, and its motion over a step."""

from __future__ import annotations

from physid.compiler.graph import Value, stop, where
from physid.compiler.section import Record
from physid.physics.fused.formulas.algebra import (
    Matrix,
    add,
    apply,
    cross,
    dot,
    exponential,
    multiply,
    scale,
    subtract,
    to_matrix,
    transpose,
    unit,
)  # fmt: skip


def symmetric(values: list[Value]) -> Matrix:
    """Return a symmetric matrix from xx xy xz yy yz zz."""
    xx, xy, xz, yy, yz, zz = values
    return [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]


def _in_world(axes: Matrix, moments: list[Value]) -> list[Value]:
    """Return R diag(moments) R^T as xx xy xz yy yz zz."""
    return [dot([a * m for a, m in zip(axes[i], moments, strict=True)], axes[j]) for i in range(3) for j in range(i, 3)]


def prepare(body: Record, shared: Record, constants: Record, *, midpoint: bool = False, grounded: bool = False) -> None:
    """Compute axes, centre of mass, inertia and momentum p = M v + h f with the gyroscopic torque (eq. (2)).

    At the midpoint that torque has no place, since `drift` turns free bodies, and the free velocity has a derivative.
    Of a `grounded` body `ground.touch_ground` adds what friction gives before an impact to this momentum.
    """
    h, velocity_unit, mean = constants.one("step"), constants.one("unit"), shared.one("mean_mass")
    axes = to_matrix(body["pose"][3:])
    arm = apply(axes, body["centre_of_mass"])
    spin, linear = body["twist"][:3], body["twist"][3:]
    linear = add(linear, cross(spin, arm))
    moments, mass = body["inertia"], body.one("mass")
    inertia = _in_world(axes, moments)
    angular = apply(symmetric(inertia), spin)
    torque, force = body["wrench"][:3], body["wrench"][3:]
    torque = subtract(torque, cross(arm, force))
    if not midpoint:
        torque = subtract(torque, scale(constants.one("gyroscopic"), cross(spin, angular)))
    force = add(force, scale(mass, body["gravity"]))
    momentum = [*add(angular, scale(h, torque)), *add(scale(mass, linear), scale(h, force))]
    body["axes"] = [value for row in axes for value in row]
    body["centre"] = add(body["pose"][:3], arm)
    body["velocity"] = [*spin, *linear]
    body["world_inertia"] = scale(1.0 / mean, inertia)
    body["share"] = [mass / mean]
    body["free_momentum" if grounded else "momentum"] = scale(1.0 / (mean * velocity_unit), momentum)
    turned = [x / m for x, m in zip(apply(transpose(axes), momentum[:3]), moments, strict=True)]
    free = [*apply(axes, turned), *scale(1.0 / mass, momentum[3:])]
    body["free"] = [value if midpoint else stop(value) for value in scale(1.0 / velocity_unit, free)]


def integrate(body: Record, constants: Record) -> None:
    """Move by the new velocity v+ and the shift d, p+ = p + h (v+ + d) and q+ = exp(h (w+ + d)) q.

    A step of another length than a simulator's moves by the mean velocity of that one instead (see `SemiImplicit`).
    """
    h = constants.one("step")
    after = scale(constants.one("unit"), body["v"])
    single = constants.one("single_step")
    earlier = where(single > 0.0, 0.5 - 0.5 * single / h, 0.0)
    mean = subtract(after, scale(earlier, subtract(after, body["velocity"])))
    motion = add(mean, scale(constants.one("unit"), body["shift"]))
    spin, linear = after[:3], after[3:]
    quaternion = body["pose"][3:]
    arm = apply(to_matrix(quaternion), body["centre_of_mass"])
    centre = add(add(body["pose"][:3], arm), scale(h, motion[3:]))
    quaternion = unit(multiply(exponential(scale(h, motion[:3])), quaternion))
    arm = apply(to_matrix(quaternion), body["centre_of_mass"])
    body["next_pose"] = [*subtract(centre, arm), *quaternion]
    body["next_twist"] = [*spin, *subtract(linear, cross(spin, arm))]
