"""Gaussian smoothing of images, and the curriculum that takes it away."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

import torch
from torch import Tensor, nn

Border = Literal["replicate", "reflect"]


def blur_matrix(length: int, kernel: int, sigma: float, border: Border = "replicate") -> Tensor:
    """Build the matrix that smooths a row of pixels, g(d) ~ exp(-d^2 / (2 sigma^2)) for |d| <= kernel / 2.

    The window is `kernel` pixels wide and symmetric for even widths too: there the two outermost taps count half.
    Taps beyond the border fall on the last pixel ("replicate") or are folded back in ("reflect", which keeps the
    mean), as often as needed, so that a kernel may exceed the image.

    Args:
        length: Number of pixels [px].
        kernel: Width of the window [px].
        sigma: Standard deviation [px].
        border: What lies outside the image.

    Returns:
        Weights, each row adding up to 1; shape (length, length), float64.
    """
    reach = kernel // 2
    offset = torch.arange(-reach, reach + 1, dtype=torch.float64)
    weight = torch.exp(-((offset / sigma) ** 2) / 2)
    if kernel % 2 == 0:
        weight[[0, -1]] /= 2
    source = torch.arange(length)[:, None] + torch.arange(-reach, reach + 1)
    if border == "replicate":
        source = source.clamp(0, length - 1)
    else:
        folded = source.remainder(2 * length)
        source = torch.where(folded < length, folded, 2 * length - 1 - folded)
    matrix = torch.zeros(length, length, dtype=torch.float64)
    return matrix.scatter_add_(1, source, (weight / weight.sum()).expand(length, -1))


class Blur(NamedTuple):
    """How strongly images are smoothed: width of the window and standard deviation [px]."""

    kernel: int
    sigma: float


class GaussianBlur(nn.Module):
    """Smooths images with a Gaussian, along rows and columns one after the other.

    Each pass is one product with a banded matrix: its cost does not grow with the kernel.

    Args:
        kernel: Width of the window [px].
        sigma: Standard deviation [px].
        border: What lies outside the image.

    Raises:
        ValueError: If the width or the standard deviation is not positive, or the border unknown.
    """

    def __init__(self, kernel: int = 5, sigma: float = 2.0, border: Border = "replicate") -> None:
        super().__init__()
        if border not in ("replicate", "reflect"):
            raise ValueError(f"border must be 'replicate' or 'reflect', got {border!r}")
        self.border: Border = border
        self.set(kernel, sigma)

    def set(self, kernel: int, sigma: float) -> None:
        """Change the width of the window [px] and the standard deviation [px].

        Raises:
            ValueError: If one of them is not positive.
        """
        if kernel < 1:
            raise ValueError(f"kernel must be at least 1 px, got {kernel}")
        if not 0 < sigma < math.inf:
            raise ValueError(f"sigma must be positive and finite, got {sigma:.6g} px")
        self.blur = Blur(kernel, sigma)
        self._matrices: dict[tuple[int, torch.dtype, torch.device], Tensor] = {}

    def _matrix(self, length: int, like: Tensor) -> Tensor:
        key = (length, like.dtype, like.device)
        if key not in self._matrices:
            self._matrices[key] = blur_matrix(length, *self.blur, self.border).to(like)
        return self._matrices[key]

    def forward(self, image: Tensor) -> Tensor:
        """Smooth images of shape (..., H, W)."""
        height, width = image.shape[-2:]
        with torch.autocast(image.device.type, enabled=False):
            return self._matrix(height, image) @ image @ self._matrix(width, image).T


@dataclass(frozen=True)
class BlurSchedule:
    """Takes the smoothing away while training proceeds: a function of the fraction done, so that resuming is exact.

    With start a, end b and fraction f: geometric a (b / a)^f, linear a + (b - a) f, cosine
    b + (a - b) (1 + cos(pi f)) / 2, for kernel and sigma each. The defaults are the paper's ends, 128 / 128 to 5 / 2.

    Attributes:
        start: Kernel and sigma at the beginning [px].
        end: Kernel and sigma at the end [px].
        shape: How one becomes the other.
    """

    start: tuple[float, float] = (128, 128.0)
    end: tuple[float, float] = (5, 2.0)
    shape: Literal["geometric", "linear", "cosine"] = "geometric"

    def __post_init__(self) -> None:
        if self.shape not in ("geometric", "linear", "cosine"):
            raise ValueError(f"blur schedule must be geometric, linear or cosine, got {self.shape!r}")
        if min(*self.start, *self.end) <= 0:
            raise ValueError(f"blur schedule needs positive kernels and sigmas, got {self.start} and {self.end}")

    def _between(self, start: float, end: float, fraction: float) -> float:
        if self.shape == "geometric":
            return float(start * (end / start) ** fraction)
        share = fraction if self.shape == "linear" else (1 - math.cos(math.pi * fraction)) / 2
        return start + (end - start) * share

    def __call__(self, fraction: float) -> Blur:
        """Give kernel and sigma once `fraction` of the training (held to between 0 and 1) is done."""
        fraction = min(max(fraction, 0.0), 1.0)
        (kernel, sigma), (last_kernel, last_sigma) = self.start, self.end
        return Blur(round(self._between(kernel, last_kernel, fraction)), self._between(sigma, last_sigma, fraction))
