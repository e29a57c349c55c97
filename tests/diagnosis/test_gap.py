"""How far a gap closes: the share is a mean over trajectories, its interval needs enough of them."""

from __future__ import annotations

import pytest
import torch

from physid.diagnosis.conclusion.gap import closing
from physid.diagnosis.settings.conclusion import GapSettings

SETTINGS = GapSettings()
FLOOR = 1e-6


@pytest.mark.parametrize("count", [1, 2, 3, 8])
def test_a_share_has_an_interval_where_there_are_enough_trajectories(count: int) -> None:
    generator = torch.Generator().manual_seed(count)
    before = 4 * FLOOR * (1 + 0.1 * torch.rand(count, generator=generator).double())
    after = FLOOR * (1 + 0.1 * torch.rand(count, generator=generator).double())
    floors, chosen = torch.full((count,), FLOOR).double(), torch.ones(count, dtype=torch.bool)
    found = closing(before, after, floors, chosen, SETTINGS, generator)
    assert found is not None
    assert found.shrink is not None
    assert found.shrink.value == pytest.approx(1.0, abs=0.1)
    if count < SETTINGS.fewest:
        assert found.shrink.low is found.shrink.high is None
        assert found.shrink.most == found.shrink.value
    else:
        assert found.shrink.low is not None
        assert found.shrink.low <= found.shrink.value <= found.shrink.most


def test_trajectories_of_which_no_frame_counts_have_no_gap() -> None:
    nothing, chosen = torch.zeros(4, dtype=torch.float64), torch.ones(4, dtype=torch.bool)
    found = closing(nothing, nothing, nothing, chosen, SETTINGS, torch.Generator())
    assert found is not None
    assert found.shrink is None
