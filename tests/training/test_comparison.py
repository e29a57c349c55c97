"""Drawn images compared with those seen, and the unit of that: what the empty scenes leave."""

from __future__ import annotations

import torch

from physid.networks import GaussianBlur
from physid.training.vision.drawing.comparison import left_undrawn, mismatch


def test_squares_relative_to_the_empty_scene_are_one_where_nothing_is_drawn_whatever_the_blur() -> None:
    generator = torch.Generator().manual_seed(0)
    image, background = torch.rand(2, 3, 3, 16, 16, generator=generator), torch.rand(2, 3, 16, 16, generator=generator)
    nothing, real = background[:, None].expand_as(image), torch.ones(2, 3, dtype=torch.bool)
    blur, left = GaussianBlur(), []
    for kernel, sigma in ((1, 0.4), (5, 2.0)):
        blur.set(kernel, sigma)
        left.append(left_undrawn(blur, blur(image), background, real))
        torch.testing.assert_close(mismatch(blur, nothing, blur(image), real).mean(), left[-1])
    assert left[1] < left[0] / 2


def test_images_that_are_not_real_do_not_count() -> None:
    seen, blur = torch.zeros(1, 2, 3, 8, 8), GaussianBlur()
    drawn = torch.stack([torch.full((3, 8, 8), 0.5), torch.full((3, 8, 8), torch.pi)])[None]
    one = torch.tensor([[True, False]])
    torch.testing.assert_close(mismatch(blur, drawn, seen, one), torch.tensor([0.25]))
    torch.testing.assert_close(left_undrawn(blur, drawn, seen[:, 0], one), torch.tensor(0.25))
