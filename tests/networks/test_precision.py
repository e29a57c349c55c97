"""The precision of the encoder is the one that is soonest done on the machine at hand."""

from __future__ import annotations

import time
from typing import Any

import pytest
import torch

from physid.networks.camera import PinholeCamera
from physid.networks.chart import PlanarChart
from physid.networks.encoder import PoseEncoder
from physid.networks.precision import has_bfloat16

CAMERA = PinholeCamera(128, 128, (0, 0, 3), (0, 0, 0), (0, 1, 0), 40.0)
CHART = PlanarChart(CAMERA, (0, 0, 1), 0.0, [0.2, 0.2])
IMAGES = torch.rand(4, 3, 128, 128)
BACKGROUND = torch.full((1, 3, 128, 128), 0.7)
MUCH = 2.0


@pytest.mark.parametrize(
    ("capabilities", "expected"),
    [
        ({"avx2": True, "avx512_bf16": False, "amx_bf16": False}, False),
        ({"avx512_f": True, "avx512_bf16": True}, True),
        ({"avx512_f": True, "amx_bf16": True}, True),
        ({"neon": True, "bf16": True}, False),  # was never measured
    ],
)
def test_only_units_that_were_measured_count(
    capabilities: dict[str, Any], expected: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: capabilities)
    assert has_bfloat16("cpu") is expected
    assert not has_bfloat16("mps")


def seconds(fast: bool | None) -> float:
    """Return what the faster of two passes through an encoder takes, forward and backward."""
    encoder = PoseEncoder(CHART, fast=fast)
    spent = []
    for _ in range(2):
        begin = time.process_time()
        encoder(IMAGES, BACKGROUND).numbers.sum().backward()
        spent.append(time.process_time() - begin)
    return min(spent)


def test_left_alone_the_encoder_is_not_much_slower_than_in_the_better_precision() -> None:
    assert seconds(None) < MUCH * min(seconds(True), seconds(False))
