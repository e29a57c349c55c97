"""Convolutions in less time: of images that are zero but around an object, and as products of matrices."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, final

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


@final
class GatheredConv2d(nn.Conv2d):
    """A convolution without padding that gathers what each output sees into a row of a matrix.

    With its gradient, on a CPU, a convolution of 13 x 13 pixels and 256 channels takes 1.8 times as long in bfloat16,
    and 1.3 times as long in single precision (benchmarks/convolutions.py). In any other case it is `nn.Conv2d`.
    """

    def forward(self, input: Tensor) -> Tensor:
        """Convolve images (B, C, H, W); the result is (B, O, H', W')."""
        device = input.device.type
        if device != "cpu" or not torch.is_grad_enabled():
            return super().forward(input)
        kind = torch.get_autocast_dtype(device) if torch.is_autocast_enabled(device) else self.weight.dtype
        assert self.bias is not None
        with torch.autocast(device, enabled=False):
            output: Tensor = _Gathered.apply(
                input.to(kind), self.weight.to(kind), self.bias.to(kind), int(self.stride[0])
            )  # type: ignore[no-untyped-call]
        return output


class _Gathered(torch.autograd.Function):
    """y = X W^T + b with X the gathered image; W's gradient is dy^T X, the image's that of the convolution."""

    @staticmethod
    def forward(ctx: Any, image: Tensor, weight: Tensor, bias: Tensor, stride: int) -> Tensor:
        rows, matrix = _gather(image, weight, stride), weight.permute(0, 2, 3, 1).flatten(1)
        ctx.save_for_backward(image, weight, rows)
        ctx.stride = stride
        height, width = ((length - weight.shape[-1]) // stride + 1 for length in image.shape[-2:])
        return torch.addmm(bias, rows, matrix.T).view(len(image), height, width, -1).movedim(-1, 1)

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor | None, Tensor, Tensor, None]:
        (slope,) = grads
        image, weight, rows = ctx.saved_tensors
        flat = slope.movedim(1, -1).reshape(-1, len(weight))
        by_weight = (flat.T @ rows).unflatten(1, (*weight.shape[2:], -1)).movedim(-1, 1)
        by_image = None
        if ctx.needs_input_grad[0]:
            stride = [ctx.stride, ctx.stride]
            by_image, _, _ = torch.ops.aten.convolution_backward(
                slope, image, weight, None, stride, [0, 0], [1, 1], False, [0, 0], 1, [True, False, False]
            )
        return by_image, by_weight, flat.sum(0), None


def _gather(image: Tensor, weight: Tensor, stride: int) -> Tensor:
    """Return what each output sees, shape (B H' W', k k C): rows of k C neighbouring numbers, channels last."""
    image = image.movedim(1, -1).contiguous()
    size = weight.shape[-1]
    batch, down, across, _ = image.stride()
    height, width = ((length - size) // stride + 1 for length in image.shape[1:3])
    shape = (len(image), height, width, size, size * image.shape[-1])
    return image.as_strided(shape, (batch, stride * down, stride * across, down, 1)).reshape(-1, shape[3] * shape[4])
