"""Learned parameters: positive, shared by a material, batched."""

from __future__ import annotations

import pytest
import torch
from scipy.stats import norm

from physid.effects import from_values
from physid.estimation.prediction.coordinates import Coordinates, Unknown
from physid.physics.shapes.table import BOX
from physid.scenes import find_setup
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
        physical.coordinates += 1.0
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
        physical.coordinates += 5.0
    mass = physical.estimates()["block.mass"]
    physical.confine()
    assert physical.estimates() == {"block.mass": mass, "block.restitution": 1.0}


def test_an_interval_ends_where_the_physical_range_does() -> None:
    found = intervals({"block.mass": 0.9, "block.restitution": 0.9}, 0.04 * torch.eye(2, dtype=torch.float64))
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


def test_an_effect_is_learned_from_a_tenth_of_what_is_typical_or_from_where_it_is_put() -> None:
    learn, known = ["viscous_drag.coefficient", "block.friction"], (from_values("com_offset", {"x": 0.01}),)
    physical = PhysicalParameters(COLLIDE, learn, effects=known)
    assert physical.names == ("block.friction", "viscous_drag.coefficient")
    assert physical.estimates()["viscous_drag.coefficient"] == pytest.approx(0.03)
    assert [effect.name for effect in physical.effects] == ["com_offset", "viscous_drag"]
    placed = PhysicalParameters(COLLIDE, ["com_offset.x", "com_offset.y"], {"com_offset.y": -0.02}, known)
    assert placed.estimates() == pytest.approx({"com_offset.x": 0.01, "com_offset.y": -0.02})


def test_coordinates_and_values_invert_each_other_and_stay_in_range() -> None:
    space = Coordinates.of(["block.mass", "com_offset.x", "viscous_drag.coefficient"])
    values = torch.tensor([2.0, -0.013, 0.4], dtype=torch.float64)
    assert torch.allclose(space.to_values(space.to_coordinates(values)), values, atol=EXACT)
    assert space.to_values(space.within(torch.tensor([0.0, -99.0, -99.0]))).tolist() == pytest.approx([1.0, -0.05, 0.0])
    step, point = 1e-6, space.to_coordinates(values)
    slope = (space.to_values(point + step) - space.to_values(point - step)) / (2 * step)
    assert torch.allclose(space.slopes(point), slope, rtol=1e-7)


def test_what_is_fitted_has_its_unit_and_a_pure_number_none() -> None:
    units = {
        "block.mass": "kg",
        "block.friction": "",
        "block.restitution": "",
        "viscous_drag.coefficient": "N s/m",
        "force_gain.gain": "",
    }
    assert {one.name: one.unit for one in Coordinates.of(units).unknowns} == units


def test_a_linear_coordinate_counts_typical_sizes_from_no_effect_whatever_value_that_is() -> None:
    space = Coordinates((Unknown("lens.gain", "", "linear", 0.5, 3.0, scale=0.2, null=1.0),))
    values = torch.tensor([[1.0], [1.2], [0.5], [3.0]], dtype=torch.float64)
    coordinates = torch.tensor([[0.0], [1.0], [-2.5], [10.0]], dtype=torch.float64)
    assert torch.allclose(space.to_coordinates(values), coordinates, atol=EXACT)
    assert torch.allclose(space.to_values(coordinates), values, atol=EXACT)
    assert [float(end) for end in space.ends] == pytest.approx([-2.5, 10.0])


def test_an_interval_of_an_effect_may_hold_zero_and_either_sign() -> None:
    found = intervals({"com_offset.x": 0.001, "viscous_drag.coefficient": 0.0}, 0.04 * torch.eye(2).double())
    reach = 0.2 * float(norm.ppf(0.95))
    assert found["com_offset.x"] == pytest.approx((0.001 - 0.01 * reach, 0.001 + 0.01 * reach))
    assert found["viscous_drag.coefficient"] == pytest.approx((0.0, 0.3 * reach))


@pytest.mark.parametrize(
    ("learn", "values", "message"),
    [
        (["viscous_drag.coeficient"], {}, 'did you mean "viscous_drag.coefficient"'),
        (["block.inertia"], {}, "here inertia_scale.change"),
        (["block.drag"], {}, "viscous_drag.coefficient, quadratic_drag.coefficient"),
        (["block.friction"], {"viscous_drag.coefficient": 0.3}, "stands in model.engine.effects"),
        (["viscous_drag.coefficient"], {"viscous_drag.coefficient": -1.0}, "must lie between 0 and 5"),
    ],
)
def test_an_effect_that_cannot_be_learned_is_named(learn: list[str], values: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        PhysicalParameters(COLLIDE, learn, values)


def test_a_checkpoint_of_before_effects_were_learned_still_loads() -> None:
    physical = PhysicalParameters(COLLIDE, ["block.mass"])
    physical.load_state_dict({"logarithm": torch.tensor([0.5], dtype=torch.float64)})
    assert physical.coordinates.tolist() == [0.5]
