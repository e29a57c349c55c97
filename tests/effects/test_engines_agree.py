"""The change that an effect makes is the same in PyBullet and in the PhysicsLayer.

The scenes are short and plain, for what is compared is the effect and not the engines: a block that slides does not
spin, nor is it pushed aside by another (PyBullet's friction then deviates from Coulomb's law), and impacts are flat.
"""

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from physid.data.generation.draw import laid
from physid.effects import CATALOGUE, find, from_values
from physid.physics import Effect, Parameters, PhysicsLayer, Plane, State, World
from physid.physics.contact import ContactRule, Split
from physid.scenes import Body, Excitation, Ground, Scene
from physid.scenes.setup import REST_DEPTH
from physid.simulators.bullet.world import simulate

Array = NDArray[np.float64]
H, FRAMES = 1 / 240, 49
EXACT, RUBBING, IMPACT, SETTLING = 0.003, 0.02, 0.05, 0.15
"""Accepted difference of the change, relative to its largest value: in flight and on the ground; between bodies; with
an impact, whose time is only known to a step; and while a spring under a body settles."""
SUBSTEPS = {IMPACT: 4}
VISIBLE = 1e-4  # [m] or [-], the least change that is worth comparing

BLOCK = Body("block", size=(0.3, 0.25, 0.2), mass=2.0, friction=0.2, restitution=0.3)
OTHER = Body("other", size=(0.25, 0.25, 0.2), mass=1.0, friction=0.2, restitution=0.3)
Case = tuple[Scene, Excitation]


def case(bodies: list[Body], pose: Array, twist: Array, force: Array, gravity: float = -9.81) -> Case:
    """Put bodies into a scene; `force` (T, 3) acts on the first."""
    wrench = np.zeros((FRAMES, len(bodies), 6))
    wrench[:, 0, 3:] = force
    scene = Scene("test", H, Ground(), tuple(bodies), gravity=(0.0, 0.0, gravity))
    return scene, Excitation(pose, twist, wrench)


def upright(x: float, z: float = 0.1 - REST_DEPTH) -> list[float]:
    """Return the pose of a box that is not turned."""
    return [x, 0.2, z, 0.0, 0.0, 0.0, 1.0]


def flight() -> Case:
    """A tumbling block far above the ground, pushed back and forth."""
    force = np.linspace([4.0, -3.0, 1.0], [-6.0, 5.0, 0.0], FRAMES)
    twist = np.array([[3.0, 1.0, 2.0, 0.6, 0.3, 1.0]])
    return case([BLOCK], np.array([upright(0.3, 3.0)]), twist, force)


def slide() -> Case:
    """A block that slides straight on and is pushed harder and harder."""
    force = np.linspace([0.5, 0.0, 0.0], [8.0, 0.0, 0.0], FRAMES)
    return case([BLOCK], np.array([upright(0.3)]), np.array([[0.0, 0, 0, 0.8, 0, 0]]), force)


def start() -> Case:
    """A block that is pushed from rest."""
    return case([BLOCK], np.array([upright(0.3)]), np.zeros((1, 6)), np.full((FRAMES, 3), [6.0, 0.0, 0.0]))


def spin() -> Case:
    """A block that turns on the spot."""
    return case([BLOCK], np.array([upright(0.3)]), np.array([[0.0, 0, 4.0, 0, 0, 0]]), np.zeros((FRAMES, 3)))


def drop() -> Case:
    """A block that falls flat and bounces."""
    return case([BLOCK], np.array([upright(0.3, 0.14)]), np.zeros((1, 6)), np.zeros((FRAMES, 3)))


def rest() -> Case:
    """A block that stands."""
    return case([BLOCK], np.array([upright(0.3)]), np.zeros((1, 6)), np.zeros((FRAMES, 3)))


def meet() -> Case:
    """A block that runs straight into another."""
    twist = np.array([[0.0, 0, 0, 1.0, 0, 0], [0.0, 0, 0, 0, 0, 0]])
    pose = np.array([upright(0.0), upright(0.295)])
    return case([BLOCK, OTHER], pose, twist, np.full((FRAMES, 3), [4.0, 0.0, 0.0]))


def rub() -> Case:
    """Two blocks without weight, far from the ground, pressed together while they slide along each other."""
    pose = np.array([upright(0.0, 2.0), upright(0.275, 2.0)])
    twist = np.array([[0.0, 0, 0, 0, 0.3, 0], [0.0, 0, 0, 0, -0.3, 0]])
    scene, drawn = case([BLOCK, OTHER], pose, twist, np.full((FRAMES, 3), [8.0, 0.0, 0.0]), gravity=0.0)
    drawn.wrench[:, 1, 3] = -8.0
    return scene, drawn


EXCITED_BY: dict[str, tuple[Callable[[], Case], float]] = {
    "force_gain": (flight, EXACT),
    "force_dead_zone": (flight, EXACT),
    "force_saturation": (flight, EXACT),
    "force_delay": (flight, EXACT),
    "force_lag": (slide, EXACT),
    "force_misalignment": (flight, EXACT),
    "force_offset": (flight, EXACT),
    "viscous_drag": (slide, EXACT),
    "quadratic_drag": (slide, EXACT),
    "constant_force": (flight, EXACT),
    "ground_tilt": (flight, EXACT),
    "gravity_error": (slide, EXACT),
    "tether": (flight, EXACT),
    "com_offset": (flight, EXACT),
    "inertia_scale": (spin, EXACT),
    "mass_drift": (slide, EXACT),
    "stribeck_friction": (start, EXACT),
    "anisotropic_friction": (slide, EXACT),
    "body_anisotropic_friction": (slide, EXACT),
    "friction_gradient": (slide, EXACT),
    "friction_drift": (slide, EXACT),
    "torsional_friction": (spin, EXACT),
    "load_dependent_friction": (slide, EXACT),
    "adhesion": (slide, EXACT),
    "ground_restitution": (drop, IMPACT),
    "object_restitution": (meet, IMPACT),
    "object_friction": (rub, RUBBING),
    "contact_compliance": (rest, SETTLING),
    "object_size": (meet, IMPACT),
}


def tensor(values: object) -> torch.Tensor:
    """Return values as a batch of one."""
    return torch.as_tensor(np.asarray(values, dtype=float))[None]


def in_layer(
    scene: Scene, drawn: Excitation, effects: list[Effect], pose: Array, substeps: int, rule: ContactRule
) -> Array:
    """Return the poses (T, N, 7) that the PhysicsLayer predicts from the initial poses `pose`."""
    bodies = scene.bodies
    parameters = Parameters.of_boxes(
        size=tensor([body.size for body in bodies]),
        mass=tensor([body.mass for body in bodies]),
        friction=tensor([body.friction for body in bodies]),
        restitution=tensor([body.restitution for body in bodies]),
    )
    ground = Plane(scene.ground.normal, scene.ground.offset)
    world = World(time_step=H, substeps=substeps, gravity=scene.gravity, ground=ground, contact=rule)
    with torch.no_grad():
        start = State.checked(tensor(pose), tensor(drawn.twist))
        rollout = PhysicsLayer(world, effects).rollout(start, tensor(drawn.wrench[:-1]), parameters)
    return np.asarray(rollout.pose[0].numpy())


def test_every_effect_that_acts_is_compared() -> None:
    acting = {effect.name for effect in CATALOGUE if effect.observe is Effect.observe}
    assert set(EXCITED_BY) == acting


@cache
def nominal(excite: Callable[[], Case], substeps: int, rule: ContactRule) -> tuple[Array, Array]:
    """Return the poses without effect in both engines."""
    return both(excite, [], substeps, rule)


def both(excite: Callable[[], Case], effects: list[Effect], substeps: int, rule: ContactRule) -> tuple[Array, Array]:
    """Return the poses (T, N, 7) in PyBullet and in the PhysicsLayer, which starts from the same initial poses."""
    scene, drawn = excite()
    drawn = laid(drawn, scene, effects)
    bullet = simulate(scene, drawn, effects, substeps).pose
    return bullet, in_layer(scene, drawn, effects, bullet[0], substeps, rule)


@pytest.mark.parametrize("name", EXCITED_BY)
def test_both_engines_make_the_same_of_an_effect(name: str) -> None:
    excite, tolerance = EXCITED_BY[name]
    effect = from_values(name, {key: quantity.typical for key, quantity in find(name).quantities().items()})
    settings = SUBSTEPS.get(tolerance, 1), Split()
    changed, unchanged = both(excite, [effect], *settings), nominal(excite, *settings)
    in_bullet, in_ours = (with_effect - without for with_effect, without in zip(changed, unchanged, strict=True))
    shown = np.abs(in_bullet).max()
    assert shown > VISIBLE
    assert np.abs(in_bullet - in_ours).max() < tolerance * shown


@pytest.mark.slow
@pytest.mark.parametrize("compliance", [1e-5, 1e-4, 1e-3])
@pytest.mark.parametrize("restitution", [0.0, 0.45])
def test_a_block_falls_onto_a_ground_that_yields_in_pybullet_as_under_its_rules(
    restitution: float, compliance: float
) -> None:
    """However fine the steps, the deepest point and the height to which it is thrown back are the same."""
    scene = Scene(
        "test", H, Ground(), (Body("block", (0.3, 0.25, 0.2), mass=1.0, friction=0.2, restitution=restitution),)
    )
    drawn = Excitation(np.array([[0, 0, 0.25, 0, 0, 0, 1.0]]), np.zeros((1, 6)), np.zeros((60, 1, 6)))
    soft: list[Effect] = [from_values("contact_compliance", {"compliance": compliance})]
    for substeps in (4, 20):
        there = simulate(scene, drawn, soft, substeps).pose[:, 0, 2]
        ours = in_layer(scene, drawn, soft, drawn.pose, substeps, Split())[:, 0, 2]
        assert np.abs(ours - there).max() < 5e-4
