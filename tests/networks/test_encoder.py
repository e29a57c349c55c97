import time

import pytest
import torch
from torch import nn
from torch.distributions import Normal, kl_divergence

from physid.networks import PinholeCamera, PlanarChart, PoseEncoder, VariationalPoseEncoder, as_image
from physid.networks.encoder import CONTRAST, Layers, features, gaussian_divergence, with_difference

TOLERANCE = 1e-5
MUCH = 2.0
CAMERA = PinholeCamera(128, 128, (0, 0, 3), (0, 0, 0), (0, 1, 0), 40.0)
CHART = PlanarChart(CAMERA, (0, 0, 1), 0.0, [0.2, 0.2])
BACKGROUND = torch.full((1, 3, 128, 128), 0.7)


def images(count: int = 3) -> torch.Tensor:
    """Speckled squares of 20 pixels on the background."""
    frames = BACKGROUND.repeat(count, 1, 1, 1)
    for n, frame in enumerate(frames):
        place = slice(20 + 25 * n, 40 + 25 * n)
        frame[:, place, place] = torch.rand(3, 20, 20, generator=torch.Generator().manual_seed(n))
    return frames


def test_the_layers_are_those_of_the_tables_of_the_paper() -> None:
    encoder = PoseEncoder(CHART)
    convolutions = [m for m in encoder.modules() if isinstance(m, nn.Conv2d)]
    table = [(m.in_channels, m.out_channels, m.kernel_size[0], m.stride[0]) for m in convolutions]
    assert table == [(4, 64, 5, 2), (64, 128, 5, 2), (128, 256, 5, 2), (256, 256, 5, 2), (256, 128, 3, 1)]
    connected = [(m.in_features, m.out_features) for m in encoder.modules() if isinstance(m, nn.Linear)]
    assert sorted(connected, reverse=True) == [(3 * 3 * 128, 50), (50, 50), (50, 2 * CHART.numbers)]
    assert sum(isinstance(m, nn.ELU) for m in encoder.modules()) == 7


def test_the_variational_encoder_has_the_same_base_and_one_layer_from_the_latent_to_the_poses() -> None:
    encoder = VariationalPoseEncoder(CHART, latent=16)
    assert encoder.base.last.out_features == 32
    assert (encoder.head.in_features, encoder.head.out_features) == (16, 2 * CHART.numbers)


@pytest.mark.parametrize("model", [PoseEncoder, VariationalPoseEncoder])
def test_an_untrained_encoder_answers_nearly_the_neutral_pose(model: type[PoseEncoder]) -> None:
    torch.manual_seed(0)
    encoding = model(CHART).eval()(images(), BACKGROUND)
    assert encoding.pose.shape == (3, 2, 7)
    assert (encoding.numbers - CHART.neutral()).abs().max() < 0.5


def test_every_image_is_read_by_itself() -> None:
    encoder = PoseEncoder(CHART, layers=Layers(fast=False))
    together = encoder(images(), BACKGROUND).numbers
    apart = torch.cat([encoder(i[None], BACKGROUND).numbers for i in images()])
    assert torch.allclose(together, apart, atol=TOLERANCE)


def test_convolutions_in_bfloat16_and_mixed_precision_leave_the_poses_in_single_precision() -> None:
    torch.manual_seed(0)
    fast, exact = PoseEncoder(CHART, layers=Layers(fast=True)), PoseEncoder(CHART, layers=Layers(fast=False))
    exact.load_state_dict(fast.state_dict())
    expected = exact(images(), BACKGROUND)
    assert torch.allclose(fast(images(), BACKGROUND).numbers, expected.numbers, atol=5e-3)
    with torch.autocast("cpu", torch.bfloat16):
        mixed = fast(images(), BACKGROUND)
    assert mixed.numbers.dtype == mixed.pose.dtype == torch.float32
    assert torch.equal(mixed.pose, fast(images(), BACKGROUND).pose)


def seconds(fast: bool | None) -> float:
    """Return what the faster of two passes through an encoder takes, forward and backward."""
    encoder = PoseEncoder(CHART, layers=Layers(fast=fast))
    spent = []
    for _ in range(2):
        begin = time.process_time()
        encoder(images(), BACKGROUND).numbers.sum().backward()
        spent.append(time.process_time() - begin)
    return min(spent)


def test_left_alone_the_encoder_is_not_much_slower_than_in_the_better_precision() -> None:
    assert seconds(None) < MUCH * min(seconds(True), seconds(False))


def test_the_channels_are_the_colours_counted_from_the_background_and_their_mean_size() -> None:
    stacked = with_difference(images(), BACKGROUND)
    assert torch.allclose(stacked[:, :3], CONTRAST * (images() - 0.7), atol=TOLERANCE)
    assert torch.allclose(stacked[:, 3], CONTRAST * (images() - 0.7).abs().mean(1), atol=TOLERANCE)
    assert with_difference(BACKGROUND, BACKGROUND).abs().max() == 0


class Standstill(nn.Module):
    """Reads mean 0 and log-variance -2 from any image."""

    def forward(self, image: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        count = len(image)
        return torch.tensor([0.0] * 4 + [-2.0] * 4).expand(count, -1), torch.zeros(count, 256), torch.zeros(count, 128)


def test_samples_scatter_with_the_latent_variance_and_vanish_in_evaluation() -> None:
    torch.manual_seed(0)
    encoder = VariationalPoseEncoder(CHART, latent=4)
    encoder.base = Standstill()
    tiny = torch.zeros(4000, 3, 2, 2)
    with torch.no_grad():
        numbers = encoder(tiny, tiny[:1]).numbers.flatten(1)
        expected = encoder.head.weight @ encoder.head.weight.T * torch.exp(torch.tensor(-2.0))
        assert torch.allclose(numbers.T.cov(), expected, atol=0.1 * float(expected.max()))
        encoder.eval()
        assert encoder(tiny, tiny[:1]).numbers.std(0).max() < TOLERANCE


def test_the_divergence_is_that_of_normal_distributions() -> None:
    mean, log_variance = torch.randn(2, 5, 6, generator=torch.Generator().manual_seed(1))
    expected = kl_divergence(Normal(mean, (log_variance / 2).exp()), Normal(0.0, 1.0)).sum(-1)
    assert torch.allclose(gaussian_divergence(mean, log_variance), expected, atol=TOLERANCE)


def test_gradients_reach_every_weight() -> None:
    encoder = VariationalPoseEncoder(CHART)
    encoding = encoder(images(), BACKGROUND)
    (encoding.pose.square().sum() + encoding.pose.sum() + encoding.divergence.sum()).backward()
    assert all(p.grad is not None and p.grad.abs().sum() > 0 for p in encoder.parameters())


def test_stored_frames_become_images_between_zero_and_one() -> None:
    frames = torch.tensor([0, 51, 255], dtype=torch.uint8).expand(2, 4, 5, 3)
    image = as_image(frames)
    assert image.shape == (2, 3, 4, 5)
    assert torch.allclose(image[0, :, 0, 0], torch.tensor([0.0, 0.2, 1.0]))


def test_frames_of_the_wrong_kind_or_size_are_refused() -> None:
    with pytest.raises(ValueError, match="uint8 of shape"):
        as_image(torch.zeros(2, 3, 4, 4))
    with pytest.raises(ValueError, match="same size"):
        with_difference(images(), torch.zeros(1, 3, 64, 64))
    with pytest.raises(ValueError, match="at least 93 x 93"):
        PoseEncoder(CHART, 92, 128)
    assert features(128, 128) == 1152
    assert features(93, 93) == 128


def test_features_are_summed_over_the_image_and_do_not_tell_where_a_body_is() -> None:
    torch.manual_seed(0)
    encoder, patch = PoseEncoder(CHART, layers=Layers(fast=False)), torch.rand(3, 20, 20)
    frames = BACKGROUND.repeat(2, 1, 1, 1)
    for frame, place in zip(frames, (40, 56), strict=True):  # moved by two strides of the third convolution
        frame[:, place : place + 20, place : place + 20] = patch
    encoding = encoder(frames, BACKGROUND)
    assert encoding.early.shape == (2, 256)
    assert encoding.late.shape == (2, 128)
    assert torch.allclose(encoding.early[0], encoding.early[1], rtol=1e-3, atol=1e-3)


def test_half_of_the_first_connected_units_start_blind_to_places() -> None:
    layers = [m for m in PoseEncoder(CHART).modules() if isinstance(m, nn.Linear) and m.in_features == 3 * 3 * 128]
    spread = layers[0].weight.view(50, 128, 9).std(-1).amax(-1)
    assert (spread[:25] < TOLERANCE).all()
    assert (spread[25:] > 0.01).all()
