"""The encoder of the paper: frames in, poses out."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Literal, final

import torch
from torch import Tensor, nn

from physid.networks.chart import PoseChart
from physid.networks.convolutions import GatheredConv2d, convolve_focused
from physid.networks.precision import has_bfloat16

CONVOLUTIONS = ((4, 64, 5, 2), (64, 128, 5, 2), (128, 256, 5, 2), (256, 256, 5, 2), (256, 128, 3, 1))
HIDDEN = 50
CONTRAST = 8.0
"""Scale of the input: an object differs from its background by about 1 / CONTRAST of the range of colours, or more."""
DEEP = 128
"""Channels from which on a convolution is faster as a product of matrices."""
EARLY = 3
"""Convolutions that need not look at the empty background (see `convolve_focused`); the third sees 29 x 29 px."""
INITIAL_SPREAD = 0.05
"""Factor on the weights of the last layer: how far the poses of an untrained network stray from the neutral one."""


def as_image(frames: Tensor) -> Tensor:
    """Turn stored frames, uint8 of shape (..., H, W, 3), into images in [0, 1] of shape (..., 3, H, W).

    Raises:
        ValueError: If the frames are of another type or shape.
    """
    if frames.dtype != torch.uint8 or frames.ndim < 3 or frames.shape[-1] != 3:
        raise ValueError(f"frames must be uint8 of shape (..., H, W, 3), got {frames.dtype} {tuple(frames.shape)}")
    return frames.movedim(-1, -3).float() / 255


def with_difference(image: Tensor, background: Tensor, *, raw: bool = False) -> Tensor:
    """Stack the encoder's four channels: red, green and blue counted from the known background, and their mean size.

    Both are scaled by CONTRAST to the order of 1 on an object. Counted from black, the colours of the empty scene,
    98 % of the pixels, hide the object: the encoder then learns nothing for tens of thousands of images.

    Args:
        image: Images in [0, 1], shape (B, 3, H, W).
        background: The empty scene in [0, 1], shape (B or 1, 3, H, W).
        raw: Whether the three colours are counted from black after all, beside the difference.

    Returns:
        Shape (B, 4, H, W).

    Raises:
        ValueError: If image and background differ in size.
    """
    if image.shape[-3:] != background.shape[-3:] or image.shape[-3] != 3:
        raise ValueError(
            f"image and background must have 3 colours and the same size, got {tuple(image.shape)} and "
            f"{tuple(background.shape)}"
        )
    colour = CONTRAST * (image - background)
    return torch.cat([image if raw else colour, colour.abs().mean(-3, keepdim=True)], -3)


def features(height: int, width: int) -> int:
    """Count what the convolutions leave of an image, 3 x 3 x 128 = 1152 of one of 128 x 128 pixels.

    Raises:
        ValueError: If nothing is left.
    """
    lengths = [height, width]
    for _, _, kernel, stride in CONVOLUTIONS:
        lengths = [(length - kernel) // stride + 1 for length in lengths]
        if min(lengths) < 1:
            raise ValueError(f"frames of {height} x {width} px are too small for the encoder; use at least 93 x 93 px")
    return math.prod(lengths) * CONVOLUTIONS[-1][1]


@dataclass(frozen=True)
class Layers:
    """How the layers of an encoder begin and compute.

    Attributes:
        initial_weights: scaled (see `_Base`), or torch's own.
        raw_colours: Whether the three colours are counted from black, not from the background.
        fast: Whether the convolutions compute in bfloat16; None where the device has units for it (`has_bfloat16`).
    """

    initial_weights: Literal["scaled", "torch"] = "scaled"
    raw_colours: bool = False
    fast: bool | None = None

    def __post_init__(self) -> None:
        if self.initial_weights not in ("scaled", "torch"):
            raise ValueError(f"layers.initial_weights must be scaled or torch, got {self.initial_weights!r}")


def build_convolutions(first: int, last: int) -> nn.Sequential:
    """Build some of the paper's convolutions (its tables S.1 and S.2), ELU after each."""
    layers: list[nn.Module] = []
    for channels, wider, kernel, stride in CONVOLUTIONS[first:last]:
        kind = GatheredConv2d if channels >= DEEP else nn.Conv2d
        layers += [kind(channels, wider, kernel, stride), nn.ELU()]
    return nn.Sequential(*layers)


@torch.no_grad()
def scale_weights(network: nn.Module) -> None:
    """Draw weights as He et al. (2015) say, so that the signal of a small object does not fade on its way."""
    for module in network.modules():
        if isinstance(module, nn.Conv2d | nn.Linear):
            nn.init.kaiming_normal_(module.weight)
            if module.bias is not None:
                nn.init.zeros_(module.bias)


def in_fast_precision(device: str, fast: bool | None) -> torch.autocast:
    """Compute in bfloat16 within, if asked for; None where the device has units for it (see `has_bfloat16`)."""
    return torch.autocast(device, torch.bfloat16, enabled=has_bfloat16(device) if fast is None else fast)


@final
class _Base(nn.Module):
    """The paper's layers (its tables S.1 and S.2), from four channels to the latent numbers, ELU between them.

    The convolutions, nearly all of the work, may run in bfloat16; the connected layers do not, since an output in
    bfloat16 would resolve no more than a quarter of a pixel. Scaled weights start as `scale_weights` says, and half of
    the first connected units with equal weights at all places: how a body is turned does not depend on where it is.
    """

    def __init__(self, height: int, width: int, latent: int, layers: Layers) -> None:
        super().__init__()
        self.convolutions = nn.Sequential(*build_convolutions(0, len(CONVOLUTIONS)), nn.Flatten())
        wide, self.last = features(height, width), nn.Linear(HIDDEN, latent)
        first = nn.Linear(wide, HIDDEN)
        self.connected = nn.Sequential(first, nn.ELU(), nn.Linear(HIDDEN, HIDDEN), nn.ELU())
        self.fast = layers.fast
        if layers.initial_weights == "scaled":
            scale_weights(self)
            with torch.no_grad():
                placed = first.weight.view(HIDDEN, CONVOLUTIONS[-1][1], -1)
                placed[: HIDDEN // 2] = placed[: HIDDEN // 2].mean(-1, keepdim=True)
        self.convolutions.to(memory_format=torch.channels_last)  # type: ignore[call-overload]

    def forward(self, image: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Turn images (B, 4, H, W) into latent numbers (B, latent); the fourth channel is 0 where all others are.

        Returns:
            The latent numbers, and `Encoding.early` and `Encoding.late`.
        """
        device = image.device.type
        occupied = image[:, -1] != 0
        with in_fast_precision(device, self.fast):
            layers = list(self.convolutions)
            early, late = nn.Sequential(*layers[: 2 * EARLY]), nn.Sequential(*layers[2 * EARLY :])
            detail = convolve_focused(early, image, occupied)
            seen = late(detail)
        with torch.autocast(device, enabled=False):
            seen = seen.to(self.last.weight.dtype)
            latent: Tensor = self.last(self.connected(seen))
            return latent, detail.float().sum((-2, -1)), seen.unflatten(1, (CONVOLUTIONS[-1][1], -1)).sum(-1)


def _start_in_the_middle(layer: nn.Linear, chart: PoseChart) -> None:
    """Let an untrained network answer nearly the neutral pose, so that no angle starts at its singular point."""
    with torch.no_grad():
        layer.weight.mul_(INITIAL_SPREAD)
        layer.bias.copy_(chart.neutral().repeat(chart.bodies))


@dataclass(frozen=True)
class Encoding:
    """What an encoder reads from a batch of images.

    Attributes:
        pose: Position [m] and unit quaternion, shape (B, N, 7).
        numbers: The raw numbers that the chart maps to the poses, shape (B, N, K).
        divergence: KL divergence of the latent distribution from the standard normal one [nat], shape (B,); 0 of an
            encoder without one.
        early: What the third convolution sees, wherever it is: its channels, summed over the image; shape (B, 256).
        late: The same of the last convolution, shape (B, 128).
    """

    pose: Tensor
    numbers: Tensor
    divergence: Tensor
    early: Tensor
    late: Tensor


class Encoder(nn.Module, ABC):
    """Reads the poses of all bodies from single images.

    Args:
        chart: What the outputs mean.
        layers: How the layers begin and compute.
    """

    variational = False

    def __init__(self, chart: PoseChart, layers: Layers) -> None:
        super().__init__()
        self.chart, self.raw_colours = chart, layers.raw_colours

    def forward(self, image: Tensor, background: Tensor) -> Encoding:
        """Encode images (B, 3, H, W) in [0, 1], given the empty scene (B or 1, 3, H, W)."""
        given = with_difference(image, background, raw=self.raw_colours).contiguous(memory_format=torch.channels_last)
        flat, divergence, early, late = self.read(given)
        numbers = flat.unflatten(-1, (self.chart.bodies, self.chart.numbers))
        return Encoding(self.chart.to_pose(numbers), numbers, divergence, early, late)

    @abstractmethod
    def read(self, image: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Read the raw numbers (B, N K), their divergence (B,), and `Encoding.early` and `.late` from (B, 4, H, W)."""


@final
class PoseEncoder(Encoder):
    """Reads poses straight from the last layer, as the paper does with supervision.

    Args:
        chart: What the outputs mean.
        height: Image height [px].
        width: Image width [px].
        layers: How the layers begin and compute.
    """

    def __init__(self, chart: PoseChart, height: int = 128, width: int = 128, layers: Layers = Layers()) -> None:
        super().__init__(chart, layers)
        self.base = _Base(height, width, chart.bodies * chart.numbers, layers)
        _start_in_the_middle(self.base.last, chart)

    def read(self, image: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Take the output as it is; it has no distribution."""
        output, early, late = self.base(image)
        return output, output.new_zeros(len(output)), early, late


@final
class VariationalPoseEncoder(Encoder):
    """Reads a latent distribution from single images and the poses from a sample of it, by a fully connected layer.

    In training z = mean + exp(log_variance / 2) noise (the reparameterisation of Kingma & Welling 2014), otherwise
    z = mean. Arguments as of `PoseEncoder`; `latent` is the length of z.
    """

    variational = True

    def __init__(
        self, chart: PoseChart, height: int = 128, width: int = 128, layers: Layers = Layers(), *, latent: int = 16
    ) -> None:
        super().__init__(chart, layers)
        self.base = _Base(height, width, 2 * latent, layers)
        self.head = nn.Linear(latent, chart.bodies * chart.numbers)
        _start_in_the_middle(self.head, chart)

    def read(self, image: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Draw from the distribution, or take its mean."""
        output, early, late = self.base(image)
        mean, log_variance = output.chunk(2, -1)
        latent = mean + torch.exp(log_variance / 2) * torch.randn_like(mean) if self.training else mean
        with torch.autocast(output.device.type, enabled=False):
            return self.head(latent), gaussian_divergence(mean, log_variance), early, late


def gaussian_divergence(mean: Tensor, log_variance: Tensor) -> Tensor:
    """Compute KL(N(m, s^2) || N(0, 1)) = (m^2 + s^2 - 1 - ln s^2) / 2 summed over the last axis [nat]."""
    return (mean.square() + log_variance.exp() - 1 - log_variance).sum(-1) / 2
