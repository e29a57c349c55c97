"""Impacts on a ground that yields: a bounce is that of a rigid ground, all else is taken up by the damped spring."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from physics.worlds import boxes, forces, state
from physid.effects.contact.contact_compliance import ContactCompliance
from physid.physics import PhysicsLayer, Rollout, World
from physid.physics.schemes.integration import Midpoint

G = 9.81
BACKENDS = ("reference", "fused")


def soft(compliance: float) -> list[ContactCompliance]:
    return [ContactCompliance(torch.tensor([compliance], dtype=torch.float64))]


def fall(compliance: float, steps: int, rate: float, backend: str, **body: object) -> Rollout:
    """Let a box whose lower face is at a height of `height` fall at `speed` [m/s]."""
    height, speed = body.pop("height", 0.0), body.pop("speed", 0.0)
    layer = PhysicsLayer(World(time_step=1 / rate, integration=Midpoint()), soft(compliance), backend=backend)  # type: ignore[arg-type]
    start = state([[0, 0, 0.1 + height]], [[0.0, 0.0, -speed]])  # type: ignore[operator]
    with torch.no_grad():
        return layer.rollout(start, forces(steps, [[0.0, 0, 0]]), boxes(**body))  # type: ignore[arg-type]


@pytest.mark.slow
@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("compliance", [1e-9, 1e-6, 1e-4, 1e-3])
@pytest.mark.parametrize("restitution", [0.2, 0.45, 0.9])
def test_what_bounces_leaves_with_the_restitution_however_the_ground_yields(
    restitution: float, compliance: float, backend: str
) -> None:
    speed, time = (2 * G * 0.05) ** 0.5, (2 * 0.05 / G) ** 0.5
    rate = 240
    steps = int((time + 1.8 * restitution * speed / G) * rate)
    flown = fall(compliance, steps, rate, backend, height=0.05, restitution=restitution).pose[0, :, 0, 2] - 0.1
    since = torch.arange(steps + 1, dtype=torch.float64) / rate - time
    rising = restitution * speed * since - G * since**2 / 2
    torch.testing.assert_close(flown[since > 0], rising[since > 0], rtol=0, atol=2e-6)


@pytest.mark.parametrize("backend", [pytest.param("reference", marks=pytest.mark.slow), "fused"])
@pytest.mark.parametrize("compliance", [6e-4, pytest.param(1e-4, marks=pytest.mark.slow)])
def test_a_blow_without_a_bounce_is_taken_up_by_a_critically_damped_spring(compliance: float, backend: str) -> None:
    """z = -s (1 - (1 + w t) exp(-w t)) - v t exp(-w t), see `test_midpoint`, to the first order of the step."""
    mass, speed = 2.0, 1.0
    frequency, deep, off = 2 / (compliance * mass) ** 0.5, compliance * mass * G / 4, []
    for count in (60, 120):
        time = torch.linspace(0, 6 / frequency, count + 1, dtype=torch.float64)
        rollout = fall(compliance, count, 1 / float(time[1]), backend, speed=speed, mass=[mass], restitution=0.0)
        decay = torch.exp(-frequency * time)
        known = deep * (1 - (1 + frequency * time) * decay) + speed * time * decay
        off.append(float((0.1 - rollout.pose[0, :, 0, 2] - known).abs().max()) / float(known.max()))
    assert off[1] < 0.06
    assert off[1] < 0.6 * off[0]


@pytest.mark.slow
def test_both_engines_agree_on_bounces_that_lean_and_on_their_derivatives() -> None:
    slopes: list[Tensor] = []
    for backend in BACKENDS:
        compliance = torch.tensor([1e-4], dtype=torch.float64, requires_grad=True)
        parameters = boxes(mass=[1.3], restitution=0.4)
        leaves = (parameters.mass, parameters.restitution, parameters.friction)
        for leaf in leaves:
            leaf.requires_grad_()
        world = World(time_step=1 / 480, integration=Midpoint())
        layer = PhysicsLayer(world, [ContactCompliance(compliance)], backend=backend)  # type: ignore[arg-type]
        start = state([[0, 0, 0.18]], [[0.5, 0.2, -0.5]], [[0.3, 1.5, 0.0]])
        rollout = layer.rollout(start, forces(120, [[0.0, 0, 0]]), parameters)
        assert float(rollout.twist[0, :, 0, 5].detach().max()) > 0.1, "it bounces"
        weights = torch.linspace(0.5, 1.5, 7, dtype=torch.float64)
        found = torch.autograd.grad((rollout.pose[0, -1, 0] * weights).sum(), (compliance, *leaves))
        slopes.append(torch.cat([rollout.pose[0, -1, 0].detach(), *(each.flatten() for each in found)]))
    torch.testing.assert_close(slopes[0], slopes[1], rtol=1e-6, atol=1e-9)
