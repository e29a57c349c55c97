"""Effects at work inside PyBullet, against closed forms and against scenes that have the effect built in."""

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
import pytest
import torch

from physid.effects.actuation.force_gain import ForceGain
from physid.effects.dynamics.viscous_drag import ViscousDrag
from physid.physics import Effect, Site, State, StepInputs
from physid.scenes import Body, Excitation, Ground, Scene
from physid.scenes.setups.placing import on_ground
from physid.simulators import Motion, observed
from physid.simulators.bullet import engine
from physid.simulators.bullet.hooks import split_products
from physid.simulators.bullet.world import AT_ONCE, simulate, simulate_all

TOLERANCE = 1e-8  # [m], [m/s]
H, G, STEPS = 1 / 240, 9.81, 200
BLOCK = Body("block", (0.3, 0.25, 0.2), mass=2.0, friction=0.12)
FLAT = Scene("test", H, Ground(), (BLOCK,))


@dataclass(frozen=True)
class Replacing(Effect):
    """Replaces some inputs of every step by what a function of the time makes of them."""

    name: ClassVar[str] = "replacing"
    site: ClassVar[Site] = "contact"
    change: Callable[[StepInputs], dict[str, torch.Tensor]] = field(default=lambda inputs: {})

    def act(self, state: State, inputs: StepInputs) -> StepInputs:
        return inputs.replace(**self.change(inputs))


def run(scene: Scene, *effects: Effect, pose: object = None, force: object = (8.0, 0.0, 0.0)) -> Motion:
    start = np.atleast_2d(on_ground(scene.ground, 0, 0, 0.3, 0.2) if pose is None else np.asarray(pose, dtype=float))
    wrench = np.zeros((STEPS, len(start), 6))
    wrench[:, 0, 3:] = force
    return simulate(scene, Excitation(start, np.zeros((len(start), 6)), wrench), effects)


def number(value: float) -> torch.Tensor:
    return torch.tensor([value], dtype=torch.float64)


def test_viscous_drag_slows_a_body_exponentially() -> None:
    weightless = dataclasses.replace(FLAT, gravity=(0.0, 0.0, 0.0))
    wrench, twist = np.zeros((STEPS, 1, 6)), np.array([[0, 0, 0, 2.0, 0, 0]])
    start = Excitation(np.array([[0, 0, 5, 0, 0, 0, 1.0]]), twist, wrench)
    speed = simulate(weightless, start, [ViscousDrag(number(0.6))]).twist[:, 0, 3]
    assert np.abs(speed - 2.0 * (1 - 0.6 * H / 2.0) ** np.arange(STEPS)).max() < TOLERANCE
    assert speed[-1] == pytest.approx(2.0 * np.exp(-0.6 * (STEPS - 1) * H / 2.0), rel=1e-3)


def test_a_force_gain_acts_like_a_larger_command() -> None:
    gained = run(FLAT, ForceGain(number(0.25)), force=[4.0, 2.0, 0])
    larger = run(FLAT, force=[5.0, 2.5, 0])
    assert np.abs(gained.pose - larger.pose).max() < TOLERANCE


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
    changed = run(FLAT, Replacing(change))
    built_in = run(FLAT.with_bodies([dataclasses.replace(BLOCK, **body)]))  # type: ignore[arg-type]
    assert np.abs(changed.pose[:, 0, :2] - built_in.pose[:, 0, :2]).max() < TOLERANCE


def test_a_change_of_gravity_changes_the_fall() -> None:
    weaker = Replacing(lambda inputs: {"gravity": 0.5 * inputs.gravity})
    height = run(FLAT, weaker, pose=[0, 0, 20, 0, 0, 0, 1], force=0.0).pose[:, 0, 2]
    step = np.arange(STEPS)
    assert np.abs(height - (20 - 0.5 * G * H**2 * step * (step + 1) / 2)).max() < TOLERANCE


def test_friction_may_change_while_the_block_slides() -> None:
    early_only = Replacing(lambda inputs: {"friction": inputs.friction * (inputs.time < 0.2).double()[:, None]})
    speed = run(FLAT, early_only).twist[:, 0, 3]
    step = np.arange(STEPS)
    braked = np.minimum(step, np.ceil(0.2 / H - 1e-9))
    assert np.abs(speed - (8.0 / 2.0 * H * step - 0.12 * G * H * braked)).max() < TOLERANCE


def test_a_compliant_ground_yields_by_the_compliance_times_the_load_of_each_corner() -> None:
    soft = Replacing(lambda inputs: {"compliance": torch.full_like(inputs.compliance, 2e-4)})
    sunk = 0.1 - run(FLAT, soft, force=0.0).pose[-1, 0, 2]
    assert sunk == pytest.approx(2e-4 * 2.0 * G / 4, rel=0.02)


TWO = tuple(dataclasses.replace(BLOCK, name=name) for name in ("left", "right"))
TILTED = Ground(normal=(math.sin(0.2), 0.0, math.cos(0.2)))


@pytest.mark.parametrize("bodies", [(BLOCK,), TWO], ids=["one body", "two bodies"])
def test_a_world_that_was_used_before_is_as_good_as_a_new_one(
    bodies: tuple[Body, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    def tumble(*effects: Effect, bodies: tuple[Body, ...] = bodies, **changes: object) -> Motion:
        scene = dataclasses.replace(FLAT, bodies=bodies, **changes)  # type: ignore[arg-type]
        pose = np.array([[0.4 * k, 0.0, 0.2 + 0.1 * k, 0.1, 0.2, 0.3, 0.92] for k in range(len(bodies))])
        twist = np.array([[1.0, 2.0, 3.0, 0.8 - 1.6 * k, 0.1, 0.0] for k in range(len(bodies))])
        return simulate(scene, Excitation(pose, twist, np.zeros((60, *twist.shape))), effects)

    monkeypatch.setattr(engine, "idle", [])
    new = tumble()
    others = [dataclasses.replace(body, mass=5.0, friction=0.9, restitution=0.8) for body in bodies]
    soft = Replacing(lambda inputs: {"compliance": torch.full_like(inputs.compliance, 2e-4)})
    off = Replacing(lambda inputs: {"centre_of_mass": torch.full_like(inputs.centre_of_mass, 0.03)})
    for used in (
        lambda: tumble(bodies=tuple(others), ground=TILTED, gravity=(1.0, 0.0, -5.0)),
        lambda: tumble(soft),
        lambda: tumble(off),
        lambda: tumble(bodies=TWO if len(bodies) == 1 else (BLOCK,)),
    ):
        used()
        again = tumble()
        assert np.array_equal(again.pose, new.pose)
        assert np.array_equal(again.twist, new.twist)
    assert len(engine.idle) == 1


def test_a_body_with_its_mass_off_its_middle_turns_about_its_centre_of_mass_when_pushed() -> None:
    weightless = dataclasses.replace(FLAT, gravity=(0.0, 0.0, 0.0))
    off = torch.tensor([[[0.0, 0.05, 0.0]]], dtype=torch.float64)
    motion = run(weightless, Replacing(lambda inputs: {"centre_of_mass": off}), pose=[0, 0, 5, 0, 0, 0, 1.0])
    moment = 2.0 * (0.3**2 + 0.25**2) / 12
    # The force at the middle has the arm -0.05 m about the centre of mass; it turns with the body: look at the start.
    assert motion.twist[1, 0, 2] == pytest.approx(0.05 * 8.0 * H / moment, rel=1e-6)
    assert motion.twist[1, 0, 3] == pytest.approx(8.0 / 2.0 * H + 0.05 * motion.twist[1, 0, 2], rel=1e-6)


def test_what_pybullet_cannot_change_between_steps_is_refused() -> None:
    growing = Replacing(lambda inputs: {"size": inputs.size * (1 + inputs.time[:, None, None])})
    with pytest.raises(ValueError, match="cannot change sizes"):
        run(FLAT, growing)


def test_the_products_of_two_bodies_and_the_ground_are_those_wanted() -> None:
    bodies, ground = split_products(np.array([0.1, 0.3]), 0.02)
    assert bodies * ground == pytest.approx([0.1, 0.3])
    assert bodies.prod() == pytest.approx(0.02)


def test_more_than_two_bodies_are_refused_where_contacts_differ() -> None:
    with pytest.raises(ValueError, match="at most two bodies"):
        split_products(np.array([0.1, 0.3, 0.2]), 0.02)


def test_without_effects_the_camera_reports_the_true_poses() -> None:
    pose = np.zeros((5, 1, 7))
    assert observed(pose, (), H * np.arange(len(pose))) is pose


@pytest.mark.slow
@pytest.mark.parametrize("bodies", [1, 2])
def test_worlds_that_go_in_step_do_what_each_does_alone(bodies: int) -> None:
    scene = FLAT.with_bodies([dataclasses.replace(BLOCK, name=f"block {k}") for k in range(bodies)])
    source = np.random.default_rng(3)
    drag = ViscousDrag(number(0.6))
    drift = Replacing(lambda now: {"friction": now.friction * (1 + 0.5 * now.time[:, None]), "mass": 1.2 * now.mass})
    runs, clocks = [], []
    for world in range(AT_ONCE + 2):
        pose = np.array([on_ground(scene.ground, 0.6 * k, 0.1 * world, 0.2 * world, 0.2) for k in range(bodies)])
        wrench = np.zeros((20 + 7 * (world % 3), bodies, 6))
        wrench[:, 0, 3:5] = source.normal(4.0, 2.0, 2)
        runs.append(Excitation(pose, np.zeros((bodies, 6)), wrench))
        clocks.append(0.1 * world)
    together = simulate_all(scene, runs, [drag, drift], clocks=clocks)
    for excitation, clock, motion in zip(runs, clocks, together, strict=True):
        (alone,) = simulate_all(scene, [excitation], [drag, drift], clocks=[clock])
        assert len(motion.pose) == len(excitation.wrench)
        assert np.array_equal(motion.pose, alone.pose)
        assert np.array_equal(motion.twist, alone.twist)


def test_a_clock_set_forward_is_a_formula_that_adds_to_the_time() -> None:
    excitation = Excitation(
        np.atleast_2d(on_ground(FLAT.ground, 0, 0, 0.3, 0.2)), np.zeros((1, 6)), np.ones((50, 1, 6))
    )
    drift = Replacing(lambda now: {"friction": now.friction * (1 - 0.5 * now.time[:, None])})
    late = Replacing(lambda now: {"friction": now.friction * (1 - 0.5 * (now.time[:, None] + 0.3))})
    (clocked,) = simulate_all(FLAT, [excitation], [drift], clocks=[0.3])
    assert np.array_equal(clocked.pose, simulate(FLAT, excitation, [late]).pose)
    assert np.abs(clocked.pose - simulate(FLAT, excitation, [drift]).pose).max() > TOLERANCE
