"""Fits to segments around impacts: what segments that no initial state explains still say."""

from __future__ import annotations

import torch

from physid.estimation.prediction import Segmentation
from physid.estimation.segmented_fit import own_weights, usual_misfit

SEGMENTS = Segmentation(
    1, 40, torch.zeros(4, dtype=torch.int64), torch.arange(0, 40, 10), torch.full((4,), 10),
    torch.tensor([True, True, True, False]),
)  # fmt: skip


def test_a_doubtful_segment_counts_as_if_its_noise_were_its_misfit_and_no_other_counts_less() -> None:
    misfit = torch.tensor([0.8, 2.0, 8.0, 100.0], dtype=torch.float64)
    assert usual_misfit(SEGMENTS, misfit) == 2.0  # the median of those in contact
    assert own_weights(misfit, usual_misfit(SEGMENTS, misfit), SEGMENTS.contact).tolist() == [1.0, 1.0, 0.25, 1.0]
    assert own_weights(misfit, misfit[1], torch.zeros(4, dtype=torch.bool)).tolist() == [1.0] * 4


def test_segments_that_noise_explains_set_no_standard_below_noise() -> None:
    assert usual_misfit(SEGMENTS, torch.tensor([0.1, 0.2, 0.3, 5.0])) == 1.0
    assert usual_misfit(SEGMENTS.only(torch.tensor([3])), torch.tensor([5.0])) == 1.0
