"""In which precision convolutions are computed soonest on the machine at hand."""

from __future__ import annotations

import torch

CPU_UNITS = ("avx512_bf16", "amx_bf16")
"""What CPUs call units for bfloat16; that it is faster was measured where there are both (docs/networks.md)."""


def has_bfloat16(device: str) -> bool:
    """Return whether a kind of device, "cpu" or "cuda", computes in bfloat16 by itself.

    Others imitate it: an EPYC with AVX2 alone multiplies matrices in bfloat16 at an eightieth of the speed
    of single precision.
    """
    if device == "cuda":
        return bool(torch.cuda.is_bf16_supported(including_emulation=False))
    known = torch.cpu.get_capabilities()
    return device == "cpu" and any(known.get(unit, False) for unit in CPU_UNITS)
