"""What could have been found: the least size that recordings show with a given probability, on both sides of it."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace

import pytest
import torch

from diagnosis.sets import recorded
from physid.data import RecordingSet
from physid.diagnosis.conclusion.power import detectable_factors, detectable_sizes
from physid.diagnosis.diagnose import diagnose
from physid.diagnosis.settings.testing import ScoreTestSettings
from physid.diagnosis.testing.null_tails import Tail
from physid.diagnosis.testing.score_test import Group, condition, gains, signals
from physid.estimation.least_squares.normal_equations import Normal

SETTINGS = ScoreTestSettings()
PROBABILITY, THRESHOLD = 0.95, 12.0
DRAWS = 20000


def equations(columns: torch.Tensor, data: torch.Tensor) -> Normal:
    """Return the normal equations of columns (M, P) and data (M, K), as one trajectory."""
    return Normal((columns.T @ columns)[None], (columns.T @ data)[None], data.square().sum(0)[None])


def test_an_effect_of_that_size_is_found_with_that_probability_in_white_noise() -> None:
    generator = torch.Generator().manual_seed(1)
    columns = torch.randn(80, 3, generator=generator).double()
    noise = torch.randn(80, DRAWS, generator=generator).double()
    typical = torch.tensor([0.3], dtype=torch.float64)
    unbounded = torch.full((1,), torch.inf, dtype=torch.float64)
    group = Group(("effect",), torch.tensor([2]), typical, typical, -unbounded, unbounded)
    nuisance, ridge = torch.tensor([0, 1]), torch.zeros(2, dtype=torch.float64)
    given = condition(equations(columns, noise), nuisance, ridge)
    none = Normal(torch.zeros(0, 3, 3).double(), torch.zeros(0, 3, 1).double(), torch.zeros(0, 1).double())
    signal = signals(given, group, none, SETTINGS)
    chance = Tail(torch.ones((), dtype=torch.float64), torch.full((), 2.0, dtype=torch.float64))
    size = detectable_factors(signal, THRESHOLD, chance, PROBABILITY) * typical
    for factor, expected in ((1.0, PROBABILITY), (0.0, 0.0)):
        made = condition(equations(columns, noise + factor * float(size) * columns[:, 2:]), nuisance, ridge)
        found = float((gains(made, group, SETTINGS)[0] > THRESHOLD).double().mean())
        assert found == pytest.approx(expected, abs=0.01)


def test_what_a_refit_absorbs_is_never_found() -> None:
    generator = torch.Generator().manual_seed(2)
    column = torch.randn(40, 1, generator=generator).double()
    one, unbounded = torch.ones(1, dtype=torch.float64), torch.full((1,), torch.inf, dtype=torch.float64)
    given = condition(
        equations(torch.cat([column, 2 * column], 1), column), torch.tensor([0]), torch.zeros(1, dtype=torch.float64)
    )
    none = Normal(torch.zeros(0, 2, 2).double(), torch.zeros(0, 2, 1).double(), torch.zeros(0, 1).double())
    group = Group(("effect",), torch.tensor([1]), one, one, -unbounded, unbounded)
    signal = signals(given, group, none, SETTINGS)
    assert detectable_factors(signal, THRESHOLD, Tail(one[0], 2 * one[0]), PROBABILITY).tolist() == [torch.inf]


def test_what_shows_a_hundredth_as_much_must_be_ten_times_as_large_to_be_found() -> None:
    signal = torch.tensor([400.0, 4.0, 0.04, 4e-6], dtype=torch.float64)
    white = Tail(torch.ones((), dtype=torch.float64), torch.full((), 2.0, dtype=torch.float64))
    size = (math.sqrt(THRESHOLD) + 1.6448536) / signal.sqrt()  # that quantile of a normal distribution
    assert detectable_factors(signal, THRESHOLD, white, PROBABILITY).tolist() == pytest.approx(size.tolist())


@pytest.mark.parametrize("tolerance", [1e-3, 2e-3])
def test_with_even_chances_the_size_found_moves_poses_by_the_tolerance(tolerance: float) -> None:
    """A size s of typical t gains l (s / t)^2; each of m frames moved by the tolerance d gains (d / noise)^2."""
    frames, signal, noise, typical = 500, 160.0, 2e-4, 0.3
    tail = Tail(torch.ones((), dtype=torch.float64), torch.full((), 2.0, dtype=torch.float64))
    row = SimpleNamespace(names=("drag",), signal=torch.tensor([signal]), steady_tail=tail)
    lack = SimpleNamespace(null_steady=torch.zeros(99), frames=frames, rows=[row])
    quantity = SimpleNamespace(typical=typical, null=0.0, largest=1e3, unit="N s/m")
    term = SimpleNamespace(effect=SimpleNamespace(name="drag"), name="coefficient", quantity=quantity)
    rare, margin, even = SimpleNamespace(alpha=0.01), SimpleNamespace(margin=0.0), SimpleNamespace(probability=0.5)
    settings = SimpleNamespace(evidence=rare, lack_of_fit=margin, power=even)
    given = SimpleNamespace(position=noise), SimpleNamespace(position=tolerance)
    (found,) = detectable_sizes(lack, [term], *given, settings)
    assert found.size == pytest.approx(typical * tolerance / noise * math.sqrt(frames / signal))


@pytest.mark.slow
def test_a_drag_above_the_size_that_is_reported_is_found_and_one_far_below_is_not(tmp_path: Path) -> None:
    free = diagnose(RecordingSet(recorded(tmp_path / "free")), tmp_path / "free_out")
    least = next(one.size for one in free.detectable if one.effect == "viscous_drag")
    assert free.verdict == "none"
    assert least is not None
    for factor, found in ((1.5, True), (0.25, False)):
        drag = {"viscous_drag": {"coefficient": factor * least}}
        document = diagnose(RecordingSet(recorded(tmp_path / f"{factor}", drag)), tmp_path / f"{factor}_out")
        assert (document.verdict != "none") == found, factor
