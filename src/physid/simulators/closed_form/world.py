"""Which closed form a scene and its excitation have, if any."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from physid.scenes import Excitation, Scene
from physid.scenes.camera import corners
from physid.scenes.rotations import between, rotate
from physid.scenes.setup import LYING
from physid.simulators.closed_form.flight import fly, spin
from physid.simulators.closed_form.line import Line
from physid.simulators.motion import Motion, actuated, check_fit

if TYPE_CHECKING:
    from physid.physics import Effect

Array = NDArray[np.float64]
ALIKE = 1e-9  # [-], [rad] directions that differ by rounding only
NONE = "the closed form knows "


def simulate_all(
    scene: Scene,
    excitations: Sequence[Excitation],
    effects: Sequence[Effect] = (),
    substeps: int = 1,
    clocks: Sequence[float] | None = None,
) -> list[Motion]:
    """Compute motions by closed forms.

    There are: a block that does not turn, and that slides, falls and bounces along one line; two such blocks on the
    ground, in line; a body that flies, with any spin. Effects of actuation, and viscous drag.

    Arguments are as in `physid.simulators.protocol.Simulator.simulate`; steps and clocks have no part in it.

    Raises:
        ValueError: If a motion has no closed form here; the message says why.
    """
    drag = _drag_of(effects)
    check_fit(scene, excitations)
    return [_one(scene, excitation, effects, drag) for excitation in excitations]


def _drag_of(effects: Sequence[Effect]) -> float:
    """Return the coefficient of viscous drag [N s/m], and refuse what else acts at the step."""
    from physid.physics import Effect

    drag = 0.0
    for effect in effects:
        if effect.name == "viscous_drag":
            drag += float(effect.values()["coefficient"])
        elif type(effect).act is not Effect.act:
            raise ValueError(f"{NONE}viscous_drag and effects of actuation and perception, not {effect.name}")
    return drag


def _one(scene: Scene, excitation: Excitation, effects: Sequence[Effect], drag: float) -> Motion:
    """Compute one motion."""
    wrench = actuated(excitation.wrench, effects, scene.time_step)
    if wrench[..., :3].any():
        raise ValueError(f"{NONE}forces at the centres of mass, but a torque acts in scene {scene.name}")
    if len(scene.bodies) > 2:
        raise ValueError(f"{NONE}one body or two, but scene {scene.name} has {len(scene.bodies)}")
    extents = np.abs(_axes(excitation.pose) @ np.array(scene.ground.normal))  # of each body's axes, along the normal
    lies_flat = np.abs(extents.max(1) - 1) < ALIKE
    if len(scene.bodies) == 1 and (excitation.twist[:, :3].any() or not lies_flat.all()):
        return _flight(scene, excitation, wrench, drag)
    if excitation.twist[:, :3].any() or not lies_flat.all():
        raise ValueError(f"{NONE}two blocks that lie flat and do not turn; scene {scene.name} has others")
    return _along_line(scene, excitation, wrench[..., 3:], drag)


def _axes(pose: Array) -> Array:
    """Return the axes of bodies in the world, rows of (N, 3, 3)."""
    return rotate(pose[:, None, 3:], np.eye(3)[None])


def _flight(scene: Scene, excitation: Excitation, wrench: Array, drag: float) -> Motion:
    """Compute a flight, and refuse one that ends on the ground."""
    body, steps = scene.bodies[0], len(wrench)
    acceleration = wrench[:, 0, 3:] / body.mass + np.array(scene.gravity)
    place, speed = fly(excitation.pose[0], excitation.twist[0], acceleration, drag / body.mass, scene.time_step)
    times = scene.time_step * np.arange(steps, dtype=np.float64)
    turned, angular = spin(excitation.pose[0, 3:], excitation.twist[0, :3], body.moments(), times)
    motion = Motion(
        np.concatenate([place, turned], 1)[:, None].copy(), np.concatenate([angular, speed], 1)[:, None].copy()
    )
    gap = (corners(motion.pose, scene.sizes) @ np.array(scene.ground.normal) - scene.ground.offset).min((1, 2))
    # How far any point may come down and up again between two frames.
    unseen = (
        0.5 * scene.time_step * (np.linalg.norm(speed, axis=1) + _radius(body.size) * np.linalg.norm(angular, axis=1))
    )
    if (gap < unseen).any():
        time = times[int(np.argmax(gap < unseen))]
        raise ValueError(
            f"{NONE}bodies that lie flat or fly, but one that is turned comes to the ground at {time:.3g} s in scene "
            f"{scene.name}; let it start flat and without spin, throw it higher, or take fewer steps"
        )
    return motion


def _radius(size: Sequence[float]) -> float:
    """Return the distance of a corner from the centre [m]."""
    return 0.5 * float(np.linalg.norm(size))


def _along_line(scene: Scene, excitation: Excitation, force: Array, drag: float) -> Motion:
    """Compute a motion along one line; force (T, N, 3)."""
    normal, gravity = np.array(scene.ground.normal), np.array(scene.gravity)
    pose, velocity = excitation.pose, excitation.twist[:, 3:]
    along = _direction(scene, pose, np.concatenate([velocity, force.reshape(-1, 3), gravity[None]]), normal)
    sizes, axes = scene.sizes, _axes(pose)
    height = pose[:, :3] @ normal - scene.ground.offset - 0.5 * (np.abs(axes @ normal) * sizes).sum(1)
    apart = _apart(scene, pose, sizes, axes, along) if len(pose) == 2 else 0.0
    rise = velocity @ normal
    if len(pose) == 2 and ((np.abs(height) > LYING).any() or (np.abs(rise) > ALIKE).any()):
        raise ValueError(f"{NONE}two blocks that lie on the ground; one of scene {scene.name} starts above it")
    # What lies stays at the height at which it starts.
    offset = np.where(np.abs(height) <= LYING, height, 0.0)
    line = Line(
        mass=np.array([body.mass for body in scene.bodies]),
        friction=np.array([body.friction for body in scene.bodies]),
        restitution=np.array([body.restitution for body in scene.bodies]),
        pair_restitution=float(np.prod([body.restitution for body in scene.bodies])),
        apart=apart,
        drag=drag,
        gravity=np.array([along @ gravity, normal @ gravity]),
        place=pose[:, :3] @ along,
        speed=velocity @ along,
        height=float((height - offset)[0]),
        rise=float(rise[0]) if abs(rise[0]) > ALIKE else 0.0,
    )
    parts = np.stack([force @ along, force @ normal], -1)
    rows = [_row(line)]
    for held in parts[:-1]:
        line.advance(held, scene.time_step)
        rows.append(_row(line))
    place, speed, above, rising = (np.array(column) for column in zip(*rows, strict=True))
    start = _row_of(pose, along, height - offset)
    moved = (place - start[0])[..., None] * along + (above[:, None] - start[1])[..., None] * normal
    poses = np.broadcast_to(pose, (len(rows), *pose.shape)).copy()
    poses[..., :3] += moved
    twists = np.zeros((*poses.shape[:2], 6))
    twists[..., 3:] = speed[..., None] * along + rising[:, None, None] * normal
    return Motion(poses, twists)


def _row(line: Line) -> tuple[Array, Array, float, float]:
    """Return places, speeds, height and rise."""
    return line.place.copy(), line.speed.copy(), line.height, line.rise


def _row_of(pose: Array, along: Array, height: Array) -> tuple[Array, float]:
    """Return the first places along the line and the first height."""
    return pose[:, :3] @ along, float(height[0])


def _direction(scene: Scene, pose: Array, vectors: Array, normal: Array) -> Array:
    """Return the one direction in the ground's plane along which everything moves and acts, from vectors (K, 3)."""
    if len(pose) == 2:
        vectors = np.concatenate([vectors, np.diff(pose[:, :3], axis=0)])
    level = vectors - (vectors @ normal)[:, None] * normal
    sizes = np.linalg.norm(level, axis=1)
    if sizes.max() < ALIKE:
        return rotate(between(np.array([0.0, 0.0, 1.0]), normal), np.array([1.0, 0.0, 0.0]))
    along = level[-1] / sizes[-1] if len(pose) == 2 else level[sizes.argmax()] / sizes.max()
    if np.linalg.norm(level - (level @ along)[:, None] * along, axis=1).max() > ALIKE * max(1.0, sizes.max()):
        raise ValueError(
            f"{NONE}motion along one line, but velocities, forces, slope and places of scene {scene.name} have "
            f"different headings; use a protocol such as straight"
        )
    return np.asarray(along)


def _apart(scene: Scene, pose: Array, sizes: Array, axes: Array, along: Array) -> float:
    """Return the distance of two centres when faces that are square to the line touch [m]."""
    shares = np.abs(axes @ along)  # (N, 3)
    if (np.abs(shares.max(1) - 1) > ALIKE).any():
        raise ValueError(f"{NONE}two blocks with faces square to their line; those of scene {scene.name} are turned")
    apart = 0.5 * float((shares * sizes).sum())
    if (pose[1, :3] - pose[0, :3]) @ along < apart - LYING:
        raise ValueError(f"the two blocks of scene {scene.name} start in each other")
    return apart
