"""Effects at work inside MuJoCo: the same change of the motion as in PyBullet, and as closed forms say."""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from tests.effects.test_engines_agree import EXCITED_BY

from physid.data.generation.draw import laid
from physid.effects import find, from_values
from physid.effects.actuation.force_gain import ForceGain
from physid.effects.dynamics.viscous_drag import ViscousDrag
from physid.physics import Effect, Parameters, PhysicsLayer, Plane, Site, State, StepInputs, World
from physid.physics.schemes.integration import Midpoint
from physid.scenes import Body, Excitation, Ground, Scene
from physid.scenes.setups.placing import on_ground
from physid.simulators import find_simulator

Array = NDArray[np.float64]
H, G, STEPS = 1 / 240, 9.81, 60
BLOCK = Body("block", (0.3, 0.25, 0.2), mass=2.0, friction=0.12)
FLAT = Scene("test", H, Ground(), (BLOCK,))
ALIKE = 0.01  # difference of the change that an effect makes in two simulators, relative to its largest value
OTHERWISE = {"object_size", "contact_compliance"}  # what PyBullet does not do well enough to compare with
MUJOCO = find_simulator("mujoco")


@dataclass(frozen=True)
class Replacing(Effect):
    """Replaces some inputs of every step by what a function of the time makes of them."""

    name: ClassVar[str] = "replacing"
    site: ClassVar[Site] = "contact"
    change: Callable[[StepInputs], dict[str, torch.Tensor]] = field(default=lambda inputs: {})

    def act(self, state: State, inputs: StepInputs) -> StepInputs:
        return inputs.replace(**self.change(inputs))


def typical(name: str) -> Effect:
    return from_values(name, {key: quantity.typical for key, quantity in find(name).quantities().items()})


def run(scene: Scene, *effects: Effect, force: object = (8.0, 0.0, 0.0)) -> Array:
    start = np.stack([on_ground(scene.ground, 0.6 * k, 0, 0.3, body.size[2]) for k, body in enumerate(scene.bodies)])
    wrench = np.zeros((STEPS, len(start), 6))
    wrench[:, 0, 3:] = force
    drawn = laid(Excitation(start, np.zeros((len(start), 6)), wrench), scene, effects)
    return MUJOCO.simulate(scene, [drawn], effects)[0].pose


@pytest.mark.parametrize("name", [name for name in EXCITED_BY if name not in OTHERWISE])
@pytest.mark.slow
def test_an_effect_changes_the_motion_as_it_does_in_pybullet(name: str) -> None:
    scene, drawn = EXCITED_BY[name][0]()
    changes = []
    for simulator, substeps in ((MUJOCO, 5), (find_simulator("pybullet"), 16)):
        poses = [simulator.simulate(scene, [drawn], effects, substeps)[0].pose for effects in ([typical(name)], [])]
        changes.append(poses[0] - poses[1])
    assert np.abs(changes[0] - changes[1]).max() < ALIKE * np.abs(changes[1]).max()


def test_larger_blocks_collide_as_the_closed_form_says() -> None:
    scene, drawn = EXCITED_BY["object_size"][0]()
    larger = [dataclasses.replace(body, size=tuple(1.05 * edge for edge in body.size)) for body in scene.bodies]  # type: ignore[arg-type]
    drawn = laid(drawn, scene, [typical("object_size")])
    exact = find_simulator("closed_form").simulate(scene.with_bodies(larger), [drawn])
    found = MUJOCO.simulate(scene, [drawn], [typical("object_size")])
    assert np.abs(exact[0].pose[..., :3] - found[0].pose[..., :3]).max() < 2e-5


@pytest.mark.parametrize("compliance", [1e-5, 1e-4, 1e-3])
def test_a_compliant_ground_yields_by_the_compliance_times_the_load_and_friction_stays(compliance: float) -> None:
    soft = from_values("contact_compliance", {"compliance": compliance})
    still, pushed = (run(FLAT, soft, force=(force, 0.0, 0.0)) for force in (1.0, 8.0))
    assert 0.1 - still[-1, 0, 2] == pytest.approx(compliance * 2.0 * G / 4, rel=0.05)
    # A push below the limit of friction does not make it creep, once it presses on the ground.
    assert np.abs(still[-1, 0, :2] - still[-10, 0, :2]).max() < 1e-6
    time = H * (STEPS - 1)
    assert pushed[-1, 0, 0] == pytest.approx(0.5 * (4.0 - 0.12 * G) * time**2, rel=0.05)


@pytest.mark.parametrize("restitution", [0.0, 0.15, 0.45])
@pytest.mark.parametrize("compliance", [1e-5, 1e-4])
@pytest.mark.slow
def test_a_block_is_tossed_onto_a_ground_that_yields_as_the_engine_says(compliance: float, restitution: float) -> None:
    """It leans as it lands, slides and comes to rest; both take fine steps."""
    scene = FLAT.with_bodies([dataclasses.replace(BLOCK, restitution=restitution)])
    lean = 0.2
    pose = np.array([[0.0, 0.0, 0.25, 0.6 * np.sin(lean / 2), 0.8 * np.sin(lean / 2), 0.0, np.cos(lean / 2)]])
    drawn = Excitation(pose, np.array([[0.0, 0.0, 0.0, 0.8, 0.0, 0.0]]), np.zeros((STEPS, 1, 6)))
    soft = [from_values("contact_compliance", {"compliance": compliance})]
    there = MUJOCO.simulate(scene, [drawn], soft, 32)[0].pose
    world = World(H, 32, ground=Plane(scene.ground.normal, scene.ground.offset), integration=Midpoint())
    numbers = (torch.tensor([[value]], dtype=torch.float64) for value in (BLOCK.mass, BLOCK.friction, restitution))
    parameters = Parameters.of_boxes(torch.tensor([[BLOCK.size]], dtype=torch.float64), *numbers)
    start = State.checked(*(torch.from_numpy(value)[None] for value in (drawn.pose, drawn.twist)))
    with torch.no_grad():
        rollout = PhysicsLayer(world, soft).rollout(start, torch.zeros(1, STEPS - 1, 1, 6).double(), parameters)
    assert np.abs(rollout.pose[0].numpy() - there)[..., :3].max() < 5e-4


@pytest.mark.parametrize(
    ("change", "body"),
    [
        (lambda i: {"friction": i.friction * 1.5}, {"friction": 0.18}),
        (lambda i: {"ground_friction": i.ground_friction * 1.5}, {"friction": 0.18}),
        (lambda i: {"mass": i.mass * 2, "inertia": i.inertia * 2}, {"mass": 4.0}),
        (lambda i: {"size": i.size * 1.2}, {"size": (0.36, 0.3, 0.24), "inertia": (0.01, 0.01, 0.01)}),
    ],
)
def test_a_changed_input_acts_like_a_scene_with_that_value(
    change: Callable[[StepInputs], dict[str, torch.Tensor]], body: dict[str, float]
) -> None:
    built_in = run(FLAT.with_bodies([dataclasses.replace(BLOCK, **body)]))  # type: ignore[arg-type]
    assert np.abs(run(FLAT, Replacing(change))[:, 0, :2] - built_in[:, 0, :2]).max() < 1e-7


def test_a_tilted_ground_is_an_incline() -> None:
    angle = 0.3
    tilted = Ground((np.sin(angle), 0.0, np.cos(angle)))
    turn = Replacing(
        lambda inputs: {"ground_normal": torch.tensor([np.sin(angle), 0.0, np.cos(angle)], dtype=torch.float64)}
    )
    start = on_ground(tilted, 0, 0, 0.3, 0.2)[None]
    excitation = Excitation(start, np.zeros((1, 6)), np.zeros((STEPS, 1, 6)))
    flat, incline = (
        MUJOCO.simulate(scene, [excitation], effects)[0].pose
        for scene, effects in ((FLAT, [turn]), (dataclasses.replace(FLAT, ground=tilted), []))
    )
    assert np.abs(flat - incline).max() < 1e-9


def test_worlds_that_go_in_step_do_what_each_does_alone_with_its_own_clock() -> None:
    drift = Replacing(lambda now: {"friction": now.friction * (1 + 0.5 * now.time[:, None]), "mass": 1.2 * now.mass})
    effects = [ViscousDrag(torch.tensor([0.6], dtype=torch.float64)), drift]
    runs, clocks = [], [0.0, 0.3, 0.1]
    for world in range(3):
        wrench = np.zeros((20 + 7 * (world % 2), 1, 6))
        wrench[:, 0, 3] = 4.0 + world
        runs.append(Excitation(on_ground(FLAT.ground, 0, 0, world, 0.2)[None], np.zeros((1, 6)), wrench))
    together = MUJOCO.simulate(FLAT, runs, effects, clocks=clocks)
    for excitation, clock, motion in zip(runs, clocks, together, strict=True):
        (alone,) = MUJOCO.simulate(FLAT, [excitation], effects, clocks=[clock])
        assert len(motion.pose) == len(excitation.wrench)
        assert np.array_equal(motion.pose, alone.pose)


def test_actuation_alone_needs_no_step_by_step_formula() -> None:
    gained = run(FLAT, ForceGain(torch.tensor([0.25], dtype=torch.float64)), force=(4.0, 2.0, 0))
    assert np.array_equal(gained, run(FLAT, force=(5.0, 2.5, 0)))


def test_what_cannot_change_between_steps_is_refused() -> None:
    growing = Replacing(lambda inputs: {"size": inputs.size * (1 + inputs.time[:, None, None])})
    with pytest.raises(ValueError, match="MuJoCo cannot change sizes"):
        run(FLAT, growing)


def test_a_setting_of_pybullet_is_refused() -> None:
    class Own(ViscousDrag.__mro__[1]):  # type: ignore[misc]
        """F = 0: a setting."""

        name = "rolling"
        site = "contact"

        def settings(self) -> None: ...

    with pytest.raises(ValueError, match="the effect rolling is a setting of PyBullet's own"):
        run(FLAT, Own())
