"""One step of the engine: collect the contacts, solve eq. (3) of the paper, integrate."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn.functional import pad

from physid.physics.contact import WARP_COMPLIANCE, Patch
from physid.physics.contact_problem.implicit import attach_gradient
from physid.physics.contact_problem.lcp import ContactProblem, SolverSettings, solve_contacts
from physid.physics.effect import StepInputs
from physid.physics.joints import equations_of
from physid.physics.rotations import exponential, multiply, normalize, rotate, to_matrix
from physid.physics.schemes.impact import FINE, STANDARD_GRAVITY, bending, damping_time, demand, late, stuck
from physid.physics.schemes.motion import drift, drifted, moved
from physid.physics.schemes.turning import turned, turning
from physid.physics.shapes.table import find_patches
from physid.physics.state import State
from physid.physics.world import World

REACH = 0.05
FAR = 1.0


@dataclass(frozen=True)
class Step:
    """What one step gave.

    Attributes:
        state: The state after it.
        impulse: (normal, tangential) impulses of every contact [N s], shape (B, C, 3).
        residual: Largest violated equation, in units of the smoothing, shape (B,).
        newton_steps: Shape (B,).
        converged: Shape (B,).
    """

    state: State
    impulse: Tensor
    residual: Tensor
    newton_steps: Tensor
    converged: Tensor


def advance(
    state: State, inputs: StepInputs, world: World, settings: SolverSettings, step: Tensor | None = None
) -> Step:
    """Advance a batch by one step.

    Semi-implicit Euler: v+ from eq. (3), p+ = p + h v+, q+ = exp(h w+) q. Midpoint: v+ from eq. (3) at the poses after
    h / 2 with v, and on for h / 2 with v+.

    Args:
        state: The state before.
        inputs: Wrenches and properties that act during the step.
        world: Ground, joints and rules.
        settings: Accuracy of the solver.
        step: h [s], shape (B or 1,); None for `world.step`.

    Returns:
        The state after, the contact impulses, and how well the solver did.
    """
    h = state.pose.new_full((1,), world.step) if step is None else step
    unit = STANDARD_GRAVITY * (h.clamp_min(FINE) if world.midpoint else h)
    before = state
    if world.midpoint:
        state = drifted(state, inputs, h / 2, gyroscopic=world.gyroscopic)
    joints = equations_of(world.joints, state, before, h[:, None], midpoint=world.midpoint)
    arm = rotate(state.quaternion, inputs.centre_of_mass)
    twist = moved(state.twist, arm)
    ground = None if world.ground is None else (inputs.ground_normal, inputs.ground_offset)
    patches = find_patches(inputs.shapes, state.pose, inputs.size, ground)
    problem, scale, share = build_problem(state, twist, arm, patches, inputs, world, (h, unit), joints)
    solution = solve_contacts(problem, world.friction, settings)
    v, impulse = attach_gradient(problem, solution)
    after = v[:, : 6 * twist.shape[1]].unflatten(1, twist.shape[1:]) * unit[:, None, None]
    if world.midpoint:
        motion = late(problem.mass, problem.jacobian, impulse, share, twist.shape[1]) * (unit * h)[:, None, None]
    else:
        motion = h[:, None, None] * after + _removal(problem, twist.shape[1], patches, world, settings, h)
    centre = state.position + arm + motion[..., 3:]
    quaternion = normalize(multiply(exponential(motion[..., :3]), state.quaternion))
    if world.midpoint:
        centre, quaternion, after = drift(centre, quaternion, after, inputs.inertia, h / 2, gyroscopic=world.gyroscopic)
    arm = rotate(quaternion, inputs.centre_of_mass)
    return Step(
        state=State(torch.cat([centre - arm, quaternion], -1), moved(after, -arm)),
        impulse=impulse * scale[:, None, None],
        residual=solution.residual,
        newton_steps=solution.steps,
        converged=solution.converged,
    )


def _removal(
    problem: ContactProblem, bodies: int, patches: list[Patch], world: World, settings: SolverSettings, h: Tensor
) -> Tensor | float:
    """Return the displacement (B, N, 6) [rad, m] by which the rule of contact removes overlaps without velocity.

    It is h v for the v of a second problem: bodies at rest, no friction, u_n >= displacement / h.
    """
    wanted = [d for patch in patches if (d := world.contact.displacement(patch.gap)) is not None]
    touching = (problem.jacobian != 0).any(-1).any(-1)
    if not wanted or not bool(touching.any()):
        return 0.0
    unit = (STANDARD_GRAVITY * h**2)[:, None]
    still = dataclasses.replace(
        problem,
        momentum=torch.zeros_like(problem.momentum),
        offset=torch.where(touching, -torch.cat(wanted, 1) / unit, FAR),
        slip=torch.zeros_like(problem.slip),
        friction=torch.zeros_like(problem.friction),
        joint_velocity=torch.zeros_like(problem.joint_velocity),
    )
    v, _ = attach_gradient(still, solve_contacts(still, world.friction, settings))
    displacement = v[:, : 6 * bodies].unflatten(1, (bodies, 6)) * unit[..., None]
    return torch.where(touching.any(1)[:, None, None], displacement, 0.0)


def build_problem(
    state: State,
    twist: Tensor,
    arm: Tensor,
    patches: list[Patch],
    inputs: StepInputs,
    world: World,
    pace: tuple[Tensor, Tensor],
    joints: tuple[Tensor, Tensor],
) -> tuple[ContactProblem, Tensor, Tensor]:
    """Assemble eq. (3) in units of velocities, g h, and of impulses, m g h.

    The unknown velocity is that of all bodies, followed by the redundant modes of each patch: its warp, and between two
    bodies on the ground its lever (see `Patch`). `pace` are h [s] and g h [m/s], `joints` J_e and b_e.

    Returns:
        The problem, the unit of its impulses [N s], shape (B,), and which share of the step they act, shape (B, C).
    """
    (h, unit), (batch, bodies) = pace, twist.shape[:2]
    mean_mass = inputs.mass.mean(1)
    mass, momentum = _newton_euler(state, twist, arm, inputs, world, h)
    mass, momentum = mass / mean_mass[:, None, None, None], momentum / (mean_mass * unit)[:, None, None]
    free = torch.linalg.solve(mass, momentum).flatten(1)
    rows, offsets, frictions, compliances, modes, shares, slips = [], [], [], [], [], [], []
    for k, patch in enumerate(patches):
        jacobian = _patch_jacobian(patch, state.position + arm)
        velocity = torch.einsum("bckn,bn->bck", jacobian, twist.flatten(1) / unit[:, None]) * unit[:, None, None]
        free_speed = torch.einsum("bckn,bn->bck", jacobian, free)[..., 0] * unit[:, None]
        friction, restitution, compliance = _pair(patch, inputs)
        damped = damping_time(compliance, inputs.mass[:, patch.second])
        correction = (h / (h + damped) if world.midpoint else world.contact.correction) * mean_mass / h**2
        reach = REACH + 2 * h[:, None] * free_speed.detach().abs()
        exists = patch.active & world.contact.exists(patch.gap, reach)
        material = friction, restitution, compliance * mean_mass, damped
        bodies_ = state.position + arm, twist, free.unflatten(1, (bodies, 6)) * unit[:, None, None]
        offset, slip, share, patch = _demand(patch, (velocity, free_speed), world, material, bodies_, h, exists)
        patches[k] = patch
        shares.append(share)
        slips.append(torch.where(exists[..., None], slip / unit[:, None, None], 0.0))
        rows.append(torch.where(exists[..., None, None], jacobian, 0.0))
        offsets.append(torch.where(exists, offset / unit[:, None], FAR))
        frictions.append(torch.where(exists, friction[:, None], 0.0))
        compliances.append(torch.where(exists, (compliance * correction)[:, None], 0.0))
        modes.append(torch.where(exists[..., None], _redundant_modes(patch, exists, patches, inputs, world), 0.0))
    redundant = _place_modes(modes, mass)
    warps = redundant.shape[-1]
    warp_mass = torch.eye(warps, dtype=mass.dtype, device=mass.device).expand(batch, -1, -1) / WARP_COMPLIANCE
    problem = ContactProblem(
        mass=_block_diagonal(mass, warp_mass),
        momentum=torch.cat([momentum.flatten(1), mass.new_zeros(batch, warps)], 1),
        jacobian=torch.cat([torch.cat(rows, 1), redundant], 3) if rows else mass.new_zeros(batch, 0, 3, 6 * bodies),
        offset=torch.cat(offsets, 1) if rows else mass.new_zeros(batch, 0),
        slip=torch.cat(slips, 1) if rows else mass.new_zeros(batch, 0, 2),
        friction=torch.cat(frictions, 1) if rows else mass.new_zeros(batch, 0),
        compliance=torch.cat(compliances, 1) if rows else mass.new_zeros(batch, 0),
        joint_jacobian=pad(joints[0], (0, warps)),
        joint_velocity=joints[1] / unit[:, None],
    )
    return problem, mean_mass * unit, torch.cat(shares, 1) if shares else mass.new_zeros(batch, 0)


def _demand(
    patch: Patch,
    velocities: tuple[Tensor, Tensor],
    world: World,
    material: tuple[Tensor, Tensor, Tensor, Tensor],
    bodies: tuple[Tensor, Tensor, Tensor],
    h: Tensor,
    exists: Tensor,
) -> tuple[Tensor, Tensor, Tensor, Patch]:
    """Return offset, slip [m/s] and share of the contacts of a patch, and the patch (see `schemes.impact`).

    `velocities` are those before and the normal ones without contact, `material` friction, restitution, give per
    gravity and the time of the damper, `bodies` their centres, and twists before and without contact.
    """
    friction, restitution, give, time = material
    if world.midpoint:
        bend = bending(patch, *bodies[:2])
        lies = exists & (patch.gap + h[:, None] * velocities[1] / 2 < 0)
        turns = turning(patch, *bodies[1:], friction, h[:, None], lies)
        stiffness = restitution, give * STANDARD_GRAVITY, time
        wanted = demand(patch, velocities, bend, stiffness, h[:, None], exists)
        patch = dataclasses.replace(patch, together=wanted.together)
        slip = turned(wanted.slip, stuck(bend, h[:, None]), turns, wanted.hit)
        return wanted.offset, slip, wanted.share[:, None].expand_as(patch.gap), patch
    velocity, free_speed = velocities
    offset = world.contact.offset(patch.gap, velocity[..., 0], free_speed, restitution[:, None], h[:, None])
    return offset, torch.zeros_like(velocity[..., 1:]), torch.full_like(patch.gap, 0.5), patch


def _redundant_modes(patch: Patch, exists: Tensor, patches: list[Patch], inputs: StepInputs, world: World) -> Tensor:
    """Return the normal rows of a patch's redundant modes, shape (B, 4, 1 or 2)."""
    if patch.first is None or world.ground is None:
        return patch.warp()[..., None]
    standing = patches[patch.first].flatness() * patches[patch.second].flatness()
    lever = patch.lever(inputs.ground_normal, exists) * standing[:, None]
    return torch.stack([patch.warp(), lever], -1)


def _place_modes(modes: list[Tensor], reference: Tensor) -> Tensor:
    """Give every mode (B, 4, m) of every patch a column of its own; shape (B, C, 3, sum of m)."""
    total, column, rows = sum(mode.shape[-1] for mode in modes), 0, []
    for mode in modes:
        batch, contacts, count = mode.shape
        row = reference.new_zeros(batch, contacts, 3, total)
        row[..., 0, column : column + count] = mode
        rows.append(row)
        column += count
    return torch.cat(rows, 1) if rows else reference.new_zeros(reference.shape[0], 0, 3, 0)


def _newton_euler(
    state: State, twist: Tensor, arm: Tensor, inputs: StepInputs, world: World, h: Tensor
) -> tuple[Tensor, Tensor]:
    """Return M (B, N, 6, 6) and p = M v + h f (B, N, 6), with the gyroscopic torque -w x I w (eq. (2) of the paper)."""
    axes = to_matrix(state.quaternion)
    inertia = (axes * inputs.inertia[..., None, :]) @ axes.mT
    eye = torch.eye(3, dtype=inertia.dtype, device=inertia.device)
    zero = torch.zeros_like(inertia)
    mass = torch.cat([torch.cat([inertia, zero], -1), torch.cat([zero, inputs.mass[..., None, None] * eye], -1)], -2)
    spin = twist[..., :3]
    spin_momentum = (inertia @ spin[..., None])[..., 0]
    torque = inputs.wrench[..., :3] - torch.linalg.cross(arm, inputs.wrench[..., 3:])
    if world.gyroscopic and not world.midpoint:
        torque = torque - torch.linalg.cross(spin, spin_momentum)
    force = inputs.wrench[..., 3:] + inputs.mass[..., None] * inputs.gravity
    momentum = torch.cat([spin_momentum, inputs.mass[..., None] * twist[..., 3:]], -1)
    return mass, momentum + h[:, None, None] * torch.cat([torque, force], -1)


def _patch_jacobian(patch: Patch, centres: Tensor) -> Tensor:
    """Return the rows (B, 4, 3, 6 N) of the velocity of `second` relative to `first`, in the patch's frame."""
    bodies = centres.shape[1]
    frame = patch.frame[:, None].expand(-1, patch.point.shape[1], -1, -1)
    blocks = [torch.zeros(*frame.shape[:3], 6, dtype=frame.dtype, device=frame.device)] * bodies
    for body, sign in ((patch.second, 1.0), (patch.first, -1.0)):
        if body is not None:
            reach = (patch.point - centres[:, None, body])[:, :, None].expand(-1, -1, 3, -1)
            blocks[body] = sign * torch.cat([torch.linalg.cross(reach, frame), frame], -1)
    return torch.cat(blocks, -1)


def _pair(patch: Patch, inputs: StepInputs) -> tuple[Tensor, Tensor, Tensor]:
    """Return friction, restitution and compliance [m/N] of a patch, each of shape (B,): products over the pair."""
    second = patch.second
    if patch.first is None:
        friction = inputs.friction[:, second] * inputs.ground_friction[:, second]
        restitution = inputs.restitution[:, second] + inputs.ground_restitution[:, second]
        return friction, restitution.clamp_min(0), inputs.compliance[:, second]
    friction = inputs.friction[:, patch.first] * inputs.friction[:, second] * inputs.body_friction
    restitution = inputs.restitution[:, patch.first] * inputs.restitution[:, second] + inputs.body_restitution
    return friction, restitution.clamp_min(0), torch.zeros_like(friction)


def _block_diagonal(bodies: Tensor, warp: Tensor) -> Tensor:
    """Put blocks (B, N, 6, 6) and one block (B, P, P) on a diagonal."""
    batch, count = bodies.shape[:2]
    blocks = [bodies[:, n] for n in range(count)] + [warp]
    sizes = [block.shape[-1] for block in blocks]
    rows = []
    for i, block in enumerate(blocks):
        rows.append(
            torch.cat([block if i == j else block.new_zeros(batch, sizes[i], n) for j, n in enumerate(sizes)], 2)
        )
    return torch.cat(rows, 1)
