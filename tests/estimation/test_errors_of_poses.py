"""Noise, misfit and errors of readers: constants that are integrals, closed forms, and both sides of each judgement."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from scipy.stats import norm
from torch import Tensor

from physid.estimation.measurement import deviation
from physid.estimation.measurement.misfit import Misfit
from physid.estimation.measurement.outliers import outlier_poses
from physid.estimation.measurement.sensor_noise import Noise, NoiseSettings, estimate_noise, noise_of_poses
from physid.estimation.measurement.tracking_error import TrackingError, without_line
from physid.estimation.measurement.unexplained import lack_of_fit_sentence, unexplained_kinds
from physid.physics.rotations import exponential

FRAMES = 60
NOISE = Noise(rotation=0.004, position=0.001)
SETTINGS = NoiseSettings()
TIME = torch.arange(FRAMES, dtype=torch.float64)[None] / 30


def white(*shape: int, seed: int = 0) -> Tensor:
    return torch.randn(*shape, 6, generator=torch.Generator().manual_seed(seed), dtype=torch.float64) * NOISE.spread()


def test_constants_of_robust_deviations_are_those_of_the_normal_distribution() -> None:
    cut = deviation.TRIM
    inside = 1 - 2 * cut * norm.pdf(cut) / (2 * norm.cdf(cut) - 1)
    assert pytest.approx(inside**0.5, abs=1e-4) == deviation.TRIMMED
    assert pytest.approx(1 / norm.ppf(0.75), abs=1e-4) == deviation.NORMAL_MAD


def test_a_perfect_model_leaves_three_coordinates_of_noise_or_what_a_reader_errs() -> None:
    assert NOISE.floor == pytest.approx(3**0.5 * 0.001)
    assert NOISE.rotation_floor == pytest.approx(3**0.5 * 0.004)
    assert NOISE.spread().tolist() == pytest.approx([0.004] * 3 + [0.001] * 3)
    track = white(5, FRAMES, 1)
    read = replace(NOISE, error=TrackingError(track, 0 * track, 0.0))
    assert read.error is not None
    assert read.floor == read.error.floor
    assert torch.equal(read.spread(), read.error.spread)
    least = torch.tensor([0.5] * 3 + [0.25] * 3).double()
    assert torch.equal(replace(read, least=(0.5, 0.25)).spread(), least)
    drawn = NOISE.draw(3, torch.zeros(40, 50, 1, 6).double(), torch.Generator().manual_seed(0))
    assert drawn.shape == (3, 40, 50, 1, 6)
    assert torch.allclose(drawn.flatten(0, 3).std(0), NOISE.spread(), rtol=0.05)
    assert NOISE.or_less(Noise(0.001, 0.002)) == Noise(0.001, 0.001)


def test_an_axis_that_hardly_moves_says_nothing_of_noise_and_one_that_moves_does() -> None:
    residual = white(40, FRAMES, 1)
    there = torch.ones(40, FRAMES, 1)
    for share, counts in ((0.5 * SETTINGS.still, False), (0.2, True)):
        one = residual.clone()
        one[..., 4:] *= share
        found = estimate_noise(one, there)
        assert (found.position > 0.9 * NOISE.position) is not counts
        assert found.rotation == pytest.approx(NOISE.rotation, rel=0.05)


@pytest.mark.parametrize("factor", [0.1, 10.0])
def test_the_estimated_noise_has_the_size_of_the_noise_and_at_least_the_least(factor: float) -> None:
    residual = factor * white(40, FRAMES, 2)
    settings = NoiseSettings(least=(NOISE.rotation, NOISE.position))
    found = estimate_noise(residual, torch.ones(40, FRAMES, 2), settings=settings)
    expected = max(1.0, factor)
    assert found.rotation == pytest.approx(expected * NOISE.rotation, rel=0.03)
    assert found.position == pytest.approx(expected * NOISE.position, rel=0.03)
    assert found.least == settings.least


def test_frames_beside_those_that_do_not_count_say_nothing_of_noise() -> None:
    residual, there = white(40, FRAMES, 1), torch.ones(40, FRAMES, 1)
    residual[:, ::4], there[:, ::4] = 1e3, 0.0
    found = estimate_noise(residual, there)
    assert found.position == pytest.approx(NOISE.position, rel=0.06)
    nothing = estimate_noise(residual, 0 * there)
    assert (nothing.rotation, nothing.position) == SETTINGS.unseen


def test_a_few_outliers_do_not_change_the_noise() -> None:
    residual = white(40, FRAMES, 1)
    wild = torch.rand(40, FRAMES, 1, generator=torch.Generator().manual_seed(1)) < 0.01
    residual[wild] *= 1e3
    found = estimate_noise(residual, torch.ones(40, FRAMES, 1))
    assert found.position == pytest.approx(NOISE.position, rel=0.05)


def test_poses_of_which_some_frames_are_lost_show_their_noise_as_well() -> None:
    pose, off = torch.zeros(40, FRAMES, 1, 7).double(), white(40, FRAMES, 1)
    pose[..., :3] = TIME[..., None, None] ** 2 + off[..., 3:]
    pose[..., 3:] = exponential(off[..., :3])
    real = torch.ones(40, FRAMES, dtype=torch.bool)
    real[:, 30:], pose[:, 30:, :, :3] = False, 1e3 * torch.randn(40, 30, 1, 3).double()
    found = noise_of_poses(pose, real, TIME.expand(40, -1))
    assert found.position == pytest.approx(NOISE.position, rel=0.06)
    assert found.rotation == pytest.approx(NOISE.rotation, rel=0.06)
    assert noise_of_poses(pose, 0 * real > 0).position == SETTINGS.unseen[1]


@pytest.mark.parametrize("kind", [0, 1])
@pytest.mark.parametrize(("factor", "wild"), [(0.9, False), (1.1, True)])
@pytest.mark.parametrize("noisy", [False, True])
def test_a_pose_is_an_outlier_beyond_a_jump_or_ten_usual_deviations(
    kind: int, factor: float, wild: bool, noisy: bool
) -> None:
    generator = torch.Generator().manual_seed(4)
    size = 40 * SETTINGS.jump[kind] if noisy else 0.0
    sign = 2.0 * torch.randint(2, (20, FRAMES), generator=generator).double() - 1
    off = torch.zeros(20, FRAMES, 1, 6).double()
    axis = 3 * kind
    off[..., 0, axis] = 0.01 * size * sign
    pose = torch.zeros(20, FRAMES, 1, 7).double()
    present = torch.ones(20, FRAMES, 1)
    flat = pose.clone()
    flat[..., :3], flat[..., 3:] = off[..., 3:], exponential(off[..., :3])
    # How far poses usually are from the line between their neighbours, by the definition of the deviation.
    away = [off[:, k:-k] - (off[:, 2 * k :] + off[:, : -2 * k]) / 2 for k in (1, 2, 3)]
    odd = torch.stack([one[:, 2 - k : FRAMES - 4 - k, 0, axis].abs() for k, one in enumerate(away)]).median(0).values
    usual = SETTINGS.usual * deviation.NORMAL_MAD * float(odd.median())
    limit = max(SETTINGS.jump[kind], usual)
    assert (limit > SETTINGS.jump[kind]) is noisy
    moved = off.clone()
    moved[3, 25:36, 0, axis] = 0.0
    moved[3, 30, 0, axis] = factor * limit
    pose[..., :3], pose[..., 3:] = moved[..., 3:], exponential(moved[..., :3])
    assert bool(outlier_poses(pose, present)[3, 30, 0]) is wild
    present[3, 30] = 0.0
    assert not outlier_poses(pose, present)[3, 30, 0], "what is not there is none"


def test_a_motion_along_a_line_at_uneven_times_leaves_no_outlier_at_either_end() -> None:
    time = torch.rand(4, 12, generator=torch.Generator().manual_seed(6)).double().cumsum(1)
    pose = torch.zeros(4, 12, 1, 7).double()
    pose[..., 0, 0], pose[..., 6] = 9.0 * time, 1.0
    settings = NoiseSettings(jump=(1e-9, 1e-9), usual=1e-9)
    assert not outlier_poses(pose, torch.ones(4, 12, 1), time, settings).any()
    assert outlier_poses(pose, torch.ones(4, 12, 1), None, settings).any(), "at even times it jumps"


def test_a_constant_is_all_misfit_nothing_is_none_and_alternating_errors_are_noise() -> None:
    real = torch.ones(2, 20, dtype=torch.bool)
    zero = torch.zeros(2, 20, 1, 3).double()
    assert Misfit.of(zero, real) == Misfit(0.0, 0.0, 0.0)
    found = Misfit.of(zero + torch.tensor([0.3, 0.0, 0.4]).double(), real)
    assert found.size == pytest.approx(0.5)
    assert found.score == math.inf
    assert found.noise == pytest.approx(0, abs=1e-9)
    sign = 1.0 - 2 * (torch.arange(20) % 2)
    flips = zero + 0.1 * sign[:, None, None]
    noisy = Misfit.of(flips, real)  # third differences are 8 times as large: 64 / 20 of the mean square
    assert noisy.size == 0
    assert noisy.noise == pytest.approx(0.1 * (64 / 20) ** 0.5)
    assert noisy.score < 0


def test_the_score_of_a_misfit_is_its_excess_over_the_deviation_of_a_mean() -> None:
    """Along one axis of n differences: mean square less noise, over the root of DEVIATION / n times the noise."""
    generator = torch.Generator().manual_seed(2)
    value = torch.randn(1, 50, 1, 3, generator=generator).double() * torch.tensor([1.0, 0.0, 0.0]).double()
    real = torch.ones(1, 50, dtype=torch.bool)
    x = value[0, :, 0, 0]
    weights = torch.tensor([1.0, 9.0, 9.0, 1.0]).double() / 20
    square = float((x.square().unfold(0, 4, 1) @ weights).mean())
    noise = float((x[3:] - 3 * x[2:-1] + 3 * x[1:-2] - x[:-3]).square().mean()) / 20
    found = Misfit.of(value, real)
    assert found.noise == pytest.approx(noise**0.5)
    assert found.size == pytest.approx(max(square - noise, 0.0) ** 0.5)
    assert found.score == pytest.approx((square - noise) / noise / math.sqrt(2 * (15**2 + 6**2 + 1) / 20**2 * 2 / 47))
    two = Misfit.of(torch.cat([value, value], 2), real)
    assert two.score == pytest.approx(found.score * 2**0.5), "two bodies are twice as many differences"


@pytest.mark.parametrize("ratio", [0.5, 1.0, 4.0])
def test_beside_errors_of_a_reader_a_misfit_is_judged_by_the_logarithm_of_its_mean_square(ratio: float) -> None:
    value = torch.full((3, 10, 1, 3), 0.1, dtype=torch.float64)
    expected = 3 * 0.01 / ratio
    found = Misfit.of(value, torch.ones(3, 10, dtype=torch.bool), (expected, 0.2))
    assert found.score == pytest.approx(math.log(ratio) / 0.2, abs=1e-9)
    assert found.size == pytest.approx(math.sqrt(max(0.03 - expected, 0.0)), abs=1e-7)
    assert found.noise == pytest.approx(math.sqrt(expected / 3))
    two = Misfit.of(value.expand(3, 10, 2, 3), torch.ones(3, 10, dtype=torch.bool), (expected, 0.2))
    assert (two.size, two.noise, two.score) == pytest.approx((found.size, found.noise, found.score), abs=1e-12)


@pytest.mark.parametrize(("factor", "size"), [(0.3, 1.0), (1.0, 1.0), (3.0, 3.0)])
def test_errors_of_a_reader_are_as_large_as_recordings_are_rough_and_no_smaller_than_they_were_read(
    factor: float, size: float
) -> None:
    track = white(6, 40, 2, seed=3)
    error = TrackingError(track, torch.ones_like(track), 0.5)
    residual = factor * track
    weight = torch.ones(6, 40, 2)
    residual[:, 7], weight[:, 7] = 1e3, 0.0
    sized = error.sized(residual * torch.tensor([1, 1, 1, 2, 2, 2]), weight)
    assert sized.factors == pytest.approx((size, max(1.0, 2 * factor)), rel=1e-6)
    assert torch.allclose(error.common, torch.full_like(track, 0.5))
    larger = replace(error, factors=(2.0, 3.0))
    assert larger.floor == pytest.approx(3 * error.floor)
    assert torch.allclose(larger.spread, error.spread * torch.tensor([2, 2, 2, 3, 3, 3]))
    drawn = replace(larger, deviation=0.0, sure=0.0).draw(1, larger.track, torch.Generator().manual_seed(0))[0]
    both = torch.cat([track, track.flip(1)]) * torch.tensor([2, 2, 2, 3, 3, 3])
    assert float((drawn[:, None] - torch.cat([both, -both])).abs().amax((2, 3, 4)).amin(1).max()) == 0


def test_a_scale_that_all_share_is_off_in_all_alike() -> None:
    zero = torch.zeros(3, 8, 1, 6).double()
    error = TrackingError(zero, zero + 2.0, 0.1, sure=0.0)
    drawn = error.draw(4000, error.track, torch.Generator().manual_seed(1))
    assert torch.equal(drawn, drawn[:, :1, :1, :, :1].expand_as(drawn))
    assert float(drawn[:, 0, 0, 0, 0].std()) == pytest.approx(0.2, rel=0.05)
    assert float(drawn.mean()) == pytest.approx(0, abs=0.02)


def test_poses_that_were_read_again_err_by_what_lies_between() -> None:
    read, turn = torch.zeros(1, 3, 1, 7).double(), torch.tensor([0.1, 0.0, -0.2]).double()
    read[..., 6] = 1.0
    again = read.clone()
    again[..., :3], again[..., 3:] = 0.5, exponential(turn)
    found = TrackingError.between(read, again, torch.ones(1, 3, 1, 6).double(), 0.3)
    assert torch.allclose(found.track, torch.cat([turn, torch.full((3,), 0.5).double()]).expand(1, 3, 1, 6))
    assert found.deviation == 0.3
    assert not without_line(found.track, torch.ones(1, 3).double()).abs().max() > 1e-12


def test_kinds_are_unexplained_where_a_fit_says_so_alone() -> None:
    assert unexplained_kinds({}) == ()
    assert unexplained_kinds({"fit/position_explained": 0.0, "fit/rotation_explained": 1.0}) == ("position",)
    assert unexplained_kinds({"fit/rotation_explained": 0.0, "fit/position_explained": 0.0}) == ("position", "rotation")
    assert lack_of_fit_sentence({"fit/position_explained": 1.0}) is None


def test_errors_are_averaged_over_half_of_the_frames_at_most() -> None:
    """Of errors that last for two of four frames the means of two vary by twice as much as white noise lets them."""
    sign = torch.tensor([1.0, 1.0, -1.0, -1.0], dtype=torch.float64)
    axes = torch.eye(3, dtype=torch.float64).repeat(1, 2)
    track = 0.01 * sign[None, :, None, None] * axes[:, None, None, :]
    own = (0.01**2 / 3) ** 0.5
    assert TrackingError(track, 0 * track, 0.0).spread.tolist() == pytest.approx([2**0.5 * own] * 6)
    assert TrackingError(track[:, 1:3], 0 * track[:, 1:3], 0.0).spread.tolist() == pytest.approx([own] * 6)
