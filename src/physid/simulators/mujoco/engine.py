"""A MuJoCo world that obeys the textbook: rigid boxes, Coulomb's cone, Newton's impacts, nothing else.

MuJoCo finds the contacts, solves for the contact forces (see `contact`), and flies free bodies by Runge-Kutta steps. In
contact poses follow by Moreau's midpoint rule, of second order; steps end where a contact begins or a slip ends.
"""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from mujoco import mjtDisableBit
from numpy.typing import NDArray

from physid.scenes import Scene
from physid.scenes.rotations import between, conjugate, rotate
from physid.scenes.setup import REST_DEPTH
from physid.scenes.setups.placing import UP
from physid.simulators.mujoco.contact import LEAST_FRICTION, SOFTER, Solution, solve
from physid.simulators.mujoco.model import build_model

Array = NDArray[np.float64]
GRAVITY = 9.81  # [m/s^2] sets the slowest impact: one that lasts less than a step under this acceleration is a rest
TOUCH = 1e-5  # [m] contacts at most this far apart touch: several times what a step of 1 ms misses a touch-down by
PARTS = 32  # the shortest step is this part of a whole one: around impacts, which begin and end between whole steps
REMOVAL = 50.0  # [1/s] rate at which an overlap of more than REST_DEPTH is taken back: there is hardly any
FASTEST_REMOVAL = 0.01  # [m/s] so that bodies that start in each other do not fly apart
REACH = 2.0  # contacts are looked for as far away as bodies come in this many steps ...
LEAST_REACH = 1e-3  # [m] ... and at least so far
MOST_TRIES = 5  # at the length of a step that ends where a slip does
YIELDING_RATIO = (
    1e6  # softness of a normal row over that of a tangential one, where contacts yield along the normal only
)
FAR = -1e3  # [m/s] normal velocity that a contact out of reach may have: any


class Engine:
    """A MuJoCo world with the bodies of a scene.

    Poses and twists are those of the geometric centres, whatever the centres of mass; wrenches act at the former.

    Args:
        scene: What stands on the ground.
        step: Length of one step [s].
        centres: Offsets of the centres of mass from the geometric centres, body frame [m], shape (N, 3); None for none.
    """

    def __init__(self, scene: Scene, step: float, centres: Array | None = None) -> None:
        count = len(scene.bodies)
        self._model, self._pairs = build_model(scene, np.zeros((count, 3)) if centres is None else centres)
        self._data, self._scratch = mujoco.MjData(self._model), mujoco.MjData(self._model)
        self._step = step
        self._impact = -0.5 * GRAVITY * step  # [m/s] normal velocity below which a contact hits
        # What bounds the speed of any point, from the velocities as MuJoCo orders them [-], [m].
        radius = 0.5 * np.linalg.norm(scene.sizes, axis=1)[:, None]
        self._levers = np.concatenate([np.ones((count, 3)), np.broadcast_to(radius, (count, 3))], 1).ravel()
        self._spins = np.concatenate([np.zeros((count, 3)), np.broadcast_to(radius, (count, 3))], 1).ravel()
        self._number = np.full((count + 1, count + 1), -1)  # of the pair of two geoms, the ground's being 0
        for (first, second), number in self._pairs.items():
            self._number[first + 1, second + 1] = self._number[second + 1, first + 1] = number
        self._friction, self._restitution = np.zeros(len(self._pairs)), np.zeros(len(self._pairs))
        self._compliance = np.zeros(len(self._pairs))
        self.place_ground(np.array(scene.ground.normal), scene.ground.offset)
        friction = np.array([body.friction for body in scene.bodies])
        restitution = np.array([body.restitution for body in scene.bodies])
        self.set_contacts(friction, restitution, np.outer(friction, friction), np.outer(restitution, restitution))

    def place_ground(self, normal: Array, offset: float) -> None:
        """Put the ground so that it holds the points p with normal . p = offset [m]."""
        self._data.mocap_pos[0] = offset * normal
        self._data.mocap_quat[0] = np.roll(between(UP, normal), 1)

    def set_contacts(self, friction: Array, restitution: Array, pair_friction: Array, pair_restitution: Array) -> None:
        """Set the coefficients [-] of bodies with the ground, shape (N,), and with each other, shape (N, N)."""
        for (first, second), number in self._pairs.items():
            mu, e = (friction, restitution) if first < 0 else (pair_friction[first], pair_restitution[first])
            self._friction[number], self._restitution[number] = mu[second], e[second]
        self._model.pair_friction[:, :2] = np.maximum(self._friction, LEAST_FRICTION)[:, None]

    def set_compliance(self, compliance: Array) -> None:
        """Set how far each contact of the bodies with the ground yields under a force [m/N], shape (N,)."""
        for (first, second), number in self._pairs.items():
            self._compliance[number] = compliance[second] if first < 0 else 0.0
        self._model.opt.impratio = YIELDING_RATIO

    def set_inertia(self, mass: Array, moments: Array) -> None:
        """Set the masses [kg], shape (N,), and the principal moments [kg m^2], shape (N, 3)."""
        self._model.body_mass[2:], self._model.body_inertia[2:] = mass, moments
        mujoco.mj_setConst(self._model, self._scratch)

    def set_state(self, pose: Array, twist: Array) -> None:
        """Begin anew with the bodies at poses (N, 7) with twists (N, 6), world frame."""
        ground = self._data.mocap_pos.copy(), self._data.mocap_quat.copy()
        mujoco.mj_resetData(self._model, self._data)
        self._data.mocap_pos[:], self._data.mocap_quat[:] = ground
        place = np.concatenate([pose[:, :3], pose[:, 6:], pose[:, 3:6]], 1)
        spin = rotate(conjugate(pose[:, 3:]), twist[:, :3])
        self._data.qpos[:] = place.ravel()
        self._data.qvel[:] = np.concatenate([twist[:, 3:], spin], 1).ravel()

    def state(self) -> tuple[Array, Array]:
        """Return positions (7 N,) and velocities (6 N,) as MuJoCo orders them; `poses_and_twists` reads them."""
        return self._data.qpos.copy(), self._data.qvel.copy()

    def push(self, wrench: Array, at_mass: Array | None = None) -> None:
        """Apply wrenches (N, 6) at the geometric centres, and forces (N, 3) at the centres of mass; world frame."""
        self._data.qfrc_applied.reshape(-1, 6)[:, :3] = wrench[:, 3:]
        self._data.xfrc_applied[2:, 3:] = wrench[:, :3]
        if at_mass is not None:
            self._data.xfrc_applied[2:, :3] = at_mass

    def advance(self) -> None:
        """Advance by one whole step, in shorter ones where bodies touch down."""
        left = self._step
        while left > 1e-9 * self._step:
            left -= self._part(left)

    def _part(self, longest: float) -> float:
        """Advance by at most `longest` [s] and return by how much."""
        data, start = self._data, self._data.qpos.copy()
        # Moreau's midpoint rule: contacts are those of the mean pose.
        data.qpos[:] = middle = self._moved(start, data.qvel, 0.5 * longest)
        if not self._look(longest):
            data.qpos[:] = start
            return self._fly(longest)
        if self._calm(0.5 * longest):
            found = self._hold(longest, 2 * self._impact)
            if found.kept == 1:
                data.qpos[:], data.qvel[:] = self._moved(middle, found.velocity, 0.5 * longest), found.velocity
                return longest
            data.qpos[:] = start
            return self._keep_touch(start, max(self._step / PARTS, found.kept * longest))
        data.qpos[:] = start
        return self._part_with_touch(start, longest)

    def _calm(self, time: float) -> bool:
        """Tell whether contacts, found so long [s] after the beginning of a step, go on as they are during the step."""
        data = self._data
        gap, normal = data.contact.dist, data.efc_vel[::3]
        touches = gap <= TOUCH
        return bool(np.where(touches, normal >= self._impact, gap + time * normal > TOUCH).all())

    def _part_with_touch(self, start: Array, longest: float) -> float:
        """Advance by at most `longest` [s], in which bodies hit each other or touch down; return by how much."""
        data, shortest = self._data, self._step / PARTS
        if not self._look(longest):
            return self._fly(longest)
        gap, normal = np.array(data.contact.dist), data.efc_vel[::3]
        pair = self._pair()
        hit = (gap <= TOUCH) & (normal < self._impact)
        # What yields takes up a blow by itself, unless it bounces off as it touches.
        hit &= (self._compliance[pair] == 0) | ((self._restitution[pair] > 0) & (gap > -TOUCH))
        if not hit.any():
            return self._keep_touch(start, _until_touch(gap, normal, longest, shortest))
        # Short and with the velocity after the impact, which happens at the step's beginning.
        length = min(longest, shortest)
        bounce = np.where(hit, -self._restitution[pair] * normal, FAR)
        least = np.maximum(_closing(gap), bounce)
        found = solve(self._model, data, self._friction[pair], least, length, softness=None)
        data.qpos[:], data.qvel[:] = self._moved(start, found.velocity, length), found.velocity
        return length

    def _keep_touch(self, start: Array, length: float) -> float:
        """Advance by at most `length` [s], in which nothing hits anything, to where a slip ends; return by how much."""
        data, shortest = self._data, self._step / PARTS
        for _ in range(MOST_TRIES):
            middle = self._moved(start, data.qvel, 0.5 * length)
            data.qpos[:] = middle
            if not self._look(length):
                data.qpos[:] = start
                return self._fly(length)
            found = self._hold(length, 2 * self._impact)
            if found.kept == 1 or length <= shortest:
                break
            length = max(shortest, found.kept * length)
        data.qpos[:], data.qvel[:] = self._moved(middle, found.velocity, 0.5 * length), found.velocity
        return length

    def _hold(self, length: float, landing: float) -> Solution:
        """Solve for a step without impacts at the mean pose; contacts that approach faster than `landing` come later.

        A contact of compliance C is a spring of stiffness 1 / C, critically damped for a quarter of the mass m that
        stands on it, and taken at the end of the step: v+ = -(r + C f) / (h / 2 + sqrt(m C)) for an overlap -r.
        """
        data, pair = self._data, self._pair()
        gap = np.array(data.contact.dist)
        # At the mean pose the point about which a body tips has come down by half a step's centripetal acceleration.
        tipping = length * float(data.qvel**2 @ self._spins)
        least = np.where(data.efc_vel[::3] < landing - tipping, FAR, _closing(gap))
        softness = np.full(len(gap), SOFTER)
        compliance = self._compliance[pair]
        yields = compliance > 0
        if yields.any():
            mass = self._model.body_mass[1 + data.contact.geom.max(1)]
            time = 0.5 * length + np.sqrt(mass * compliance)
            least = np.where(yields, np.where(gap > TOUCH, FAR, -gap / time), least)
            softness = np.where(yields, compliance / (length * time) / data.efc_R[::3], softness)
        return solve(self._model, data, self._friction[pair], least, length, softness=softness, slow=tipping)

    def _look(self, longest: float) -> bool:
        """Look for contacts within reach and tell whether there are any."""
        self._model.pair_margin[:] = LEAST_REACH + REACH * longest * (np.abs(self._data.qvel) @ self._levers)
        mujoco.mj_step1(self._model, self._data)
        return bool(self._data.ncon)

    def _pair(self) -> Array:
        """Return the number of the pair of each contact, shape (C,)."""
        return np.asarray(self._number[tuple(self._data.contact.geom.T)])

    def _moved(self, place: Array, motion: Array, time: float) -> Array:
        """Return the positions that follow from constant velocities (6 N,) after so long [s]."""
        moved = place.copy()
        mujoco.mj_integratePos(self._model, moved, motion, time)
        return moved

    def _fly(self, length: float) -> float:
        """Advance by a Runge-Kutta step without contacts, and return its length [s]."""
        options = self._model.opt
        options.timestep = length
        options.disableflags |= int(mjtDisableBit.mjDSBL_CONTACT)
        mujoco.mj_step(self._model, self._data)
        options.disableflags &= ~int(mjtDisableBit.mjDSBL_CONTACT)
        return length


def poses_and_twists(states: Sequence[tuple[Array, Array]]) -> tuple[Array, Array]:
    """Return the poses (K, N, 7) and the twists (K, N, 6), world frame, of K states."""
    places, motions = (np.stack(values) for values in zip(*states, strict=True))
    place, motion = places.reshape(len(places), -1, 7), motions.reshape(len(places), -1, 6)
    pose = np.concatenate([place[..., :3], place[..., 4:], place[..., 3:4]], -1)
    return pose, np.concatenate([rotate(pose[..., 3:], motion[..., 3:]), motion[..., :3]], -1)


def _closing(gap: Array) -> Array:
    """Return the least normal velocities [m/s] of contacts of some gaps [m], shape (C,).

    Bodies rest at a gap of -REST_DEPTH, where those of the catalogue start. The law is linear, so that a face that lies
    flat is held by all its corners. Contacts out of touch are free, for no step goes farther than to a touch-down.
    """
    return np.where(gap > TOUCH, FAR, np.minimum(-REMOVAL * (gap + REST_DEPTH), FASTEST_REMOVAL))


def _until_touch(gap: Array, normal: Array, longest: float, shortest: float) -> float:
    """Return how long a step [s] may be so that no contact farther away than `TOUCH` is passed."""
    coming = (gap > TOUCH) & (normal < 0)
    if not coming.any():
        return longest
    return min(longest, max(shortest, float((gap[coming] / -normal[coming]).min())))
