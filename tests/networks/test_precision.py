"""Which devices compute in bfloat16 by themselves."""

from __future__ import annotations

from typing import Any

import pytest
import torch

from physid.networks.precision import has_bfloat16


@pytest.mark.parametrize(
    ("capabilities", "expected"),
    [
        ({"avx2": True, "avx512_bf16": False, "amx_bf16": False}, False),
        ({"avx512_f": True, "avx512_bf16": True}, True),
        ({"avx512_f": True, "amx_bf16": True}, True),
        ({"neon": True, "bf16": True}, False),  # whether it is faster there was never measured
    ],
)
def test_only_the_units_of_known_processors_count(
    capabilities: dict[str, Any], expected: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: capabilities)
    assert has_bfloat16("cpu") is expected
    assert not has_bfloat16("mps")
