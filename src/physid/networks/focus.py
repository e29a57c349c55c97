"""Convolutions of images that are zero but around an object: the same result for a fraction of the work."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor, nn


def field_of(layers: Sequence[nn.Module]) -> tuple[int, int]:
    """Return the width of the receptive field and the stride of convolutions without padding [px]."""
    field, stride = 1, 1
    for layer in layers:
        if isinstance(layer, nn.Conv2d):
            field += (int(layer.kernel_size[0]) - 1) * stride
            stride *= int(layer.stride[0])
    return field, stride


def convolve_focused(layers: nn.Sequential, image: Tensor, occupied: Tensor) -> Tensor:
    """Apply convolutions without padding, skipping what they make of empty surroundings.

    Where their receptive field holds zeros alone, their output is the same everywhere: it is computed once, and the
    rest from a window around what is not zero. Output j sees the pixels stride j to stride j + field - 1, so a window
    that starts at a multiple of the stride has exactly the outputs of the whole image. An image without empty
    surroundings is convolved as a whole.

    Args:
        layers: Convolutions of one kernel and stride along both axes, without padding, and functions of single numbers.
        image: Shape (B, C, H, W).
        occupied: Where it may differ from zero, shape (B, H, W).

    Returns:
        What `layers(image)` gives, up to rounding; shape (B, C', H', W').
    """
    field, stride = field_of(list(layers))
    height, width = ((length - field) // stride + 1 for length in image.shape[-2:])
    top, rows = _window(occupied.any(-1), field, stride, height)
    left, columns = _window(occupied.any(-2), field, stride, width)
    if rows == height and columns == width:
        whole: Tensor = layers(image)
        return whole
    window = _places(stride * top, stride * (rows - 1) + field, stride * left, stride * (columns - 1) + field)
    # Channels last, the layout in which convolutions are fastest.
    seen = layers(image.movedim(1, -1)[window].movedim(-1, 1))
    blank = layers(image.new_zeros(1, image.shape[1], field, field))
    canvas = blank.movedim(1, -1).expand(len(image), height, width, -1)
    filled: Tensor = canvas.index_put(_places(top, rows, left, columns), seen.movedim(1, -1))
    return filled.movedim(-1, 1)


def _places(top: Tensor, rows: int, left: Tensor, columns: int) -> tuple[Tensor, Tensor, Tensor]:
    """Return indices of windows that begin at (top, left), each (B,), to be used on (B, H, W, ...)."""
    each = torch.arange(len(top), device=top.device)[:, None, None]
    down = top[:, None] + torch.arange(rows, device=top.device)
    across = left[:, None] + torch.arange(columns, device=top.device)
    return each, down[:, :, None], across[:, None, :]


def _window(occupied: Tensor, field: int, stride: int, outputs: int) -> tuple[Tensor, int]:
    """Find where along an axis (B, L) the outputs begin that see something, (B,), and their common number."""
    position = torch.arange(occupied.shape[-1], device=occupied.device)
    first = torch.where(occupied, position, len(position)).amin(-1)
    last = torch.where(occupied, position, -1).amax(-1)
    start = ((first - field + stride) // stride).clamp(0, outputs - 1)
    end = (last // stride).clamp(0, outputs - 1)
    width = max(int((end - start).amax()) + 1, 1)
    return start.clamp_max(outputs - width), width
