import pytest
import torch
from torch import nn

from physid.networks.convolutions import convolve_focused, field_of

TOLERANCE = 1e-5
LAYERS = nn.Sequential(
    nn.Conv2d(4, 6, 5, 2), nn.ELU(), nn.Conv2d(6, 8, 5, 2), nn.ELU(), nn.Conv2d(8, 8, 3, 1), nn.ELU()
)


def test_the_receptive_field_follows_from_kernels_and_strides() -> None:
    assert field_of(list(LAYERS)) == (21, 4)


@pytest.mark.parametrize("place", [(0, 0), (20, 37), (52, 52)])
def test_empty_surroundings_do_not_change_the_result_nor_its_gradient(place: tuple[int, int]) -> None:
    torch.manual_seed(0)
    image = torch.zeros(2, 4, 64, 64)
    image[0, :, place[0] : place[0] + 12, place[1] : place[1] + 12] = torch.randn(4, 12, 12)
    image[1, :, 30:35, 30:40] = 1.0
    results = []
    for convolve in (LAYERS, lambda x: convolve_focused(LAYERS, x, (x != 0).any(1))):
        LAYERS.zero_grad()
        output = convolve(image)
        output.square().sum().backward()
        results.append([output.detach(), *(parameter.grad.clone() for parameter in LAYERS.parameters())])
    for whole, focused in zip(*results, strict=True):
        assert torch.allclose(whole, focused, atol=TOLERANCE * float(whole.abs().max()))
