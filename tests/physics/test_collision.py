"""Contacts between boxes."""

import math
from dataclasses import replace

import torch
from torch import Tensor

from physid.physics.contact import Patch
from physid.physics.rotations import exponential, multiply, rotate
from physid.physics.shapes.box import Box, box_on_box
from physid.physics.shapes.shape import Placed, frame_of


def pose(position: list[float], turn: tuple[float, float, float] = (0, 0, 0)) -> Tensor:
    return torch.cat(
        [torch.tensor(position, dtype=torch.float64), exponential(torch.tensor(turn, dtype=torch.float64))]
    )[None]


CUBE = torch.full((1, 3), 0.2, dtype=torch.float64)


def between(first: Tensor, second: Tensor) -> Patch:
    return box_on_box(Placed(0, first, CUBE), Placed(1, second, CUBE))


def touch(second: Tensor, first: Tensor | None = None) -> Patch:
    return between(pose([0, 0, 0]) if first is None else first, second)


def test_flush_faces_touch_at_the_four_corners_of_their_overlap() -> None:
    patch = touch(pose([0.19, 0.05, 0.02]))
    assert bool(patch.active.all())
    torch.testing.assert_close(patch.gap, torch.full((1, 4), -0.01, dtype=torch.float64), rtol=0, atol=1e-12)
    torch.testing.assert_close(patch.frame[0, 0], torch.tensor([1.0, 0, 0], dtype=torch.float64))
    low, high = patch.point[0, :, 1:].amin(0), patch.point[0, :, 1:].amax(0)
    torch.testing.assert_close(low, torch.tensor([-0.05, -0.08], dtype=torch.float64))
    torch.testing.assert_close(high, torch.tensor([0.1, 0.1], dtype=torch.float64))


def test_what_four_contacts_leave_undetermined_has_no_force_and_no_moment() -> None:
    """n of `Patch.warp`: sum n_i = 0 and sum n_i x_i = 0 for any flat quadrilateral, and it is a unit vector."""
    patch = touch(pose([0.19, 0.05, 0.02]))
    corners = torch.tensor(
        [[[0, -0.05, -0.08], [0, 0.1, -0.07], [0, 0.06, 0.09], [0, -0.02, 0.05]]], dtype=torch.float64
    )
    combination = replace(patch, point=corners).warp()
    torch.testing.assert_close(combination.square().sum(1), torch.ones(1, dtype=torch.float64))
    for moment in (combination.sum(1), torch.einsum("bi,bik->bk", combination, corners)):
        torch.testing.assert_close(moment, torch.zeros_like(moment), rtol=0, atol=1e-12)


def test_a_yawed_box_touches_with_its_vertical_edge() -> None:
    corner = 0.1 * math.sqrt(2)
    patch = touch(pose([0.1 + corner - 0.001, 0, 0], (0, 0, math.pi / 4)))
    near = patch.active[0] & (patch.gap[0] < 0)
    assert int(near.sum()) == 2
    torch.testing.assert_close(patch.gap[0, near], torch.full((2,), -0.001, dtype=torch.float64), rtol=0, atol=1e-9)
    assert patch.point[0, near, 1].abs().max() < 1e-9


def test_crossed_edges_touch_in_one_point() -> None:
    rolled, pitched = pose([0, 0, 0], (math.pi / 4, 0, 0)), (0.0, math.pi / 4, 0.0)
    height = 0.2 * math.sqrt(2) - 0.002
    patch = touch(pose([0, 0, height], pitched), rolled)
    assert int(patch.active.sum()) == 1
    active = patch.active[0]
    torch.testing.assert_close(patch.gap[0, active], torch.tensor([-0.002], dtype=torch.float64), rtol=0, atol=1e-9)
    torch.testing.assert_close(patch.frame[0, 0], torch.tensor([0, 0, 1.0], dtype=torch.float64))
    middle = torch.tensor([[0, 0, 0.1 * math.sqrt(2) - 0.001]], dtype=torch.float64)
    torch.testing.assert_close(patch.point[0, active], middle, rtol=0, atol=1e-9)


def test_boxes_that_pass_each_other_sideways_do_not_touch() -> None:
    patch = touch(pose([0.2, 0.25, 0]))
    assert not bool((patch.active & (patch.gap < 0)).any())


def test_swapping_the_boxes_swaps_the_normal_and_keeps_the_gap() -> None:
    first, second = pose([0, 0, 0], (0, 0, 0.3)), pose([0.21, 0.03, 0.01], (0, 0, -0.4))
    one = between(first, second)
    other = between(second, first)
    torch.testing.assert_close(one.gap[one.active].min(), other.gap[other.active].min(), rtol=0, atol=1e-9)
    torch.testing.assert_close(one.frame[:, 0], -other.frame[:, 0], rtol=0, atol=1e-9)


def test_contacts_move_with_the_world() -> None:
    turn = exponential(torch.tensor([0.3, -0.2, 0.9], dtype=torch.float64))

    def moved(p: Tensor) -> Tensor:
        return torch.cat([rotate(turn, p[:, :3]) + 0.7, multiply(turn.expand(1, 4), p[:, 3:])], -1)

    first, second = pose([0, 0, 0], (0.1, 0, 0.3)), pose([0.205, 0.03, 0.01], (0, 0.2, -0.4))
    here = between(first, second)
    there = between(moved(first), moved(second))
    torch.testing.assert_close(here.gap, there.gap, rtol=0, atol=1e-12)
    torch.testing.assert_close(rotate(turn, here.point) + 0.7, there.point, rtol=0, atol=1e-12)


def test_gaps_are_differentiable_in_the_poses() -> None:
    def gaps(p: Tensor) -> Tensor:
        patch = between(pose([0, 0, 0], (0, 0, 0.1)), p)
        return torch.cat([patch.gap.flatten(), patch.point.flatten()])

    start = pose([0.2, 0.04, 0.013], (0.02, 0.05, -0.2)).requires_grad_()
    assert torch.autograd.gradcheck(gaps, (start,), atol=1e-6)


def test_the_four_lowest_corners_of_a_tilted_box_are_found() -> None:
    normal, offset = torch.tensor([0, 0, 1.0], dtype=torch.float64), torch.tensor(0.0, dtype=torch.float64)
    patch = Box().on_plane(Placed(0, pose([0, 0, 0.1], (0, 0.05, 0)), CUBE), normal, offset)
    heights = 0.1 - 0.1 * math.cos(0.05) + torch.tensor([-1, -1, 1, 1], dtype=torch.float64) * 0.1 * math.sin(0.05)
    torch.testing.assert_close(patch.gap[0].sort().values, heights.sort().values, rtol=0, atol=1e-12)


def test_frames_are_right_handed_and_orthonormal() -> None:
    normals = torch.nn.functional.normalize(torch.randn(20, 3, dtype=torch.float64), dim=-1)
    frames = frame_of(normals)
    torch.testing.assert_close(
        frames @ frames.mT, torch.eye(3, dtype=torch.float64).expand(20, 3, 3), rtol=0, atol=1e-12
    )
    torch.testing.assert_close(torch.linalg.det(frames), torch.ones(20, dtype=torch.float64))
