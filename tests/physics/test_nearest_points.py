"""Where shapes touch, against what brute force finds: bounded least squares, all corners, all faces, all axes."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import torch
from scipy.optimize import lsq_linear
from scipy.spatial import HalfspaceIntersection
from torch import Tensor

from physid.physics.contact import Patch
from physid.physics.rotations import exponential, multiply, to_matrix
from physid.physics.shapes.box import Box, box_on_box
from physid.physics.shapes.shape import Placed, Shape, frame_of
from physid.physics.shapes.sphere import Sphere
from physid.physics.shapes.table import contacts_of, find_patches, reach

DTYPE = torch.float64
EDGES = torch.tensor([0.2, 0.3, 0.5], dtype=DTYPE)
TURNS = torch.tensor([[0.0, 0, 0], [0.3, -0.7, 1.1], [2.0, 0.4, -0.9]], dtype=DTYPE)
EXACT = 1e-12


def uniform(*shape: int, seed: int = 0) -> Tensor:
    return 2 * torch.rand(*shape, generator=torch.Generator().manual_seed(seed), dtype=DTYPE) - 1


def body(index: int, position: Tensor, turn: Tensor, size: Tensor) -> Placed:
    """Place bodies at positions (B, 3) with rotation vectors and sizes (B or 1, 3)."""
    batch = len(position)
    pose = torch.cat([position, exponential(turn).expand(batch, 4)], -1)
    return Placed(index, pose, size.expand(batch, 3))


def ball(index: int, position: Tensor, diameter: Tensor | float) -> Placed:
    size = torch.as_tensor(diameter, dtype=DTYPE).reshape(-1, 1)
    return body(index, position, torch.zeros(1, 3, dtype=DTYPE), size.expand(-1, 3))


def found(one: Shape, other: Shape, first: Placed, second: Placed) -> Patch:
    return contacts_of(one, other)(first, second)


def assert_close(one: Tensor, other: Tensor, tolerance: float = EXACT) -> None:
    torch.testing.assert_close(one, other.expand_as(one), rtol=0, atol=tolerance)


def test_moments_are_the_second_moments_of_a_uniform_body() -> None:
    """Of a box by Gauss's points at 1 / sqrt(3) of the half edges, exact for squares; of a ball 2 m r^2 / 5."""
    mass, size = torch.tensor([2.0, 3.0], dtype=DTYPE), torch.stack([EDGES, 2 * EDGES.flip(0)])
    points = torch.tensor(list(itertools.product([-1.0, 1.0], repeat=3)), dtype=DTYPE) * size[:, None] / 12**0.5
    square = points.square().mean(1)
    assert_close(Box().inertia(mass, size), mass[:, None] * (square.sum(1, keepdim=True) - square))
    assert_close(Sphere().inertia(mass, size), (2 / 5 * mass * (size[:, 0] / 2) ** 2)[:, None])


def test_shapes_reach_as_far_as_their_outermost_point() -> None:
    quaternion, normal = exponential(TURNS), torch.nn.functional.normalize(uniform(3), dim=0)
    corners = torch.tensor(list(itertools.product([-0.5, 0.5], repeat=3)), dtype=DTYPE) * EDGES
    outermost = (corners @ to_matrix(quaternion).mT @ normal).amax(1)
    assert_close(Box().reach(quaternion, EDGES.expand(3, 3), normal), outermost)
    assert_close(Sphere().reach(quaternion, EDGES.expand(3, 3), normal), EDGES[:1] / 2)
    several = reach((Box(), Sphere()), quaternion[:2], EDGES.expand(2, 3), normal)
    assert_close(several, torch.stack([outermost[0], EDGES[0] / 2]))
    assert_close(reach((), quaternion, EDGES.expand(3, 3), normal), outermost)


def test_a_box_meets_the_ground_in_its_four_lowest_corners_from_the_lowest_up() -> None:
    normal, offset = torch.nn.functional.normalize(uniform(3, seed=1), dim=0), torch.tensor(0.3, dtype=DTYPE)
    placed = body(2, uniform(3, 3), TURNS + 0.1, torch.stack([EDGES, EDGES.flip(0), EDGES]))
    patch = Box().on_plane(placed, normal, offset)
    signs = torch.tensor(list(itertools.product([-0.5, 0.5], repeat=3)), dtype=DTYPE)
    corners = placed.pose[:, None, :3] + (signs * placed.size[:, None]) @ to_matrix(placed.pose[:, 3:]).mT
    heights = (corners @ normal - offset).sort(1)
    assert_close(patch.gap, heights.values[:, :4])
    assert_close(patch.point, corners.gather(1, heights.indices[:, :4, None].expand(-1, -1, 3)))
    assert_close(patch.frame, frame_of(normal))
    assert_close(patch.scale, torch.full((3,), 0.5, dtype=DTYPE))
    assert (patch.first, patch.second, patch.rolling) == (None, 2, False)
    assert bool(patch.active.all())


def test_a_ball_meets_the_ground_in_its_lowest_point() -> None:
    normal, offset = torch.nn.functional.normalize(uniform(3, seed=1), dim=0), torch.tensor(-0.3, dtype=DTYPE)
    placed = ball(1, uniform(4, 3), torch.tensor([0.1, 0.2, 0.3, 0.4]))
    patch, radius = Sphere().on_plane(placed, normal, offset), placed.size[:, 0] / 2
    away = patch.point[:, 0] - placed.pose[:, :3]
    assert_close(away, -radius[:, None] * normal)
    assert_close(patch.gap[:, 0], patch.point[:, 0] @ normal - offset)
    assert_close(patch.scale, 2 * radius)
    assert patch.active.tolist() == [[True, False, False, False]] * 4
    assert (patch.first, patch.second, patch.rolling) == (None, 1, True)


def test_two_balls_meet_in_the_middle_of_what_lies_between_them_on_the_line_of_centres() -> None:
    small, large = ball(0, uniform(5, 3), 0.2), ball(1, uniform(5, 3, seed=1), 0.6)
    patch, back = found(Sphere(), Sphere(), small, large), found(Sphere(), Sphere(), large, small)
    distance = (small.pose[:, :3] - large.pose[:, :3]).norm(dim=1)
    assert_close(patch.gap[:, 0], distance - 0.4)
    assert_close((patch.point[:, 0] - small.pose[:, :3]).norm(dim=1), 0.1 + patch.gap[:, 0] / 2)
    assert_close((patch.point[:, 0] - large.pose[:, :3]).norm(dim=1), (0.3 + patch.gap[:, 0] / 2).abs())
    assert_close(patch.frame[:, 0] * distance[:, None], large.pose[:, :3] - small.pose[:, :3])
    assert_close(back.frame[:, 0], -patch.frame[:, 0])
    assert_close(back.point, patch.point)
    assert_close(patch.scale, torch.full((5,), 0.2, dtype=DTYPE))
    same = found(Sphere(), Sphere(), small, ball(1, small.pose[:, :3], 0.6))
    assert_close(same.gap, torch.full((5, 4), -0.4, dtype=DTYPE), 2e-12)  # centres count as a picometre apart


@pytest.mark.parametrize("turn", TURNS)
def test_a_ball_outside_a_box_meets_the_point_of_it_that_bounded_least_squares_finds(turn: Tensor) -> None:
    centre = uniform(40, 3, seed=3)
    box = body(1, torch.full((40, 3), 0.1, dtype=DTYPE), turn, EDGES)
    patch, axes = found(Sphere(), Box(), ball(0, centre, 0.1), box), to_matrix(exponential(turn)).numpy()
    outside = 0
    for k in range(40):
        half = EDGES.numpy() / 2
        near = lsq_linear(axes, (centre[k] - 0.1).numpy(), (-half, half), tol=1e-14, lsq_solver="exact")
        if np.sqrt(2 * near.cost) < 1e-3:
            continue
        outside += 1
        point = 0.1 + torch.from_numpy(axes @ near.x)
        distance = (centre[k] - point).norm()
        assert_close(patch.gap[k, 0], distance - 0.05, 1e-6)
        assert_close(patch.point[k, 0], point, 1e-6)
        assert_close(patch.frame[k, 0], (point - centre[k]) / distance, 1e-5)
    assert outside > 20


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("depth", [0.0, 0.03])
def test_a_ball_whose_centre_is_inside_a_box_leaves_it_through_the_nearest_face(
    turn: Tensor, axis: int, side: float, depth: float
) -> None:
    inside = torch.tensor([0.01, -0.02, 0.03], dtype=DTYPE)
    inside[axis] = side * (EDGES[axis] / 2 - depth)
    axes, middle = to_matrix(exponential(turn)), torch.tensor([0.5, 0.25, -1.0], dtype=DTYPE)
    centre = middle + axes @ inside
    box = body(1, middle[None], turn, EDGES)
    patch = found(Sphere(), Box(), ball(0, centre[None], 0.1), box)
    outwards = side * axes[:, axis]
    assert_close(patch.gap[0], torch.full((4,), -depth - 0.05, dtype=DTYPE))
    assert_close(patch.point[0, 0], centre + depth * outwards)
    if depth or not bool(turn.any()):  # on the face itself, rounding says on which side the centre is
        assert_close(patch.frame[0, 0], -outwards, 1e-9)
    freed = found(Sphere(), Box(), ball(0, (centre + (depth + 0.05) * outwards)[None], 0.1), box)
    assert_close(freed.gap[0, 0], torch.zeros((), dtype=DTYPE))
    swapped = found(Box(), Sphere(), box, ball(0, centre[None], 0.1))
    assert_close(swapped.gap, patch.gap)
    assert (swapped.first, swapped.second) == (0, 1)


def test_contacts_are_those_of_each_body_with_the_ground_and_then_of_each_pair() -> None:
    pose = torch.cat([uniform(2, 3, 3), exponential(uniform(2, 3, 3, seed=1))], -1)
    size, ground = EDGES.expand(2, 3, 3), (torch.tensor([0, 0, 1.0], dtype=DTYPE), torch.tensor(0.1, dtype=DTYPE))
    pairs = [(0, 1), (0, 2), (1, 2)]
    for shapes in ((), (Box(), Sphere(), Box())):
        patches = find_patches(shapes, pose, size, ground)
        assert [each.second for each in patches[:3]] == [0, 1, 2]
        assert [{each.first, each.second} for each in patches[3:]] == [set(pair) for pair in pairs]
        assert len(find_patches(shapes, pose, size, None)) == 3
    for each, (a, b) in zip(find_patches((), pose, size, None), pairs, strict=True):
        alone = box_on_box(Placed(a, pose[:, a], size[:, a]), Placed(b, pose[:, b], size[:, b]))
        assert torch.equal(each.gap, alone.gap)


def near_pairs(batch: int) -> tuple[Placed, Placed]:
    """Return two boxes each, which overlap a little or lie a little apart, by a face, an edge or a corner."""
    one, two = uniform(batch, 3, seed=4), uniform(batch, 3, seed=5)
    one[::4], two[::4] = 0.0, 0.02 * two[::4]
    between = torch.nn.functional.normalize(uniform(batch, 3, seed=6), dim=1)
    sizes = [0.2 + 0.1 * uniform(batch, 3, seed=seed).abs() for seed in (7, 8)]
    axes = [to_matrix(exponential(turn)).mT for turn in (one, two)]
    low, high = torch.zeros(batch, dtype=DTYPE), torch.ones(batch, dtype=DTYPE)
    for _ in range(50):  # the distance at which they touch, by bisection
        middle = (low + high) / 2
        apart = separations(axes, sizes, middle[:, None] * between).amax(1) > 0
        low, high = torch.where(apart, low, middle), torch.where(apart, middle, high)
    place = (high + 4e-3 * uniform(batch, seed=9))[:, None] * between
    return body(0, torch.zeros(batch, 3, dtype=DTYPE), one, sizes[0]), body(1, place, two, sizes[1])


def directions(axes: list[Tensor]) -> Tensor:
    """Return the 15 axes of the separating axis theorem, shape (B, 15, 3); 0 for those of parallel edges."""
    crosses = [torch.linalg.cross(axes[0][:, i], axes[1][:, j]) for i in range(3) for j in range(3)]
    lengths = [cross.norm(dim=1, keepdim=True) for cross in crosses]
    units = [torch.where(n > 1e-3, c / n.clamp_min(1e-3), 0.0) for c, n in zip(crosses, lengths, strict=True)]
    return torch.cat([axes[0], axes[1], torch.stack(units, 1)], 1)


def separations(axes: list[Tensor], sizes: list[Tensor], between: Tensor) -> Tensor:
    """Return how far the boxes are apart along each axis, negative where they overlap."""
    along = directions(axes)
    spans = [((along @ own.mT).abs() * size[:, None] / 2).sum(-1) for own, size in zip(axes, sizes, strict=True)]
    apart = (along @ between[..., None]).abs()[..., 0] - spans[0] - spans[1]
    return torch.where(along.norm(dim=-1) > 0.5, apart, -10.0)


def test_two_boxes_touch_along_the_axis_of_least_overlap_and_edges_only_where_they_are_clearly_better() -> None:
    first, second = near_pairs(400)
    patch, between = box_on_box(first, second), second.pose[:, :3] - first.pose[:, :3]
    axes = [to_matrix(each.pose[:, 3:]).mT for each in (first, second)]
    along, apart = directions(axes), separations(axes, [first.size, second.size], between)
    normal = patch.frame[:, 0]
    chosen = ((along @ normal[..., None])[..., 0].abs() > 1 - 1e-9).double()
    taken = torch.where(chosen > 0, apart, -10.0).amax(1)
    smallest = torch.minimum(first.size.amin(1), second.size.amin(1)) / 2
    assert bool(((normal * between).sum(1) > 0).all())
    assert bool((apart.amax(1) - taken < 1.001e-2 * smallest).all())
    faces, edges = apart[:, :6].amax(1), apart[:, 6:].amax(1)
    by_edge = chosen[:, 6:].amax(1) > chosen[:, :6].amax(1)
    assert bool(torch.equal(by_edge, edges - faces > 1e-2 * smallest))
    assert 0.02 < float(by_edge.double().mean()) < 0.9
    torch.testing.assert_close(patch.gap[by_edge, 0], edges[by_edge], rtol=0, atol=1e-9)
    assert patch.active[by_edge].tolist() == [[True, False, False, False]] * int(by_edge.sum())
    assert_close(patch.scale, 2 * smallest)


def test_each_contact_lies_midway_between_a_point_of_either_surface() -> None:
    first, second = near_pairs(400)
    patch = box_on_box(first, second)
    half_gap = patch.gap[..., None] * patch.frame[:, None, 0] / 2
    by_edge = ~patch.active[:, 1:].any(1, keepdim=True)  # of edges that lie apart, others may be the nearest points
    touching = patch.active & ((patch.gap < 0) | ~by_edge)
    for each, point in ((first, patch.point - half_gap), (second, patch.point + half_gap)):
        local = ((point - each.pose[:, None, :3]) @ to_matrix(each.pose[:, 3:]))[touching]
        half = (each.size / 2)[:, None].expand(-1, 4, -1)[touching]
        beyond = local.abs() - half
        assert float(beyond.amax()) < 1e-6
        assert float(beyond.amax(1).abs().max()) < 1e-6, "on the surface"


def polygon(first: Placed, second: Placed, k: int) -> np.ndarray:
    """Return the corners of where two boxes that stand on each other overlap, seen from above, in axes of the first."""
    turn = (to_matrix(first.pose[k, 3:]).mT @ to_matrix(second.pose[k, 3:]))[:2, :2].numpy()
    middle = (to_matrix(first.pose[k, 3:]).mT @ (second.pose[k, :3] - first.pose[k, :3]))[:2].numpy()
    rows = []
    for axis in range(2):
        for side in (-1.0, 1.0):
            own = side * np.eye(2)[axis]
            rows.append([*own, -float(first.size[k, axis]) / 2])
            other = side * turn[:, axis]
            rows.append([*other, -float(second.size[k, axis]) / 2 - other @ middle])
    inside = np.clip(middle, -first.size[k, :2].numpy() / 2 + 1e-4, first.size[k, :2].numpy() / 2 - 1e-4)
    return HalfspaceIntersection(np.array(rows), (inside + middle) / 2).intersections


@pytest.mark.parametrize("turned", [False, True])
def test_of_two_boxes_that_stand_on_each_other_the_outermost_corners_of_the_overlap_touch(turned: bool) -> None:
    batch = 60
    yaw, lean = uniform(batch, 1, seed=11) * torch.tensor([0, 0, 1.5], dtype=DTYPE), TURNS[1] if turned else TURNS[0]
    base = exponential(lean).expand(batch, 4)
    size = [0.2 + 0.1 * uniform(batch, 3, seed=seed).abs() for seed in (12, 13)]
    aside = 0.08 * uniform(batch, 2, seed=14)
    up = torch.cat([aside, (size[0][:, 2:] + size[1][:, 2:]) / 2 - 1e-3], 1)
    axes = to_matrix(base)
    first = Placed(0, torch.cat([torch.zeros(batch, 3, dtype=DTYPE), base], 1), size[0])
    quaternion = multiply(base, exponential(yaw))
    second = Placed(1, torch.cat([(axes @ up[..., None])[..., 0], quaternion], 1), size[1])
    patch = box_on_box(first, second)
    assert_close(patch.gap, torch.full((batch, 4), -1e-3, dtype=DTYPE), 1e-9)
    assert_close(patch.frame[:, 0], axes[:, :, 2])
    assert bool(patch.active.all())
    local = patch.point @ axes
    for k in range(batch):
        corners, chosen = polygon(first, second, k), local[k, :, :2].numpy()
        apart = np.linalg.norm(chosen[:, None] - corners[None], axis=-1)
        assert apart.min(1).max() < 1e-8, "each is a corner of the overlap"
        half = first.size[k, :2].numpy() / 2
        for signs in itertools.product([-1.0, 1.0], repeat=2):
            towards = np.array(signs) / half
            assert (chosen @ towards).max() > (corners @ towards).max() - 1e-7
        distinct = np.unique(np.round(chosen, 7), axis=0)
        assert len(distinct) == min(4, len(np.unique(np.round(corners, 7), axis=0)))
