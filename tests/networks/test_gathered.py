"""Gathered convolutions are convolutions."""

from __future__ import annotations

import pytest
import torch
from torch import nn

from physid.networks.convolutions import GatheredConv2d, _Gathered
from physid.networks.encoder import CONVOLUTIONS, DEEP

TOLERANCE = {True: 0.02, False: 1e-5}  # of the largest number, in bfloat16, which keeps 8 bits, or single precision
DEEP_ONES = [layer for layer in CONVOLUTIONS if layer[0] >= DEEP]


def pair(channels: int, wider: int, kernel: int, stride: int) -> tuple[nn.Conv2d, nn.Conv2d]:
    torch.manual_seed(0)
    plain = nn.Conv2d(channels, wider, kernel, stride)
    gathered = GatheredConv2d(channels, wider, kernel, stride)
    gathered.load_state_dict(plain.state_dict())
    return plain, gathered


def results(layer: nn.Conv2d, image: torch.Tensor, *, half: bool) -> list[torch.Tensor]:
    image = image.clone().requires_grad_()
    with torch.autocast("cpu", torch.bfloat16, enabled=half):
        output = layer(image)
    output.float().square().sum().backward()
    found = [output.detach(), image.grad, layer.weight.grad, layer.bias.grad]
    return [one.float() for one in found if one is not None]


@pytest.mark.parametrize(("channels", "wider", "kernel", "stride"), DEEP_ONES)
@pytest.mark.parametrize("last", [True, False])
@pytest.mark.parametrize("half", [True, False])
def test_output_and_gradients_are_those_of_the_convolution(
    channels: int, wider: int, kernel: int, stride: int, last: bool, half: bool
) -> None:
    image = torch.randn(3, channels, 13, 11)
    image = image.contiguous(memory_format=torch.channels_last) if last else image
    plain, gathered = (results(layer, image, half=half) for layer in pair(channels, wider, kernel, stride))
    assert len(plain) == len(gathered) == 4
    for one, other in zip(plain, gathered, strict=True):
        assert torch.allclose(one, other, atol=TOLERANCE[half] * float(one.abs().max()))


def test_without_a_gradient_it_is_the_convolution_itself() -> None:
    image = torch.randn(2, 6, 9, 9)
    plain, gathered = pair(6, 4, 3, 2)
    with torch.no_grad():
        assert torch.equal(plain(image), gathered(image))


@pytest.mark.parametrize("stride", [1, 2])
def test_gradients_are_those_of_finite_differences(stride: int) -> None:
    torch.manual_seed(0)
    shapes = ((2, 3, 7, 8), (4, 3, 3, 3), (4,))
    inputs = tuple(torch.randn(shape, dtype=torch.float64, requires_grad=True) for shape in shapes)
    assert torch.autograd.gradcheck(lambda *given: _Gathered.apply(*given, stride), inputs)


def test_an_image_that_needs_no_gradient_gets_none() -> None:
    _, layer = pair(6, 4, 3, 1)
    image = torch.randn(2, 6, 9, 9)
    with torch.autocast("cpu", torch.bfloat16):
        layer(image).float().sum().backward()
    assert image.grad is None
    assert layer.weight.grad is not None
