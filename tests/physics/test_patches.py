"""What four contacts leave undetermined: how flat they lie, how they twist a face, how they tip a body."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from physid.physics.contact import FLATNESS, PATCH, Patch
from physid.physics.shapes.shape import frame_of

DTYPE = torch.float64
UP = torch.tensor([0, 0, 1.0], dtype=DTYPE)
SQUARE = torch.tensor([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], dtype=DTYPE)
ALL = torch.ones(1, PATCH, dtype=torch.bool)


def patch(
    point: Tensor = SQUARE,
    gap: list[float] | None = None,
    active: Tensor = ALL,
    scale: float = 1.0,
    together: float | None = None,
    normal: Tensor = UP,
) -> Patch:
    """Return a patch between a body and the ground, in a batch of one."""
    gaps = torch.tensor([gap or [0.0] * PATCH], dtype=DTYPE)
    weight = None if together is None else torch.tensor([together], dtype=DTYPE)
    size = torch.tensor([scale], dtype=DTYPE)
    return Patch(None, 0, point[None], gaps, frame_of(normal[None]), active, size, weight)


@pytest.mark.parametrize("scale", [1.0, 0.2])
@pytest.mark.parametrize("spread", [0.0, 0.3, 1.0, 2.0])
def test_a_face_is_as_flat_as_a_gaussian_of_the_spread_of_its_gaps_says(spread: float, scale: float) -> None:
    high, low = (1e-4 + sign * spread * FLATNESS * scale for sign in (1, -1))
    assert float(patch(gap=[high, low, low, high], scale=scale).flatness()) == pytest.approx(math.exp(-(spread**2)))


def test_a_face_that_leans_by_a_hundredth_of_its_size_does_not_lie_flat_and_by_a_hundred_thousandth_it_does() -> None:
    assert float(patch(gap=[0.0, 0.0, 0.2, 0.2], scale=20.0).flatness()) < 1e-9
    assert float(patch(gap=[0.0, 0.0, 2e-4, 2e-4], scale=20.0).flatness()) > 0.999


def test_a_face_with_a_missing_contact_is_not_flat_but_where_an_impact_stops_all_of_it() -> None:
    three = torch.tensor([[True, True, True, False]])
    assert float(patch(active=three).flatness()) == 0.0
    assert float(patch(active=three, together=0.4).flatness()) == 0.4
    uneven = [FLATNESS, -FLATNESS] * 2
    assert float(patch(gap=uneven, together=0.9).flatness()) == 0.9
    assert float(patch(gap=uneven, together=0.1).flatness()) == pytest.approx(math.exp(-1))


@pytest.mark.parametrize("scale", [1.0, 0.2])
def test_a_square_is_twisted_by_its_diagonals(scale: float) -> None:
    found = patch(scale=scale).warp()
    torch.testing.assert_close(found.abs(), torch.full_like(found, 0.5))
    assert float(found[0, 0] * found[0, 2]) > 0 > float(found[0, 0] * found[0, 1])
    half = patch(gap=[FLATNESS * scale, -FLATNESS * scale] * 2, scale=scale).warp()
    torch.testing.assert_close(half, math.exp(-1) * found)


def test_a_twist_has_no_force_and_no_moment_whatever_the_normal() -> None:
    generator = torch.Generator().manual_seed(0)
    for _ in range(5):
        normal = torch.nn.functional.normalize(torch.randn(3, generator=generator, dtype=DTYPE), dim=0)
        across = torch.randn(PATCH, 2, generator=generator, dtype=DTYPE) @ frame_of(normal)[1:] + 0.3
        found = patch(across, normal=normal).warp()[0]
        assert float(found.norm()) == pytest.approx(1.0)
        assert float(found.sum().abs()) < 1e-12
        assert float((found @ across).norm()) < 1e-12


def test_contacts_in_one_point_twist_nothing() -> None:
    assert float(patch(torch.zeros(PATCH, 3, dtype=DTYPE)).warp().abs().max()) == 0.0


@pytest.mark.parametrize("scale", [1.0, 0.25])
@pytest.mark.parametrize("lift", [0.0, 7.0])
def test_contacts_tip_a_body_by_their_heights_above_the_mean_scaled_to_length_one(lift: float, scale: float) -> None:
    heights = torch.tensor([0.3, -0.1, 0.5, 0.1], dtype=DTYPE)
    found = patch(SQUARE + (heights + lift)[:, None] * UP, scale=scale).lever(UP, ALL)[0]
    above = (heights - heights.mean()) / scale
    torch.testing.assert_close(found, above / (above.square().sum() + 1e-6).sqrt(), rtol=0, atol=1e-12)
    assert float(found.norm()) == pytest.approx(1.0, abs=1e-5)
    assert abs(float(found.sum())) < 1e-12


@pytest.mark.parametrize("there", [(0, 1, 2), (1, 3), (2,), ()])
def test_only_contacts_that_exist_tip_a_body_about_their_own_mean(there: tuple[int, ...]) -> None:
    heights = torch.tensor([0.3, -0.1, 0.5, 0.1], dtype=DTYPE)
    exists = torch.zeros(1, PATCH, dtype=torch.bool)
    exists[:, list(there)] = True
    found = patch(SQUARE + heights[:, None] * UP).lever(UP, exists)[0]
    own = heights[list(there)]
    above = torch.zeros(PATCH, dtype=DTYPE)
    above[list(there)] = own - own.sum() / max(len(there), 1)
    torch.testing.assert_close(found, above / (above.square().sum() + 1e-6).sqrt(), rtol=0, atol=1e-12)


def test_a_lever_is_the_same_for_contacts_seen_from_a_turned_world() -> None:
    heights = torch.tensor([0.3, -0.1, 0.5, 0.1], dtype=DTYPE)
    up = torch.tensor([0.6, 0, 0.8], dtype=DTYPE)
    across = torch.tensor([[0.8, 0, -0.6], [0, 1, 0]], dtype=DTYPE)
    turned = SQUARE[:, :2] @ across + heights[:, None] * up
    here = patch(SQUARE + heights[:, None] * UP).lever(UP, ALL)
    torch.testing.assert_close(patch(turned, normal=up).lever(up, ALL), here)
