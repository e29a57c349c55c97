"""Arithmetic of the cones of friction."""

import pytest
import torch

from physid.physics.contact_problem.cones import arrow, cone_length, jordan


@pytest.mark.parametrize(("size", "linear"), [(5, 2), (6, 6)])
def test_the_arrow_matrix_multiplies_as_the_jordan_product(size: int, linear: int) -> None:
    x, y = torch.randn(2, 7, 3, size, dtype=torch.float64)
    torch.testing.assert_close((arrow(x, linear) @ y[..., None])[..., 0], jordan(x, y, linear), rtol=0, atol=1e-12)


def test_the_longest_step_ends_on_the_surface_of_the_cone() -> None:
    inside = torch.tensor([[2.0, 1.0, 0.5], [1.0, 0.0, 0.0]], dtype=torch.float64)
    change = torch.tensor([[-0.3, 0.4, 0.1], [-1.0, 0.0, 0.0]], dtype=torch.float64)
    end = inside + cone_length(inside, change)[:, None] * change
    torch.testing.assert_close(end[:, 0], end[:, 1:].norm(dim=-1), rtol=0, atol=1e-12)


def test_a_step_into_the_cone_may_be_as_long_as_one_likes() -> None:
    inside = torch.tensor([[1.0, 0.2, 0.1]], dtype=torch.float64)
    assert bool(cone_length(inside, torch.tensor([[1.0, 0.5, 0.2]], dtype=torch.float64)).isinf().all())
