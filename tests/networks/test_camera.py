import math

import numpy as np
import pybullet
import pytest
import torch

from physid.networks import PinholeCamera

TOLERANCE = 1e-9
TILTED = PinholeCamera(160, 120, (0.4, -1.0, 1.5), (0.1, 0.2, 0.0), (0.0, 0.0, 1.0), 50.0)


def points() -> torch.Tensor:
    return torch.rand(20, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(1)) - 0.5


def test_the_target_falls_on_the_middle_of_the_image() -> None:
    middle = TILTED.project(torch.tensor(TILTED.target, dtype=torch.float64))
    assert torch.allclose(middle, torch.tensor([80.0, 60.0], dtype=torch.float64), atol=TOLERANCE)


def test_half_the_opening_angle_above_the_axis_is_the_upper_border() -> None:
    camera = PinholeCamera(160, 120, (0, 0, 2), (0, 0, 0), (0, 1, 0), 50.0)
    top = torch.tensor([0.0, 2 * math.tan(math.radians(25)), 0.0], dtype=torch.float64)
    assert torch.allclose(camera.project(top), torch.tensor([80.0, 0.0], dtype=torch.float64), atol=TOLERANCE)


def test_projection_equals_the_matrices_of_pybullet() -> None:
    view = pybullet.computeViewMatrix(TILTED.position, TILTED.target, TILTED.up)
    lens = pybullet.computeProjectionMatrixFOV(TILTED.fov_y, TILTED.width / TILTED.height, 0.1, 10.0)
    clip = np.hstack([points().numpy(), np.ones((20, 1))]) @ np.reshape(view, (4, 4)) @ np.reshape(lens, (4, 4))
    normalized = clip[:, :2] / clip[:, 3:]
    expected = np.stack([(1 + normalized[:, 0]) * 80, (1 - normalized[:, 1]) * 60], -1)
    assert np.allclose(TILTED.project(points()), expected, atol=1e-4)  # pybullet hands out single precision


def test_a_point_lies_on_the_ray_of_its_image() -> None:
    depth = TILTED.to_camera(points())[:, 2:]
    back = torch.tensor(TILTED.position) + depth * TILTED.rays(TILTED.project(points()))
    assert torch.allclose(back, points(), atol=1e-6)


def test_the_camera_axes_are_a_rotation() -> None:
    rotation = TILTED.rotation
    assert torch.allclose(rotation @ rotation.T, torch.eye(3, dtype=torch.float64), atol=TOLERANCE)
    assert torch.linalg.det(rotation) == pytest.approx(1)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"up": (0.0, 0.0, 1.0), "position": (0, 0, 2), "target": (0, 0, 0)}, "parallel"),
        ({"target": (0.4, -1.0, 1.5)}, "differ"),
        ({"fov_y": 180.0}, "fov_y"),
        ({"width": 0}, "width"),
    ],
)
def test_an_impossible_camera_is_refused(change: dict[str, object], complaint: str) -> None:
    values = {"width": 160, "height": 120, "position": (0.4, -1.0, 1.5), "target": (0.1, 0.2, 0.0), "up": (0, 0, 1)}
    with pytest.raises(ValueError, match=complaint):
        PinholeCamera(**{**values, "fov_y": 50.0, **change})  # type: ignore[arg-type]
