import math

import pytest
import torch
from tests.networks.residual import rotation_residual

from physid.networks import PinholeCamera, PlanarChart, PoseChart, SpatialChart
from physid.networks.symmetry import Symmetry
from physid.physics.rotations import exponential, rotate

TOLERANCE = 1e-6
TOP_DOWN = PinholeCamera(128, 128, (0.1, 0.2, 3.0), (0.1, 0.2, 0.0), (0.0, 1.0, 0.0), 40.0)
TILT = 0.4
NORMAL = (math.sin(TILT), 0.0, math.cos(TILT))
INCLINE_VIEW = PinholeCamera(160, 128, (0.5, -0.3, 3.0), (0.1, 0.2, 0.0), (0.0, 1.0, 0.0), 40.0)


def planar(symmetry: Symmetry, *, hovering: bool = False) -> PlanarChart:
    return PlanarChart(INCLINE_VIEW, NORMAL, 0.1, [0.2, 0.3], [symmetry] * 2, hovering=hovering)


def numbers(chart: PoseChart) -> torch.Tensor:
    return 2 * torch.rand(40, 2, chart.numbers, generator=torch.Generator().manual_seed(0)) - 1


@pytest.mark.parametrize(
    "chart",
    [*(planar(s, hovering=h) for s in Symmetry for h in (False, True)), SpatialChart(INCLINE_VIEW, 2)],
    ids=lambda c: f"{type(c).__name__}-{c.numbers}-{c.symmetries[0].name}",
)
def test_poses_come_back_from_their_numbers(chart: PoseChart) -> None:
    pose = chart.to_pose(numbers(chart))
    back = chart.to_pose(chart.to_numbers(pose))
    assert torch.allclose(back[..., :3], pose[..., :3], atol=TOLERANCE)
    assert rotation_residual(back[..., 3:], pose[..., 3:], chart.symmetries).abs().max() < 1e-5
    assert torch.allclose(pose[..., 3:].norm(dim=-1), torch.ones(40, 2), atol=TOLERANCE)


@pytest.mark.parametrize("symmetry", Symmetry)
def test_poses_that_look_alike_have_the_same_numbers(symmetry: Symmetry) -> None:
    chart = planar(symmetry)
    angles = torch.linspace(-4, 4, 33)
    raw = torch.stack([0 * angles, 0 * angles, (symmetry.order * angles).cos(), (symmetry.order * angles).sin()], -1)
    pose = chart.to_pose(raw[:, None].expand(-1, 2, -1))
    assert torch.allclose(chart.to_numbers(pose)[:, 0], raw, atol=1e-5)


def test_a_planar_body_rests_on_its_plane_with_its_z_axis_along_the_normal() -> None:
    chart = planar(Symmetry.SQUARE)
    pose = chart.to_pose(numbers(chart))
    normal = torch.tensor(NORMAL)
    assert torch.allclose(pose[..., :3] @ normal - 0.1, torch.tensor([0.1, 0.15]), atol=TOLERANCE)
    z = rotate(pose[..., 3:], torch.tensor([0.0, 0.0, 1.0]).expand_as(pose[..., :3]))
    assert torch.allclose(z, normal.expand_as(z), atol=TOLERANCE)


def test_a_hovering_body_is_lifted_along_the_normal() -> None:
    chart = planar(Symmetry.NONE, hovering=True)
    low, high = torch.tensor([0.2, 0.3, 1.0, 0.0, 0.0]), torch.tensor([0.2, 0.3, 1.0, 0.0, 0.4])
    lift = (chart.to_pose(high.expand(2, 5)) - chart.to_pose(low.expand(2, 5)))[..., :3]
    across = torch.linalg.cross(lift, torch.tensor(NORMAL).expand_as(lift))
    assert across.abs().max() < TOLERANCE
    assert (lift @ torch.tensor(NORMAL) > 0.1).all()


def test_without_tilt_the_numbers_of_a_planar_chart_are_normalized_image_coordinates() -> None:
    chart = PlanarChart(TOP_DOWN, (0, 0, 1), 0.0, [0.2])
    raw = torch.tensor([[[0.0, 0.0, 1.0, 0.0]], [[0.5, -0.25, 1.0, 0.0]], [[-1.0, 1.0, 1.0, 0.0]]])
    image = TOP_DOWN.project(chart.to_pose(raw)[..., :3])
    assert torch.allclose(image, 64 * (1 + raw[..., :2]), atol=1e-3)


def test_the_numbers_of_a_spatial_chart_are_image_coordinates_at_any_depth() -> None:
    chart = SpatialChart(INCLINE_VIEW, 2)
    raw = numbers(chart)
    image = INCLINE_VIEW.project(chart.to_pose(raw)[..., :3])
    assert torch.allclose(image, torch.tensor([80.0, 64.0]) * (1 + raw[..., :2]), atol=1e-3)


@pytest.mark.parametrize("chart", [planar(Symmetry.SQUARE), SpatialChart(INCLINE_VIEW, 2)], ids=["planar", "spatial"])
def test_gradients_are_right_everywhere_around_the_circle(chart: PoseChart) -> None:
    raw = numbers(chart).double()[:5].requires_grad_()
    assert torch.autograd.gradcheck(chart, raw)


def test_crossing_the_seam_of_the_angle_does_not_jump_in_what_can_be_seen() -> None:
    chart = planar(Symmetry.RECTANGLE)
    before, after = ([0.0, 0.0, -1.0, s] for s in (1e-4, -1e-4))
    poses = chart.to_pose(torch.tensor([before, after])[:, None].expand(-1, 2, -1))
    assert rotation_residual(poses[0, :, 3:], poses[1, :, 3:], chart.symmetries).norm(dim=-1).max() < 1e-3


@pytest.mark.parametrize("chart", [planar(Symmetry.SQUARE, hovering=True), SpatialChart(INCLINE_VIEW, 2)])
def test_the_neutral_pose_is_unturned_in_the_middle_of_the_view(chart: PoseChart) -> None:
    pose = chart.to_pose(chart.neutral().expand(2, -1))
    assert torch.allclose(INCLINE_VIEW.project(pose[:, :3]), torch.tensor([80.0, 64.0]), atol=1e-3)
    upright = torch.tensor([0.0, TILT, 0.0]) if isinstance(chart, PlanarChart) else torch.zeros(3)
    assert torch.allclose(pose[:, 3:], exponential(upright).expand(2, 4), atol=TOLERANCE)


def test_a_camera_that_does_not_look_down_on_the_plane_is_refused() -> None:
    with pytest.raises(ValueError, match="look down on the plane"):
        PlanarChart(TOP_DOWN, (0, 0, -1), 0.0, [0.2])
    with pytest.raises(ValueError, match="look down on the plane"):
        PlanarChart(TOP_DOWN, (0, 0, 1), 3.0, [0.2])


def test_bodies_and_symmetries_must_match() -> None:
    with pytest.raises(ValueError, match="one symmetry of each of 2 bodies, got 1"):
        PlanarChart(TOP_DOWN, (0, 0, 1), 0.0, [0.2, 0.2], [Symmetry.NONE])
