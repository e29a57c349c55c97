"""Tests of a hypothesis: score tests and null distributions, lack of fit, residual wrenches, equivalence."""

from physid.diagnosis.testing.equivalence import alike, cosine, twins
from physid.diagnosis.testing.examination import find_lack_of_fit
from physid.diagnosis.testing.hypothesis import (
    Hypothesis,
    begin_from_finite_sizes,
    begin_hypothesis,
    conclude,
    finish_hypothesis,
    refitted_from_new_states,
)
from physid.diagnosis.testing.lack_of_fit import LackOfFit, Row
from physid.diagnosis.testing.null_distribution import ScoreTest, score_test_of
from physid.diagnosis.testing.null_tails import Tail
from physid.diagnosis.testing.parametric_bootstrap import bootstrap_spread
from physid.diagnosis.testing.residual_wrench import freed, piece_frames
from physid.diagnosis.testing.score_test import gains, joined

__all__ = [
    "Hypothesis",
    "LackOfFit",
    "Row",
    "ScoreTest",
    "Tail",
    "alike",
    "begin_from_finite_sizes",
    "begin_hypothesis",
    "bootstrap_spread",
    "conclude",
    "cosine",
    "find_lack_of_fit",
    "finish_hypothesis",
    "freed",
    "gains",
    "joined",
    "piece_frames",
    "refitted_from_new_states",
    "score_test_of",
    "twins",
]
