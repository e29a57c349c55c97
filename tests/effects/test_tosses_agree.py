"""Every effect in a toss: the engine and MuJoCo with fine steps go the same way through flight, impacts and rest."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import torch

from physid.data.generation.draw import laid
from physid.effects import CATALOGUE, find, from_values
from physid.physics import Effect, Parameters, PhysicsLayer, Plane, State, World
from physid.physics.schemes.integration import Midpoint
from physid.scenes import find_setup
from physid.simulators import find_simulator

ACTING = [effect.name for effect in CATALOGUE if effect.observe is Effect.observe]
FRAMES, SUBSTEPS = 60, 16
TOGETHER = 5e-4  # [m] what fine steps leave after several impacts, a fiftieth of what most effects move the block by


@pytest.mark.slow
@pytest.mark.parametrize("name", ACTING)
def test_an_effect_leads_a_toss_where_it_leads_one_in_mujoco(name: str) -> None:
    setup = find_setup("toss")
    scene = setup.scene.with_bodies([dataclasses.replace(body, restitution=0.4) for body in setup.scene.bodies])
    effects = [from_values(name, {key: quantity.typical for key, quantity in find(name).quantities().items()})]
    drawn = laid(setup.draw(scene, "rich", np.random.default_rng(1), FRAMES), scene, effects)
    there = find_simulator("mujoco").simulate(scene, [drawn], effects, SUBSTEPS)[0].pose

    def batch(value: object) -> torch.Tensor:
        return torch.as_tensor(np.asarray(value, dtype=float))[None]

    ground = Plane(scene.ground.normal, scene.ground.offset)
    world = World(scene.time_step, SUBSTEPS, gravity=scene.gravity, ground=ground, integration=Midpoint())
    values = ([getattr(body, key) for body in scene.bodies] for key in ("size", "mass", "friction", "restitution"))
    start = State.checked(batch(drawn.pose), batch(drawn.twist))
    with torch.no_grad():
        rollout = PhysicsLayer(world, effects).rollout(
            start, batch(drawn.wrench[:-1]), Parameters.of_boxes(*map(batch, values))
        )
    assert float(rollout.twist[0, :, 0, 5].diff().max()) > 1.0, "it bounces"
    assert np.abs(rollout.pose[0].numpy() - there)[..., :3].max() < TOGETHER
