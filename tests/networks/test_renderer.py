import math

import pytest
import torch
from scipy.spatial import ConvexHull

from physid.networks import PinholeCamera
from physid.networks.appearance import Appearance, pixel_rows
from physid.networks.faces import corners, coverage, visible_faces
from physid.networks.renderer import BoxRenderer
from physid.physics.rotations import exponential

TOLERANCE = 1e-5
TOP_DOWN = PinholeCamera(96, 96, (0, 0, 3), (0, 0, 0), (0, 1, 0), 40.0)
OBLIQUE = PinholeCamera(96, 80, (0.3, -2, 2), (0, 0, 0), (0, 0, 1), 30.0)
SIZE = torch.tensor([[0.25, 0.3, 0.2], [0.2, 0.2, 0.2]])


def scene(batch: int = 3, frames: int = 4, *, seed: int = 0) -> tuple[torch.Tensor, Appearance, torch.Tensor]:
    generator = torch.Generator().manual_seed(seed)
    position = 0.8 * torch.rand(batch, frames, 2, 3, generator=generator) - 0.4
    turn = exponential(4 * torch.rand(batch, frames, 2, 3, generator=generator) - 2)
    patches = torch.rand(batch, 2, 6, 3, 8, 8, generator=generator)
    background = torch.rand(batch, 3, 80, 96, generator=generator)
    return torch.cat([position, turn], -1), Appearance(patches), background


def flat(*colours: tuple[float, float, float]) -> Appearance:
    return Appearance(torch.tensor(colours)[None, :, None, :, None, None].expand(-1, -1, 6, -1, 4, 4).clone())


def at(*positions: tuple[float, float, float]) -> torch.Tensor:
    turn = torch.tensor([0.0, 0.0, 0.0, 1.0]).expand(len(positions), 4)
    return torch.cat([torch.tensor(positions), turn], -1)[None, None]


def test_every_frame_is_drawn_by_itself() -> None:
    pose, appearance, background = scene()
    pose, appearance, background = pose.double(), Appearance(appearance.patches.double()), background.double()
    renderer = BoxRenderer(OBLIQUE, SIZE).double()
    together = renderer(pose, appearance, background)
    for b in range(3):
        for t in range(4):
            alone = renderer(
                pose[b : b + 1, t : t + 1], Appearance(appearance.patches[b : b + 1]), background[b : b + 1]
            )
            assert torch.allclose(together[b, t], alone[0, 0], atol=TOLERANCE)


def test_one_appearance_may_serve_all_scenes() -> None:
    pose, appearance, background = scene()
    one = Appearance(appearance.patches[:1])
    repeated = Appearance(one.patches.expand(3, -1, -1, -1, -1, -1))
    renderer = BoxRenderer(OBLIQUE, SIZE)
    assert torch.equal(renderer(pose, one, background), renderer(pose, repeated, background))


def test_mixed_precision_does_not_round_a_drawing() -> None:
    pose, appearance, background = scene()
    renderer = BoxRenderer(OBLIQUE, SIZE)
    with torch.autocast("cpu", torch.bfloat16):
        mixed = renderer(pose, appearance, background)
    assert torch.equal(mixed, renderer(pose, appearance, background))


def test_colours_are_mixtures_of_those_given() -> None:
    pose, appearance, background = scene()
    image = BoxRenderer(OBLIQUE, SIZE)(pose, appearance, background)
    assert image.min() >= 0
    assert image.max() <= 1


@pytest.mark.parametrize("seed", range(3))
def test_a_silhouette_covers_the_area_of_the_projected_box(seed: int) -> None:
    pose, _, _ = scene(seed=seed)
    covered = BoxRenderer(OBLIQUE, SIZE).silhouettes(pose).sum((-2, -1))
    outlines = OBLIQUE.project(corners(pose, SIZE)).flatten(0, 2)
    areas = torch.tensor([ConvexHull(o.numpy()).volume for o in outlines]).view_as(covered)
    assert ((covered - areas).abs() / areas).max() < 0.01


@pytest.mark.parametrize("seed", range(3))
def test_the_gradient_of_an_image_is_that_of_finite_differences(seed: int) -> None:
    pose, appearance, background = scene(1, 2, seed=seed)
    renderer = BoxRenderer(OBLIQUE, SIZE).double()
    pose, background = pose.double(), background.double()
    patches = appearance.patches.double()
    weight = torch.rand(1, 2, 3, 80, 96, dtype=torch.float64, generator=torch.Generator().manual_seed(1))

    def loss(pose: torch.Tensor) -> torch.Tensor:
        return (weight * renderer(pose, Appearance(patches), background)).sum()

    (gradient,) = torch.autograd.grad(loss(pose.requires_grad_()), pose)
    step = 1e-7
    with torch.no_grad():
        for index in torch.cartesian_prod(*(torch.arange(n) for n in pose.shape)):
            moved = torch.zeros_like(pose)
            moved[tuple(index)] = step
            numeric = (loss(pose + moved) - loss(pose - moved)) / (2 * step)
            assert float(gradient[tuple(index)]) == pytest.approx(float(numeric), rel=2e-3, abs=2e-3)


def test_a_box_that_moves_by_a_pixel_moves_its_drawing_by_a_pixel() -> None:
    top = 3 - 0.1
    pixel = 2 * top * math.tan(math.radians(20)) / 96
    pose = at((0.2, 0.1, 0.0), (0.2 + 3 * pixel, 0.1 - 2 * pixel, 0.0))
    sheet = BoxRenderer(TOP_DOWN, torch.tensor([[0.2, 0.2, 1e-4]] * 2))
    first, second = sheet.silhouettes(pose + torch.tensor([0, 0, 0.1, 0, 0, 0, 0]))[0, 0]
    assert torch.allclose(first.roll((2, 3), (0, 1)), second, atol=1e-3)


def test_the_nearer_box_hides_the_farther_one_whatever_their_order() -> None:
    black = torch.zeros(1, 3, 96, 96)
    red, blue = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
    renderer = BoxRenderer(TOP_DOWN, SIZE)
    low_high = renderer(at((0, 0, 0.1), (0, 0, 0.6)), flat(red, blue), black)[0, 0, :, 48, 48]
    high_low = renderer(at((0, 0, 0.6), (0, 0, 0.1)), flat(red, blue), black)[0, 0, :, 48, 48]
    assert torch.allclose(low_high, torch.tensor(blue), atol=TOLERANCE)
    assert torch.allclose(high_low, torch.tensor(red), atol=TOLERANCE)


def test_no_background_shines_through_between_the_faces_of_a_box() -> None:
    turn = exponential(torch.tensor([0.0, math.atan(2**-0.5), 0.0]))
    pose = torch.cat([torch.zeros(3), turn])[None, None, None]
    renderer = BoxRenderer(OBLIQUE, torch.tensor([[0.4, 0.4, 0.4]]))
    image = renderer(pose, flat((1.0, 1.0, 1.0)), torch.zeros(1, 3, 80, 96))[0, 0]
    inside = renderer.silhouettes(pose)[0, 0, 0] == 1
    assert inside.sum() > 500
    assert image[:, inside].min() > 1 - 1e-5


def test_a_face_appears_smoothly_as_it_turns_into_view() -> None:
    angles = torch.linspace(-0.02, 0.02, 81)
    turn = exponential(torch.stack([0 * angles, angles, 0 * angles], -1))
    pose = torch.cat([torch.tensor([0.0, 0.0, 0.0]).expand(81, 3), turn], -1)[None, :, None]
    image = BoxRenderer(TOP_DOWN, SIZE[:1])(pose, Appearance(scene(1)[1].patches[:, :1]), torch.zeros(1, 3, 96, 96))
    assert (image[0, 1:] - image[0, :-1]).abs().max() < 0.02


def test_a_face_seen_edge_on_has_a_finite_slope_even_where_a_pixel_lies_on_its_horizon() -> None:
    """In one of twenty a pixel centre lies on the plane of a side face, whose texture is looked up at 0 / 0 there."""
    generator = torch.Generator().manual_seed(0)
    straight_down = PinholeCamera(65, 65, (0, 0, 1), (0, 0, 0), (0, 1, 0), 60.0)
    across, along, yaw = torch.rand(3, 400, generator=generator).unbind()
    beside, ahead, yaw = 0.1 + 0.001 * across, 0.3 * (along - 0.5), 2 * math.pi * yaw
    place = [beside * yaw.cos() - ahead * yaw.sin(), beside * yaw.sin() + ahead * yaw.cos(), 0.1 + 0 * yaw]
    turn = [0 * yaw, 0 * yaw, (yaw / 2).sin(), (yaw / 2).cos()]
    pose = torch.stack(place + turn, -1)[None, :, None].requires_grad_()
    patches = torch.rand(1, 1, 6, 3, 8, 8, generator=generator)
    image = BoxRenderer(straight_down, torch.full((1, 3), 0.2))(pose, Appearance(patches), torch.zeros(1, 3, 65, 65))
    (slope,) = torch.autograd.grad(image.square().sum(), pose)
    assert image.isfinite().all()
    assert slope.isfinite().all()


@pytest.mark.parametrize("place", [(9.0, 0.0, 0.1), (0.0, -9.0, 0.1), (0.0, 0.0, 3.0), (0.0, 0.0, 9.0)])
def test_a_box_out_of_view_or_behind_the_camera_leaves_the_background(place: tuple[float, float, float]) -> None:
    background = torch.rand(1, 3, 96, 96)
    pose = at(place).requires_grad_()
    image = BoxRenderer(TOP_DOWN, SIZE[:1])(pose, flat((1.0, 0.0, 0.0)), background)
    assert torch.equal(image[0, 0], background[0])
    image.sum().backward()
    assert torch.isfinite(pose.grad).all()


def test_a_box_half_out_of_view_is_drawn_where_it_is() -> None:
    pose = at((-1.05, 0.3, 0.0))
    image = BoxRenderer(TOP_DOWN, SIZE[:1])(pose, flat((1.0, 1.0, 1.0)), torch.zeros(1, 3, 96, 96))
    covered = BoxRenderer(TOP_DOWN, SIZE[:1]).silhouettes(pose)[0, 0, 0]
    assert 0 < covered[:, 0].sum() < covered.sum()
    assert torch.allclose(image[0, 0, 0], covered, atol=1e-4)


def test_shapes_that_do_not_fit_are_refused() -> None:
    pose, appearance, background = scene()
    with pytest.raises(ValueError, match="pose must have shape"):
        BoxRenderer(OBLIQUE, SIZE)(pose[:, :, :1], appearance, background)
    with pytest.raises(ValueError, match="background must have shape"):
        BoxRenderer(OBLIQUE, SIZE)(pose, appearance, background[..., :-1])


@pytest.mark.parametrize("corner", [(0, 0), (30, 21), (56, 40)])
def test_a_part_of_the_view_is_drawn_as_in_the_whole(corner: tuple[int, int]) -> None:
    """Also where boxes lie across its border, or beside it."""
    pose, appearance, background = scene()
    pose, appearance, background = pose.double(), Appearance(appearance.patches.double()), background.double()
    renderer = BoxRenderer(OBLIQUE, SIZE).double()
    column, row = corner
    part = (slice(row, row + 40), slice(column, column + 40))
    drawn = renderer(pose, appearance, background[:, :, *part], corner=torch.tensor(corner).expand(3, 2))
    whole = renderer(pose, appearance, background)[..., *part]
    assert float((drawn - whole).abs().max()) < TOLERANCE
    assert float((whole - background[:, None, :, *part]).abs().amax((0, 1, 2)).gt(0).float().mean()) > 0.2, "boxes"


def test_a_part_beyond_the_view_is_refused() -> None:
    pose, appearance, background = scene()
    for corner in ((-1, 0), (57, 0), (0, 41)):
        with pytest.raises(ValueError, match="expected parts within the view of 96 x 80 pixels"):
            BoxRenderer(OBLIQUE, SIZE)(
                pose, appearance, background[..., :40, :40], corner=torch.tensor(corner).expand(3, 2)
            )


def test_hard_edges_leave_pixels_covered_or_not_and_the_same_area() -> None:
    camera = PinholeCamera(64, 64, (0, 0, 3), (0, 0, 0), (0, 1, 0), 40.0)
    half = math.pi / 12
    pose = torch.tensor([0.1, 0.05, 0.0, 0.0, 0.0, math.sin(half), math.cos(half)])
    faces = visible_faces(camera, pose, torch.tensor([0.8, 0.5, 0.1]))
    pixels = pixel_rows(64, 64, pose)
    (_, soft), (_, hard) = (coverage(faces, pixels, edge) for edge in (1.0, 1e-4))
    assert ((hard < 1e-3) | (hard > 1 - 1e-3)).float().mean() > 0.99
    assert float(hard.sum()) == pytest.approx(float(soft.sum()), rel=0.02)
