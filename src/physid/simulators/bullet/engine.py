"""A PyBullet client that obeys the textbook: rigid boxes, Coulomb's cone, Newton's impacts, nothing else."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Self

import numpy as np
import pybullet
from numpy.typing import NDArray

from physid.scenes import Body, Scene
from physid.scenes.rotations import between, rotate
from physid.scenes.setup import REST_DEPTH
from physid.scenes.setups.placing import UP
from physid.simulators.native import Settings

Array = NDArray[np.float64]
Rows = list[tuple[float, ...]]
SLAB = 20.0  # [m] half width of the ground
SLAB_DEPTH = 1.0  # [m] half thickness of the ground
AWAY = 100.0  # [m] far enough for bodies to meet nothing
CONTACT_NORMAL, CONTACT_DISTANCE = 7, 8  # in PyBullet's contact points; the normal points to the first body
CORRECTION = 0.2  # part of an overlap that is taken back per step
# What each setting is for, with the measurements, is in docs/decisions/0002-pybullet-settings.md.
SETTINGS = {
    "numSolverIterations": 200,
    "solverResidualThreshold": 1e-20,
    "restitutionVelocityThreshold": 0.0,
    "useSplitImpulse": 1,
    "splitImpulsePenetrationThreshold": 0.0,
    "contactSlop": REST_DEPTH,
    "enableConeFriction": 1,
    "erp": CORRECTION,
    "contactERP": CORRECTION,
    "contactBreakingThreshold": 0.02,
    "deterministicOverlappingPairs": 1,
}
KEEP_OVERLAPS = {"erp": 0.0, "contactERP": 0.0}  # Bullet's cone solver would take them back by a velocity: a bounce
RIGID = {
    "linearDamping": 0.0,
    "angularDamping": 0.0,
    "rollingFriction": 0.0,
    "spinningFriction": 0.0,
    "activationState": pybullet.ACTIVATION_STATE_DISABLE_SLEEPING,
}


@dataclass(frozen=True)
class Built:
    """A client and what stands in it.

    Attributes:
        client: PyBullet's number of it.
        ground: PyBullet's number of the slab.
        bodies: PyBullet's numbers of the bodies.
        shape: Sizes and centres of mass of the bodies, which cannot change; None if more was changed than is set anew.
    """

    client: int
    ground: int
    bodies: list[int]
    shape: object


# Of this process, to be used again: to connect takes as long as a whole trajectory, to empty a world as long as many
# frames.
idle: list[Built] = []


class Engine:
    """A PyBullet world with the bodies of a scene; use it in a `with` statement.

    Poses and twists are those of the geometric centres, whatever the centres of mass; wrenches act at the latter.

    Args:
        scene: What stands on the ground.
        time_step: Length of one step [s].
        centres: Offsets of the centres of mass from the geometric centres, body frame [m], shape (N, 3); None for none.
    """

    def __init__(self, scene: Scene, time_step: float, centres: Array | None = None) -> None:
        offsets = np.zeros((len(scene.bodies), 3)) if centres is None else centres
        self._shape: object = ([body.size for body in scene.bodies], offsets.tolist())
        self._client, stands = _client_for(self._shape)
        self._on = {"physicsClientId": self._client}
        # Bullet has two solvers of friction. That of free bodies has a row along the slip and one across it: exact for
        # a block that slips without spin. That of articulated bodies has a cone: better for blocks that push each
        # other, where contact forces act across the slip.
        self._free = len(scene.bodies) == 1
        if stands is None:
            pybullet.resetSimulation(pybullet.RESET_USE_DISCRETE_DYNAMICS_WORLD if self._free else 0, **self._on)
        pybullet.setPhysicsEngineParameter(**SETTINGS | ({} if self._free else KEEP_OVERLAPS), **self._on)
        pybullet.setTimeStep(time_step, **self._on)
        pybullet.setGravity(*scene.gravity, **self._on)
        self._step = time_step
        self._masses = [body.mass for body in scene.bodies]
        self._soft = False
        self._centres = None if centres is None or not centres.any() else centres
        if stands is None:
            self._ground = self._add_slab()
            self._bodies = [self._add_box(*each) for each in zip(scene.bodies, offsets, strict=True)]
        else:
            self._ground, self._bodies = stands.ground, stands.bodies
        self.place_ground(scene.ground.normal, scene.ground.offset)
        self.set_ground_contact(1.0, 1.0)
        for number, body in zip(self._bodies, scene.bodies, strict=True):
            contact = {"lateralFriction": body.friction, "restitution": body.restitution}
            # Moments without the mass would make the body static.
            inertia = {"mass": body.mass, "localInertiaDiagonal": body.moments().tolist()}
            pybullet.changeDynamics(number, -1, **contact, **inertia, **RIGID, **self._on)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        idle.append(Built(self._client, self._ground, self._bodies, self._shape))

    def _add_slab(self) -> int:
        """Add a static slab whose upper face is the ground (GEOM_PLANE makes boxes rock)."""
        shape = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=[SLAB, SLAB, SLAB_DEPTH], **self._on)
        return int(pybullet.createMultiBody(0, shape, useMaximalCoordinates=self._free, **self._on))

    def _add_box(self, body: Body, centre: Array) -> int:
        """Add a box whose centre of mass is off its middle by `centre` (3,) [m]."""
        shape = pybullet.createCollisionShape(
            pybullet.GEOM_BOX,
            halfExtents=[0.5 * edge for edge in body.size],
            collisionFramePosition=(-centre).tolist(),
            **self._on,
        )
        return int(pybullet.createMultiBody(body.mass, shape, useMaximalCoordinates=self._free, **self._on))

    def place_ground(self, normal: Sequence[float], offset: float) -> None:
        """Put the slab so that its upper face holds the points p with normal . p = offset [m]."""
        centre = (offset - SLAB_DEPTH) * np.asarray(normal)
        turn = between(UP, normal)
        pybullet.resetBasePositionAndOrientation(self._ground, centre.tolist(), turn.tolist(), **self._on)

    def set_ground_contact(self, friction: float, restitution: float) -> None:
        """Set the contact coefficients of the ground [-]."""
        pybullet.changeDynamics(self._ground, -1, lateralFriction=friction, restitution=restitution, **self._on)

    def set_ground_compliance(self, compliance: float) -> None:
        """Set how far each contact with the ground yields under a force [m/N]."""
        stiffness = 1 / compliance
        # Bullet takes back h k / (h k + d) of an overlap per step: the same part as of a rigid contact, but for a
        # damper that is critical for a body on four corners. It knows one for the ground: that of the mean mass.
        time = self._step * (1 / CORRECTION - 1) + float(np.sqrt(compliance * np.mean(self._masses)))
        damping = stiffness * time
        pybullet.changeDynamics(self._ground, -1, contactStiffness=stiffness, contactDamping=damping, **self._on)
        # A separate correction of overlaps would take back the deflection.
        pybullet.setPhysicsEngineParameter(useSplitImpulse=0, **self._on)
        self._soft, self._shape = True, None

    def alter(self, settings: Settings) -> None:
        """Leave the textbook: change what PyBullet itself does with all bodies, the ground or the world."""
        self._shape = None
        for body in self._bodies:
            pybullet.changeDynamics(body, -1, **settings.bodies, **self._on)
        pybullet.changeDynamics(self._ground, -1, **settings.ground, **self._on)
        pybullet.setPhysicsEngineParameter(**settings.world, **self._on)

    def set_inertia(self, body: int, mass: float, moments: Sequence[float]) -> None:
        """Set the mass [kg] and the principal moments [kg m^2] of body `body` of the scene."""
        self._masses[body] = mass
        pybullet.changeDynamics(self._bodies[body], -1, mass=mass, localInertiaDiagonal=list(moments), **self._on)

    def set_contact(self, body: int, friction: float, restitution: float) -> None:
        """Set the contact coefficients [-] of body `body` of the scene."""
        pybullet.changeDynamics(self._bodies[body], -1, lateralFriction=friction, restitution=restitution, **self._on)

    def set_state(self, pose: Array, twist: Array) -> None:
        """Put the bodies at poses (N, 7) with twists (N, 6)."""
        if self._centres is not None:
            pose, twist = _moved(pose, twist, rotate(pose[:, 3:], self._centres))
        # PyBullet turns the moments of inertia with a body only at the end of a step: let one end far from everything.
        for index, (body, place) in enumerate(zip(self._bodies, pose.tolist(), strict=True)):
            away = [place[0], place[1], place[2] + AWAY * (index + 1)]
            pybullet.resetBasePositionAndOrientation(body, away, place[3:], **self._on)
            pybullet.resetBaseVelocity(body, [0.0] * 3, [0.0] * 3, **self._on)
        self.step()
        for body, place, motion in zip(self._bodies, pose.tolist(), twist.tolist(), strict=True):
            pybullet.resetBasePositionAndOrientation(body, place[:3], place[3:], **self._on)
            pybullet.resetBaseVelocity(body, motion[3:], motion[:3], **self._on)

    def read(self) -> tuple[Rows, Rows]:
        """Return the poses (N rows of 7) and the twists (N rows of 6)."""
        pose, twist = [], []
        for body in self._bodies:
            place, turn = pybullet.getBasePositionAndOrientation(body, **self._on)
            velocity, spin = pybullet.getBaseVelocity(body, **self._on)
            pose.append(place + turn)
            twist.append(spin + velocity)
        if self._centres is None:
            return pose, twist
        places = np.array(pose)
        moved = _moved(places, np.array(twist), -rotate(places[:, 3:], self._centres))
        return moved[0].tolist(), moved[1].tolist()

    def push(self, pose: Rows, wrench: Rows) -> None:
        """Apply wrenches (N rows of 6), world frame, at the centres of mass of bodies at `pose`, for one step."""
        if self._centres is not None:
            places = np.array(pose)
            pose = (places[:, :3] + rotate(places[:, 3:], self._centres)).tolist()
        for body, place, load in zip(self._bodies, pose, wrench, strict=True):
            if any(load[3:]):
                pybullet.applyExternalForce(body, -1, load[3:], place[:3], pybullet.WORLD_FRAME, **self._on)
            if any(load[:3]):
                pybullet.applyExternalTorque(body, -1, load[:3], pybullet.WORLD_FRAME, **self._on)

    def step(self) -> None:
        """Advance by one time step.

        Contact points are looked for anew: those that Bullet keeps from earlier steps swallow the next bounce, and
        crowd out the new ones under a fast block, so that it rocks.
        """
        for body in self._bodies:
            pybullet.setCollisionFilterGroupMask(body, -1, 1, 1, **self._on)
        pybullet.stepSimulation(**self._on)
        if not self._free:
            self._take_back_overlaps()

    def _take_back_overlaps(self) -> None:
        """Move bodies apart by part of their overlap, without velocity, as Bullet itself does with free bodies."""
        inverse = {self._ground: 0.0} | {body: 1 / mass for body, mass in zip(self._bodies, self._masses, strict=True)}
        for one, other in combinations(inverse, 2):
            points = pybullet.getContactPoints(one, other, **self._on)
            if not points or (self._soft and one == self._ground):
                continue
            deepest = min(points, key=lambda point: point[CONTACT_DISTANCE])
            way = CORRECTION * max(0.0, -deepest[CONTACT_DISTANCE] - REST_DEPTH) / (inverse[one] + inverse[other])
            for body, share in ((one, way * inverse[one]), (other, -way * inverse[other])):
                if share:
                    self._shift(body, share, deepest[CONTACT_NORMAL])

    def _shift(self, body: int, way: float, direction: Sequence[float]) -> None:
        """Move a body by `way` [m] along a direction (3,) and keep its velocity."""
        place, turn = pybullet.getBasePositionAndOrientation(body, **self._on)
        velocity, spin = pybullet.getBaseVelocity(body, **self._on)
        moved = [start + way * part for start, part in zip(place, direction, strict=True)]
        pybullet.resetBasePositionAndOrientation(body, moved, turn, **self._on)
        pybullet.resetBaseVelocity(body, velocity, spin, **self._on)


def _client_for(shape: object) -> tuple[int, Built | None]:
    """Return a client, an idle one if there is one, and what stands in it if that is what is wanted."""
    for place, built in enumerate(idle):
        if built.shape == shape:
            return idle.pop(place).client, built
    return idle.pop().client if idle else int(pybullet.connect(pybullet.DIRECT)), None


def _moved(pose: Array, twist: Array, arm: Array) -> tuple[Array, Array]:
    """Return poses and twists of points that are `arm` (N, 3) away on the same bodies, v + w x arm."""
    position = np.concatenate([pose[:, :3] + arm, pose[:, 3:]], 1)
    return position, np.concatenate([twist[:, :3], twist[:, 3:] + np.cross(twist[:, :3], arm)], 1)
