"""Learned parameters: positive, shared by a material, batched."""

from __future__ import annotations

import pytest
import torch

from physid.physics.shapes.table import BOX
from physid.scenes.catalogue import find_setup
from physid.training.parameters.intervals import intervals
from physid.training.parameters.physical_parameters import PhysicalParameters

EXACT = 1e-14
COLLIDE = find_setup("collide").scene


def test_bodies_of_one_material_share_their_friction() -> None:
    physical = PhysicalParameters(COLLIDE, ["block.friction"], {"block.friction": 0.3})
    assert physical().friction.tolist() == [[pytest.approx(0.3), pytest.approx(0.3)]]


def test_the_inertia_follows_the_mass_of_its_body_alone() -> None:
    physical = PhysicalParameters(COLLIDE, ["block.mass"])
    with torch.no_grad():
        physical.logarithm += 1.0
        known = physical()
    expected = BOX.inertia(known.mass, known.size)
    assert torch.allclose(known.inertia, expected, atol=EXACT)
    assert known.mass[0, 1] == COLLIDE.bodies[1].mass


def test_a_batch_of_candidates_has_one_row_for_each() -> None:
    physical = PhysicalParameters(COLLIDE, ["block.mass", "block.friction"])
    candidates = torch.tensor([[0.0, -1.0], [1.0, -2.0]], dtype=torch.float64)
    known = physical(candidates)
    assert torch.allclose(known.mass[:, 0], candidates[:, 0].exp())
    assert torch.allclose(known.friction, candidates[:, 1:].exp().expand(2, 2))


def test_a_step_leaves_no_body_that_makes_energy_when_it_bounces() -> None:
    physical = PhysicalParameters(find_setup("toss").scene, ["block.mass", "block.restitution"])
    with torch.no_grad():
        physical.logarithm += 5.0
    mass = physical.estimates()["block.mass"]
    physical.confine()
    assert physical.estimates() == {"block.mass": mass, "block.restitution": 1.0}


def test_an_interval_ends_where_the_physical_range_does() -> None:
    found = intervals({"block.mass": 0.9, "block.restitution": 0.9}, 0.04 * torch.eye(2, dtype=torch.float64), 10)
    assert found["block.restitution"][1] == 1.0 < found["block.mass"][1]
    assert found["block.restitution"][0] == found["block.mass"][0]


@pytest.mark.parametrize(
    ("learn", "message"),
    [
        ([], "say what to learn"),
        (["block.fricton"], 'did you mean "block.friction"'),
        (["block.friction", "other.friction"], "one material"),
        (["block.restitution"], "must be positive"),
    ],
)
def test_what_cannot_be_learned_is_refused(learn: list[str], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        PhysicalParameters(COLLIDE, learn)
