import itertools
import math

import pytest
import torch
from torch.nn import functional

from physid.networks import BlurSchedule, GaussianBlur
from physid.networks.blur import Blur, blur_matrix

TOLERANCE = 1e-12


def image(height: int = 40, width: int = 48) -> torch.Tensor:
    return torch.rand(2, 3, height, width, dtype=torch.float64, generator=torch.Generator().manual_seed(0))


@pytest.mark.parametrize("border", ["replicate", "reflect"])
@pytest.mark.parametrize(("kernel", "sigma"), [(1, 1.0), (5, 2.0), (6, 2.0), (128, 128.0), (301, 90.0)])
def test_an_image_of_one_colour_stays_as_it_is_for_any_kernel(border: str, kernel: int, sigma: float) -> None:
    flat = torch.full((1, 3, 128, 128), 0.7, dtype=torch.float64)
    assert torch.allclose(GaussianBlur(kernel, sigma, border)(flat), flat, atol=TOLERANCE)  # type: ignore[arg-type]


@pytest.mark.parametrize(("border", "padding"), [("replicate", "replicate"), ("reflect", "symmetric")])
@pytest.mark.parametrize("kernel", [3, 5, 9])
def test_it_equals_a_two_dimensional_convolution_with_a_gaussian(border: str, padding: str, kernel: int) -> None:
    reach, sigma = kernel // 2, 1.7
    offset = torch.arange(-reach, reach + 1, dtype=torch.float64)
    window = torch.exp(-(offset[:, None] ** 2 + offset**2) / (2 * sigma**2))
    window = (window / window.sum()).expand(3, 1, -1, -1)
    if padding == "replicate":
        padded = functional.pad(image(), [reach] * 4, mode="replicate")
    else:  # mirrored about the edges of the image, not about its outermost pixels
        rows = torch.cat([image()[..., :reach, :].flip(-2), image(), image()[..., -reach:, :].flip(-2)], -2)
        padded = torch.cat([rows[..., :reach].flip(-1), rows, rows[..., -reach:].flip(-1)], -1)
    expected = functional.conv2d(padded, window, groups=3)
    assert torch.allclose(GaussianBlur(kernel, sigma, border)(image()), expected, atol=TOLERANCE)  # type: ignore[arg-type]


@pytest.mark.parametrize("kernel", [5, 64, 200])
def test_reflection_keeps_the_mean_colour(kernel: int) -> None:
    blurred = GaussianBlur(kernel, 30.0, "reflect")(image())
    assert torch.allclose(blurred.mean((-2, -1)), image().mean((-2, -1)), atol=TOLERANCE)


@pytest.mark.parametrize("kernel", [5, 6])
def test_a_point_spreads_symmetrically(kernel: int) -> None:
    row = blur_matrix(31, kernel, 2.0)[15]
    assert torch.allclose(row, row.flip(0), atol=TOLERANCE)


def test_variances_add_up_when_images_are_smoothed_twice() -> None:
    twice = blur_matrix(200, 61, 3.0) @ blur_matrix(200, 61, 4.0)
    once = blur_matrix(200, 81, 5.0)
    assert torch.allclose(twice[80:120], once[80:120], atol=1e-6)


def test_settings_can_be_changed_while_training() -> None:
    blur = GaussianBlur(128, 128.0)
    blur(image())
    blur.set(5, 2.0)
    assert torch.equal(blur(image()), GaussianBlur(5, 2.0)(image()))


@pytest.mark.parametrize("shape", ["geometric", "linear", "cosine"])
def test_a_schedule_falls_from_the_first_to_the_last_blur_of_the_paper(shape: str) -> None:
    schedule = BlurSchedule(shape=shape)  # type: ignore[arg-type]
    steps = [schedule(k / 50) for k in range(51)]
    assert steps[0] == Blur(128, 128.0)
    assert steps[-1] == (5, pytest.approx(2.0))
    assert all(a.kernel >= b.kernel and a.sigma > b.sigma for a, b in itertools.pairwise(steps))
    assert schedule(2.0) == schedule(1.0)


def test_halfway_a_schedule_has_the_geometric_or_the_arithmetic_mean() -> None:
    assert BlurSchedule()(0.5) == (round(math.sqrt(128 * 5)), pytest.approx(math.sqrt(128 * 2)))
    assert BlurSchedule(shape="linear")(0.5).sigma == pytest.approx(65)
    assert BlurSchedule(shape="cosine")(0.5).sigma == pytest.approx(65)


@pytest.mark.parametrize(("kernel", "sigma"), [(0, 1.0), (5, 0.0), (5, math.nan), (5, math.inf)])
def test_an_impossible_blur_is_refused(kernel: int, sigma: float) -> None:
    with pytest.raises(ValueError, match="must be"):
        GaussianBlur(kernel, sigma)


def test_an_unknown_border_or_schedule_is_refused() -> None:
    with pytest.raises(ValueError, match="border must be"):
        GaussianBlur(5, 2.0, "wrap")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="geometric, linear or cosine"):
        BlurSchedule(shape="step")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="positive"):
        BlurSchedule(end=(5, 0.0))
