"""What the encoder's convolutions cost as products of matrices, and as the convolutions of oneDNN.

    python benchmarks/convolutions.py

Forward and backward of each layer in bfloat16 with channels last, on windows of the size that bodies of 20 pixels need
(see `physid.networks.focus`), in turns; processor time of one thread, medians.
"""

from __future__ import annotations

import argparse
import statistics
import time

import torch
from torch import Tensor, nn

from physid.networks.encoder import CONVOLUTIONS
from physid.networks.gathered import GatheredConv2d

WINDOWS = (45, 37, 17, 13, 5)
"""Pixels along each side of what a layer sees; the last two see whole images."""


def spent(layer: nn.Conv2d, image: Tensor) -> float:
    """Return the processor time of one forward and backward pass [ms]."""
    layer.zero_grad()
    image = image.clone().requires_grad_()
    begin = time.process_time()
    with torch.autocast("cpu", torch.bfloat16):
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
    print("| convolution | window | as it is [ms] | as a product [ms] |\n|---|---|---:|---:|")
    for (channels, wider, kernel, stride), window in zip(CONVOLUTIONS, WINDOWS, strict=True):
        plain, gathered = nn.Conv2d(channels, wider, kernel, stride), GatheredConv2d(channels, wider, kernel, stride)
        image = torch.randn(options.images, channels, window, window).bfloat16()
        image = image.contiguous(memory_format=torch.channels_last)
        times: list[list[float]] = [[], []]
        for _ in range(options.repeat):
            for layer, row in zip((plain, gathered), times, strict=True):
                row.append(spent(layer.to(memory_format=torch.channels_last), image))  # type: ignore[call-overload]
        shown = " | ".join(f"{statistics.median(row):.1f}" for row in times)
        print(f"| {channels} to {wider}, {kernel} x {kernel} | {window} x {window} | {shown} |", flush=True)


if __name__ == "__main__":
    main()
