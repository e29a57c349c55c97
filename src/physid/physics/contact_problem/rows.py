"""What contacts contribute to the contact problem of a step: rows of its matrices, patch by patch."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import torch
from torch import Tensor

from physid.physics.contact import SEVERAL, WARP_COMPLIANCE, Patch, Speculative
from physid.physics.effect import StepInputs
from physid.physics.schemes.impact import bending, damping_time, demand, stuck
from physid.physics.schemes.motion import MassCentres
from physid.physics.schemes.turning import NO_IMPACT, friction_before_impact, turned, turning
from physid.physics.schemes.units import STANDARD_GRAVITY, Units
from physid.physics.shapes.table import find_patches
from physid.physics.world import World

REACH = 0.05
FAR = 1.0


@dataclass(frozen=True)
class Rows:
    """Those of the C contacts of a batch of worlds, in the units of the contact problem (see `ContactProblem`).

    Attributes:
        jacobian: J of the twists of the bodies, shape (B, C, 3, 6 N).
        modes: J of the redundant modes of the patches, their warps and levers (see `Patch`), shape (B, C, 3, m).
        offset: c, shape (B, C).
        slip: What is added to the tangential velocity that friction opposes, shape (B, C, 2).
        friction: mu, shape (B, C).
        compliance: k, shape (B, C).
        share: Which share of the step the impulses act [-], shape (B, C).
        gap: Distances, negative where the bodies overlap [m], shape (B, C).
        before_impact: Momentum that friction has given before an impact, in units of impulses, shape (B, 6 N).
    """

    jacobian: Tensor
    modes: Tensor
    offset: Tensor
    slip: Tensor
    friction: Tensor
    compliance: Tensor
    share: Tensor
    gap: Tensor
    before_impact: Tensor

    @property
    def mode_mass(self) -> Tensor:
        """The mass of the redundant modes, the inverse of their compliance, shape (B, m, m)."""
        batch, count = self.modes.shape[0], self.modes.shape[-1]
        eye = torch.eye(count, dtype=self.modes.dtype, device=self.modes.device)
        return eye.expand(batch, -1, -1) / WARP_COMPLIANCE


def patches_of(pose: Tensor, inputs: StepInputs, world: World) -> list[Patch]:
    """List where bodies at poses (B, N, 7) touch or may touch the ground, if there is one, and each other."""
    ground = None if world.ground is None else (inputs.ground_normal, inputs.ground_offset)
    return find_patches(inputs.shapes, pose, inputs.size, ground)


def rows_of(
    patches: list[Patch], bodies: MassCentres, free: Tensor, inputs: StepInputs, world: World, units: Units
) -> Rows:
    """Write the rows of all patches.

    Args:
        patches: Where bodies touch: those on the ground first.
        bodies: Where forces act, with the twists before the step.
        free: Twists after the step if there were no contact, in units of velocities, shape (B, 6 N).
        inputs: Properties that act during the step.
        world: Ground and rules.
        units: The units.
    """
    unit, batch, count = units.velocity, *bodies.twist.shape[:2]
    patches, jacobians, modes = list(patches), [], []
    offsets, slips, frictions, compliances, shares = [], [], [], [], []
    approaches = [_approach(patch, bodies, free, world, units) for patch in patches]
    met, struck = _met(patches, approaches, count), [free.new_full((batch,), NO_IMPACT)] * count
    moving = bodies.position, bodies.twist, free.unflatten(1, (count, 6)) * unit[:, None, None]
    given = [torch.zeros_like(bodies.twist[:, body]) for body in range(count)]
    demands: list[_Demand] = []
    never = free.new_full((batch,), NO_IMPACT)
    for patch, approach in reversed(list(zip(patches, approaches, strict=True))):  # those between bodies first
        beside = ~met[patch.second], struck[patch.second] if patch.first is None else never
        demands.insert(0, _demand(patch, approach, inputs, world, units, moving, beside))
        if patch.first is None:
            given[patch.second] = demands[0].before_impact
        else:
            for body in (patch.first, patch.second):
                struck[body] = _sooner(struck[body], demands[0])
    for k, (wanted, approach) in enumerate(zip(demands, approaches, strict=True)):
        exists, patch, hit = approach.exists, wanted.patch, wanted.hit[:, None]
        patches[k] = patch
        shares.append(wanted.share)
        slips.append(torch.where(exists[..., None], wanted.slip / unit[:, None, None], 0.0))
        jacobians.append(torch.where(exists[..., None, None], approach.jacobian, 0.0))
        offsets.append(torch.where(exists, wanted.offset / unit[:, None], FAR))
        frictions.append(torch.where(exists, wanted.friction[:, None], 0.0))
        compliances.append(torch.where(exists & ~hit, wanted.compliance[:, None], 0.0))
        modes.append(torch.where(exists[..., None], _redundant_modes(patch, exists, patches, inputs, world), 0.0))
    none = free.new_zeros(batch, 0)
    return Rows(
        before_impact=torch.cat(given, 1) / units.impulse[:, None],
        modes=_place_modes(modes, free),
        jacobian=torch.cat(jacobians, 1) if jacobians else free.new_zeros(batch, 0, 3, 6 * count),
        offset=torch.cat(offsets, 1) if offsets else none,
        slip=torch.cat(slips, 1) if slips else free.new_zeros(batch, 0, 2),
        friction=torch.cat(frictions, 1) if frictions else none,
        compliance=torch.cat(compliances, 1) if compliances else none,
        share=torch.cat(shares, 1) if shares else none,
        gap=torch.cat([patch.gap for patch in patches], 1) if patches else none,
    )


@dataclass(frozen=True)
class _Approach:
    """How the contacts of a patch approach.

    Attributes:
        jacobian: See `_patch_jacobian`.
        velocity: Before the step, in the patch's frame [m/s], shape (B, 4, 3).
        free_speed: Along the normal after the step, if there were no contact [m/s], shape (B, 4).
        exists: Which contacts there are, shape (B, 4).
        reached: Which of them the midpoint rule finds closed in the step (see `schemes.impact`), shape (B, 4).
    """

    jacobian: Tensor
    velocity: Tensor
    free_speed: Tensor
    exists: Tensor
    reached: Tensor


def _approach(patch: Patch, bodies: MassCentres, free: Tensor, world: World, units: Units) -> _Approach:
    """Return how the contacts of a patch approach."""
    h, unit = units.step[:, None], units.velocity
    jacobian = _patch_jacobian(patch, bodies.position)
    velocity = torch.einsum("bckn,bn->bck", jacobian, bodies.twist.flatten(1) / unit[:, None]) * unit[:, None, None]
    free_speed = torch.einsum("bckn,bn->bck", jacobian, free)[..., 0] * unit[:, None]
    reach = REACH + 2 * h * free_speed.detach().abs()
    closes = _stands_for_several(world, h) & (patch.gap < reach)
    exists = patch.active & (world.contact.exists(patch.gap, reach) | closes)
    return _Approach(jacobian, velocity, free_speed, exists, exists & (patch.gap + h * free_speed / 2 < 0))


def _stands_for_several(world: World, step: Tensor) -> Tensor:
    """Return which steps stand for several of a simulator, shape as `step`.

    Contacts that these close, by a rule that begins them in overlap, begin within such a step: it stops bodies where
    they touch (`Speculative`), since they would else fall through the ground for all of it.
    """
    return step > SEVERAL * (math.inf if world.single_step is None else world.single_step)


def _met(patches: list[Patch], approaches: list[_Approach], bodies: int) -> list[Tensor]:
    """Return which bodies reach another one in the step, a mask (B,) of each."""
    met = [torch.zeros_like(patch.active[:, 0]) for patch in patches[:1]] * bodies
    for patch, approach in zip(patches, approaches, strict=True):
        if patch.first is not None:
            for body in (patch.first, patch.second):
                met[body] = met[body] | approach.reached.any(1)
    return met


@dataclass(frozen=True)
class _Demand:
    """What the contacts of a patch demand.

    Attributes:
        patch: The patch.
        offset: c [m/s], shape (B, 4).
        slip: What is added to the tangential velocity that friction opposes [m/s], shape (B, 4, 2).
        share: Which share of the step the impulses act [-], shape (B, 4).
        hit: Whether there is an impact (see `schemes.impact`), shape (B,).
        friction: mu, shape (B,).
        compliance: k, in units of the contact problem, shape (B,).
        before_impact: Momentum that friction has given before an impact with another body [N m s, N s], shape (B, 6).
    """

    patch: Patch
    offset: Tensor
    slip: Tensor
    share: Tensor
    hit: Tensor
    friction: Tensor
    compliance: Tensor
    before_impact: Tensor


def _demand(
    patch: Patch,
    approach: _Approach,
    inputs: StepInputs,
    world: World,
    units: Units,
    bodies: tuple[Tensor, Tensor, Tensor],
    beside: tuple[Tensor, Tensor],
) -> _Demand:
    """Return what the contacts of a patch demand.

    `bodies` are their centres, and twists before and without contact; `beside` says of a body on the ground whether no
    other one is reached in the step, and which share of it is over when one strikes, `NO_IMPACT` where none does.
    """
    h, exists, (alone, before) = units.step, approach.exists, beside
    friction, restitution, compliance = _pair(patch, inputs)
    damped = damping_time(compliance, inputs.mass[:, patch.second])
    pace = 1 / (h / (1.0 if world.midpoint else world.contact.correction) + damped)
    softness = compliance * pace * units.mass / h
    if not world.midpoint:
        speed, bounce = approach.velocity[..., 0], restitution[:, None]
        yields = (compliance > 0)[:, None] & (patch.gap < 0)
        known = patch.gap, speed, approach.free_speed, bounce, h[:, None]
        rigid = world.contact.offset(*known)
        if world.single_step is not None:
            within = _stands_for_several(world, h[:, None]) & (patch.gap >= 0)
            rigid = torch.where(within, Speculative().offset(*known), rigid)
        offset = torch.where(yields, world.contact.spring(patch.gap, speed, bounce, pace[:, None]), rigid)
        slip, share = torch.zeros_like(approach.velocity[..., 1:]), torch.full_like(patch.gap, 0.5)
        never = torch.zeros_like(patch.active[:, 0])
        return _Demand(patch, offset, slip, share, never, friction, softness, torch.zeros_like(bodies[1][:, 0]))
    is_struck = approach.reached.all(1) & (before < NO_IMPACT)
    before = torch.where(is_struck, before, 0.0)
    bend = bending(patch, *bodies[:2])
    turns = turning(patch, *bodies[1:], friction, h[:, None], approach.reached & alone[:, None])
    stiffness = restitution, compliance * units.mass * STANDARD_GRAVITY, damped
    velocities = approach.velocity, approach.free_speed
    wanted = demand(patch, velocities, bend, stiffness, h[:, None], exists, is_struck)
    patch = dataclasses.replace(patch, together=wanted.together)
    slip = turned(wanted.slip, stuck(bend, h[:, None]), turns, wanted.hit)
    gives = friction_before_impact(patch, approach.velocity[..., 1:], bodies[1:], friction, before)
    return _Demand(
        patch, wanted.offset, slip, wanted.share[:, None].expand_as(patch.gap), wanted.hit, friction * (1 - before),
        softness, inputs.mass[:, patch.second, None] * _at_centre(patch, gives, bodies[0]),
    )  # fmt: skip


def _sooner(before: Tensor, demand: _Demand) -> Tensor:
    """Return which share of the step (B,) is over when a body is struck first; `NO_IMPACT` where it is not."""
    share = (1 - demand.share[:, 0]).clamp(0, 1)
    return torch.where(demand.hit, torch.minimum(before, share), before)


def _at_centre(patch: Patch, tangential: Tensor, centres: Tensor) -> Tensor:
    """Return moment and sum (B, 6) of what acts along the two tangents of the contacts of a patch, (B, 4, 2)."""
    force = tangential @ patch.frame[:, 1:]
    return torch.cat([torch.linalg.cross(patch.point - centres[:, None, patch.second], force), force], -1).sum(1)


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
