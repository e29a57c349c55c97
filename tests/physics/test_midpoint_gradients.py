"""Derivatives of the scheme of second order: exact against central differences, and the same in both backends."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import pytest
import torch
from tests.physics.test_fused import GRADIENT, STATE, Case, draw, outcome
from torch import Tensor

from physid.effects.contact.friction_drift import FrictionDrift
from physid.effects.dynamics.tether import Tether
from physid.effects.dynamics.viscous_drag import ViscousDrag
from physid.physics import Effect, Parameters, PhysicsLayer, Plane, State, World
from physid.physics.rotations import exponential
from physid.physics.schemes.integration import Midpoint
from physid.scenes import SETUPS

DIFFERENCE = 1e-6  # step of central differences
AGREES = 2e-5  # what they leave of a derivative, relative to the largest of its kind
NAMES = ("mass", "inertia", "friction", "restitution", "size", "pose", "twist", "wrench")


@dataclasses.dataclass(frozen=True)
class Motion:
    """A short motion in one regime of contact.

    Attributes:
        height: Of the centre [m].
        velocity: Linear [m/s].
        turn: Rotation vector [rad].
        spin: [rad/s], body at start.
        force: [N].
        steps: At 60 Hz.
    """

    height: float
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turn: tuple[float, float, float] = (0.0, 0.0, 0.0)
    spin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    force: tuple[float, float, float] = (0.0, 0.0, 0.0)
    steps: int = 8
    restitution: float = 0.5


MOTIONS = {
    "flies and turns": Motion(1.0, (1.0, 0, 2.0), (0.2, 0.1, 0.3), (8.0, -6.0, 4.0)),
    "slides": Motion(0.05, (2.0, 0.3, 0), force=(2.0, 0.5, 0.3)),
    "slides and turns": Motion(0.05, (2.5, 0.3, 0), spin=(0, 0, 5.0), force=(2.0, 0.5, 0)),
    "stops": Motion(0.05, (0.35, 0.1, 0), force=(0.4, 0, 0)),
    "lands flat and slides": Motion(0.083, (1.0, 0.2, 0), restitution=0.01),
    "bounces flat": Motion(0.117, (0.6, 0.2, -1.0)),
    "hits with a corner": Motion(0.14, (0.4, 0.1, -0.8), (0.3, 0.4, 0.0), (0.5, 1.0, 0.3), steps=6),
    "tips over an edge": Motion(0.1136, turn=(0, 0.5, 0), steps=4),
}


def leaves(motion: Motion) -> dict[str, Tensor]:
    one = torch.ones(1, 1, dtype=torch.float64)
    pose = torch.cat([torch.tensor([0.1, -0.2, motion.height]), exponential(torch.tensor(motion.turn).double())])
    wrench = torch.zeros(1, motion.steps, 1, 6, dtype=torch.float64)
    wrench[..., 3:] = torch.tensor(motion.force)
    return {
        "mass": 0.8 * one,
        "inertia": torch.tensor([[[0.002, 0.0031, 0.0039]]], dtype=torch.float64),
        "friction": 0.3 * one,
        "restitution": motion.restitution * one,
        "size": torch.tensor([[[0.2, 0.16, 0.1]]], dtype=torch.float64),
        "pose": pose[None, None],
        "twist": torch.tensor([[[*motion.spin, *motion.velocity]]], dtype=torch.float64),
        "wrench": wrench,
    }


def loss_of(world: World, backend: str, effects: tuple[Effect, ...] = ()) -> Callable[[dict[str, Tensor]], Tensor]:
    layer = PhysicsLayer(world, effects, backend=backend)  # type: ignore[arg-type]

    def loss(values: dict[str, Tensor]) -> Tensor:
        names = ("size", "mass", "inertia", "friction", "restitution")
        parameters = Parameters(**{name: values[name] for name in names})
        rollout = layer.rollout(State(values["pose"], values["twist"]), values["wrench"], parameters)
        generator = torch.Generator().manual_seed(5)
        parts = (rollout.pose[:, -1], rollout.twist[:, -1], rollout.pose[:, 2], 0.1 * rollout.impulse.sum((1, 2)))
        return torch.stack([(torch.randn(x.shape, generator=generator, dtype=x.dtype) * x).sum() for x in parts]).sum()

    return loss


def central(loss: Callable[[dict[str, Tensor]], Tensor], values: dict[str, Tensor], name: str) -> Tensor:
    """Return the derivative of a loss by every number of a tensor, by central differences."""
    slopes = torch.zeros_like(values[name])
    for k in range(slopes.numel()):
        ends = []
        for sign in (1.0, -1.0):
            moved = values[name].clone()
            moved.view(-1)[k] += sign * DIFFERENCE
            with torch.no_grad():
                ends.append(float(loss(values | {name: moved})))
        slopes.view(-1)[k] = (ends[0] - ends[1]) / (2 * DIFFERENCE)
    return slopes


@pytest.mark.parametrize("backend", ["reference", "fused"])
@pytest.mark.parametrize("motion", MOTIONS.values(), ids=[name.replace(" ", "_") for name in MOTIONS])
def test_gradients_agree_with_central_differences(motion: Motion, backend: str) -> None:
    slope = World(time_step=1 / 60, integration=Midpoint(), ground=Plane((0.0, 0.0, 1.0), 0.0))
    values, loss = leaves(motion), loss_of(slope, "fused")
    wanted = {name: value.clone().requires_grad_() for name, value in values.items()}
    gradients = torch.autograd.grad(loss_of(slope, backend)(wanted), list(wanted.values()), allow_unused=True)
    for name, gradient in zip(wanted, gradients, strict=True):
        expected = central(loss, values, name)
        found = torch.zeros_like(expected) if gradient is None else gradient
        scale = max(float(expected.abs().max()), 1e-2)
        torch.testing.assert_close(found, expected, rtol=0, atol=AGREES * scale, msg=lambda m, n=name: f"{n}: {m}")


@pytest.mark.slow
@pytest.mark.parametrize(("rate", "restitution"), [(60, 0.6), (60, 0.0), (240, 0.0), (240, 0.6)])
@pytest.mark.parametrize("setup", SETUPS, ids=lambda setup: setup.scene.name)
def test_both_backends_agree_in_every_scene(setup, rate: int, restitution: float) -> None:  # noqa: ANN001
    case = draw(setup, 9, 16, seed=1)  # with seed 0 a collision at 60 Hz meets a kink, of which rounding picks a side
    if setup.scene.name == "toss":
        case.tensors["pose"][:, :, 2] = 0.2
    case.tensors["restitution"] = torch.full_like(case.tensors["restitution"], restitution)
    assert_equal(case, rate)


@pytest.mark.parametrize(
    "effect", [FrictionDrift(torch.tensor([0.4])), ViscousDrag(torch.tensor([0.4])), Tether(torch.tensor([4.0]))]
)
def test_both_backends_agree_under_effects_of_time_and_state(effect: Effect) -> None:
    assert_equal(draw(SETUPS[0], 3, 6), 60, (effect.to(torch.zeros(1, dtype=torch.float64)),), substeps=2)


def assert_equal(case: Case, rate: int, effects: tuple[Effect, ...] = (), substeps: int = 1) -> None:
    world = dataclasses.replace(case.world, integration=Midpoint(), time_step=1 / rate, substeps=substeps)
    case = Case(world, case.tensors)
    reference, fused = outcome(case, "reference", effects), outcome(case, "fused", effects)
    for name, expected in reference.items():
        tolerance = (10 * GRADIENT if name.startswith("by ") else STATE) * max(float(expected.abs().max()), 1e-6)
        torch.testing.assert_close(fused[name], expected, rtol=0, atol=tolerance, msg=lambda m, n=name: f"{n}: {m}")
