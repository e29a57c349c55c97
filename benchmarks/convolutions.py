"""What the encoder's convolutions cost as products of matrices, and as the convolutions of oneDNN.

    python benchmarks/convolutions.py

Forward and backward of each layer with channels last, in single precision and, where the CPU has units for it, in
bfloat16, on windows of the size that bodies of 20 pixels need (see `convolve_focused`), in turns; processor time
of one thread, medians.
"""

from __future__ import annotations

import argparse
import statistics
import time
from itertools import product

import torch
from torch import Tensor, nn

from physid.networks.convolutions import GatheredConv2d
from physid.networks.encoder import CONVOLUTIONS
from physid.networks.precision import has_bfloat16

WINDOWS = (45, 37, 17, 13, 5)
"""Pixels along each side of what a layer sees; the last two see whole images."""


def spent(layer: nn.Conv2d, image: Tensor, kind: torch.dtype) -> float:
    """Return the processor time of one forward and backward pass [ms]."""
    layer.zero_grad()
    image = image.clone().requires_grad_()
    begin = time.process_time()
    with torch.autocast("cpu", torch.bfloat16, enabled=kind == torch.bfloat16):
        output = layer(image)
    output.backward(torch.ones_like(output))
    return 1e3 * (time.process_time() - begin)


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--images", type=int, default=48)
    parser.add_argument("--repeat", type=int, default=15)
    options = parser.parse_args()
    torch.set_num_threads(1)
    kinds = [torch.float32] + [torch.bfloat16] * has_bfloat16("cpu")
    print("| precision | convolution | window | as it is [ms] | as a product [ms] |\n|---|---|---|---:|---:|")
    for kind, (layer, window) in product(kinds, zip(CONVOLUTIONS, WINDOWS, strict=True)):
        channels, wider, kernel, _ = layer
        image = torch.randn(options.images, channels, window, window, dtype=kind)
        image = image.contiguous(memory_format=torch.channels_last)
        pair = [form(*layer).to(memory_format=torch.channels_last) for form in (nn.Conv2d, GatheredConv2d)]  # type: ignore[call-overload]
        times = [[spent(form, image, kind) for form in pair] for _ in range(options.repeat)]
        shown = " | ".join(f"{statistics.median(column):.1f}" for column in zip(*times, strict=True))
        name = str(kind).removeprefix("torch.")
        print(f"| {name} | {channels} to {wider}, {kernel} x {kernel} | {window} x {window} | {shown} |", flush=True)


if __name__ == "__main__":
    main()
