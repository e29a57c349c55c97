"""Noise of trackers that is alike in neighbouring frames: closed forms, draws, and both sides of the judgement."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from torch import Tensor

from physid.estimation.measurement import CorrelatedNoise, Correlation, NoiseSettings, correlated_noise, estimate_noise
from physid.estimation.measurement.deviation import bends, deviation

ROWS, FRAMES, STEP = 20, 90, 1 / 60
UP = (0.0, 0.0, 1.0)
SIZES = torch.tensor([3e-3] * 3 + [5e-4] * 3).double()  # rad, m
SETTINGS = NoiseSettings()


def autoregressive(alike: float, frames: int = FRAMES, seed: int = 0) -> Tensor:
    """Return noise x_t = a x_{t-1} + sqrt(1 - a^2) w_t of the size of SIZES, shape (R, T, 1, 6)."""
    generator = np.random.default_rng(seed)
    white = generator.standard_normal((ROWS, frames, 1, 6))
    drawn = [white[:, 0]]
    for frame in range(1, frames):
        drawn.append(alike * drawn[-1] + math.sqrt(1 - alike**2) * white[:, frame])
    return torch.from_numpy(np.stack(drawn, 1)) * SIZES


def averaged(count: int, seed: int = 0) -> Tensor:
    """Return running means of so many frames of white noise, of the size of SIZES."""
    white = np.random.default_rng(seed).standard_normal((ROWS, FRAMES + count - 1, 1, 6)) / math.sqrt(count)
    return torch.from_numpy(np.lib.stride_tricks.sliding_window_view(white, count, 1).sum(-1)) * SIZES


def sliding() -> Tensor:
    """Return poses that a model predicts of blocks that slide along x and back, and turn, on level ground."""
    pose = torch.zeros(ROWS, FRAMES, 1, 7).double()
    time = torch.arange(FRAMES) * STEP
    pose[..., 0, 0], pose[..., 0, 1] = torch.sin(6 * time), 0.2 * time
    pose[..., 0, 5], pose[..., 0, 6] = torch.sin(time), torch.cos(time)
    return pose


def found(residual: Tensor, predicted: Tensor | None = None, step: float = STEP) -> CorrelatedNoise | None:
    predicted = sliding() if predicted is None else predicted
    return correlated_noise(residual, predicted, torch.ones(residual.shape[:3]), step, UP, SETTINGS)


@pytest.mark.parametrize("alike", [0.55, 0.65, 0.72])
def test_noise_whose_correlation_falls_from_frame_to_frame_is_found_with_its_size(alike: float) -> None:
    """n var(mean of n frames) tends to (1 + a) / (1 - a) sigma^2."""
    noise = found(autoregressive(alike))
    assert noise is not None
    assert noise.sizes == pytest.approx((3e-3, 5e-4), rel=0.15)
    for each in noise.correlations:
        assert float(each.between(np.ones(()))) == pytest.approx(alike, abs=0.1)
        assert each.slow(FRAMES) == pytest.approx((1 + alike) / (1 - alike), rel=0.5)


def test_of_noise_that_is_alike_for_long_the_slow_part_counts_as_what_a_model_lacks() -> None:
    noise = found(autoregressive(0.85))  # for 100 ms
    assert noise is not None
    for size, truth in zip(noise.sizes, (3e-3, 5e-4), strict=True):
        assert 0.6 < size / truth < 1.05


@pytest.mark.parametrize("count", [3, 5, 9])
def test_running_means_are_found_with_their_size(count: int) -> None:
    noise = found(averaged(count))
    assert noise is not None
    assert noise.sizes == pytest.approx((3e-3, 5e-4), rel=0.15)
    assert all(each.slow(FRAMES) == pytest.approx(count, rel=0.3) for each in noise.correlations)


@pytest.mark.parametrize("frames", [30, 90, 300])
def test_white_noise_is_white(frames: int) -> None:
    for seed in range(5):
        predicted = torch.zeros(ROWS, frames, 1, 7).double()
        predicted[..., 6] = 1
        assert found(autoregressive(0.0, frames, seed), predicted) is None


def test_what_a_model_lacks_is_no_noise() -> None:
    """Where it moves the body along the ground, and where it is slow; nor is what moves in every coordinate."""
    wave = 5e-3 * torch.sin(torch.arange(FRAMES) / 6.0)[None, :, None].expand(ROWS, -1, 1)
    white = autoregressive(0.0)
    for shown in ([3], [3, 4, 2]):
        residual = white.clone()
        for axis in shown:
            residual[..., axis] += wave
        assert found(residual) is None
    assert found(white + wave[..., None], thrown()) is None
    slow = 5e-3 * torch.sin(torch.arange(FRAMES) * STEP * 2 * math.pi / 2.5)[None, :, None, None]
    assert found(white + slow) is None


def thrown() -> Tensor:
    """Return poses of blocks that move in each coordinate."""
    pose = sliding()
    pose[..., 2] = pose[..., 0]
    pose[..., 3], pose[..., 4] = 0.5 * pose[..., 5], 0.3 * pose[..., 5]
    pose[..., 3:] /= pose[..., 3:].norm(dim=-1, keepdim=True)
    return pose


def test_what_impacts_leave_before_a_body_rests_is_no_noise_either() -> None:
    """Residuals with heavy tails are no interpolation, in which most poses lie on lines."""
    predicted, residual = thrown(), autoregressive(0.0)
    predicted[:, 60:] = predicted[:, 60:61]
    struck = torch.from_numpy(np.random.default_rng(1).random((ROWS, FRAMES, 1, 1)) < 0.2)
    left = torch.cumsum(torch.where(struck, 20 * autoregressive(0.0, seed=2), 0.0), 1)
    left[:, 60:] = left[:, 60:61]
    assert found(residual + left, predicted) is None


def test_less_than_the_least_noise_is_white() -> None:
    assert found(0.1 * autoregressive(0.8)) is None


def test_positions_alone_may_be_smoothed() -> None:
    residual = torch.cat([autoregressive(0.0)[..., :3], averaged(5)[..., 3:]], -1)
    noise = found(residual)
    assert noise is not None
    turns, places = noise.correlations
    assert (turns.slow(FRAMES), places.slow(FRAMES)) == pytest.approx((1.0, 5.0), rel=0.3)
    assert noise.sizes == pytest.approx((3e-3, 5e-4), rel=0.15)


def test_across_a_ground_that_is_tilted_nothing_moves() -> None:
    """Along a slope all of x and z change, the way off the slope does not."""
    tilt = math.radians(30)
    predicted, residual = sliding(), averaged(5)
    x, z = predicted[..., 0].clone(), predicted[..., 2].clone()
    predicted[..., 0], predicted[..., 2] = math.cos(tilt) * x + math.sin(tilt) * z, -math.sin(tilt) * x
    slanted = found(residual, predicted)
    assert slanted is None or slanted.correlations[1].slow(FRAMES) == 1.0
    up = (math.sin(tilt), 0.0, math.cos(tilt))
    noise = correlated_noise(residual, predicted, torch.ones(residual.shape[:3]), STEP, up, SETTINGS)
    assert noise is not None
    assert noise.correlations[1].slow(FRAMES) == pytest.approx(5.0, rel=0.3)


def test_poses_that_were_interpolated_have_the_noise_of_those_that_were_measured() -> None:
    """Of four poses three lie on the line between two: the median of what bends is nil, and white noise is not seen."""
    every, rows = 4, torch.from_numpy(np.random.default_rng(0).standard_normal((ROWS, 61, 6))) * SIZES
    share = (torch.arange(240) % every / every)[None, :, None]
    index = torch.arange(240) // every
    line = (1 - share) * rows[:, index] + share * rows[:, index + 1]
    predicted = torch.zeros(ROWS, 240, 1, 7).double()
    predicted[..., 6] = 1
    assert estimate_noise(line[:, :, None], torch.ones(ROWS, 240, 1)).position == SETTINGS.least[1]
    noise = found(line[:, :, None], predicted, STEP / every)
    assert noise is not None
    assert float(noise.spread[3]) == pytest.approx(2 * 5e-4, rel=0.4)


def test_draws_have_the_size_and_the_correlation() -> None:
    parts = ((0.2, 0.0, 1), (0.5, 3.0, 1), (0.3, 6.0, 2))
    noise = CorrelatedNoise((3e-3, 5e-4), (Correlation(parts), Correlation(((1.0, 0.0, 1),))), FRAMES, 0.0)
    drawn = noise.draw(40, torch.zeros(ROWS, FRAMES, 1, 6).double(), torch.Generator().manual_seed(0))
    assert drawn.shape == (40, ROWS, FRAMES, 1, 6)
    assert torch.allclose(drawn.flatten(0, 3).std(0), SIZES, rtol=0.03)
    for apart in (1, 3, 8):
        turns, places = ((drawn[..., apart:, :, k] * drawn[..., :-apart, :, k]).mean() / SIZES[k] ** 2 for k in (0, 3))
        expected = 0.5 * math.exp(-apart / 3) + 0.3 * math.exp(-((apart / 6) ** 2))
        assert float(turns) == pytest.approx(expected, abs=0.02)
        assert float(places) == pytest.approx(0.0, abs=0.02)
    wide = CorrelatedNoise(noise.sizes, noise.correlations, FRAMES, 0.3)
    sets = wide.draw(400, torch.zeros(2, FRAMES, 1, 6).double(), torch.Generator().manual_seed(1))
    assert float(sets[..., 3:].flatten(1).std(1).log().std()) == pytest.approx(0.3, abs=0.05)


def test_floors_are_what_a_line_over_a_trajectory_leaves() -> None:
    parts = ((0.3, 0.0, 1), (0.7, 10.0, 1))
    noise = CorrelatedNoise((3e-3, 5e-4), (Correlation(parts),) * 2, FRAMES, 0.0)
    drawn = noise.draw(300, torch.zeros(ROWS, FRAMES, 1, 6).double(), torch.Generator().manual_seed(0))
    line = np.stack([np.ones(FRAMES), np.linspace(-1, 1, FRAMES)], 1)
    rest = torch.from_numpy(np.eye(FRAMES) - line @ np.linalg.pinv(line))
    left = torch.einsum("ts,zrsnk->zrtnk", rest, drawn).square().flatten(0, 3).mean(0)
    assert noise.floor == pytest.approx(math.sqrt(float(left[3:].sum())), rel=0.02)
    assert noise.rotation_floor == pytest.approx(math.sqrt(float(left[:3].sum())), rel=0.02)
    squares = [mean for mean, _ in noise.left_by_fit(1e9)]
    assert squares == pytest.approx([noise.rotation_floor**2, noise.floor**2])


def test_shares_are_those_that_made_the_bends() -> None:
    """The variance of r_t - (r_{t-k} + r_{t+k}) / 2 is (1.5 - 2 rho_k + rho_2k / 2) sigma^2."""
    truth = Correlation(((0.25, 0.0, 1), (0.75, 4.0, 2)))
    spans = [1, 2, 3, 4, 6, 8, 12, 16, 24]
    rho = {k: float(truth.between(np.array(float(k)))) for k in (*spans, *(2 * k for k in spans))}
    bends = {k: 2.0 * (1.5 - 2 * rho[k] + rho[2 * k] / 2) / 1.5 for k in spans}
    correlation, variance = Correlation.of(bends, 8.0)
    assert variance == pytest.approx(2.0, rel=1e-6)
    for k in spans:
        assert float(correlation.between(np.array(float(k)))) == pytest.approx(rho[k], abs=1e-6)


@pytest.mark.parametrize("frames", [3, 4, 7, 40])
def test_a_line_over_few_frames_takes_the_trace_of_its_projection(frames: int) -> None:
    for parts in (((1.0, 0.0, 1),), ((0.4, 2.0, 1), (0.6, 5.0, 2))):
        alike = Correlation(parts)
        lags = np.abs(np.subtract.outer(np.arange(frames), np.arange(frames))).astype(np.float64)
        line = np.stack([np.ones(frames), np.arange(frames)], 1)
        rest = np.eye(frames) - line @ np.linalg.pinv(line)
        assert alike.left_by_line(frames) == pytest.approx(np.trace(rest @ alike.between(lags)) / frames, abs=1e-12)
    assert Correlation(((1.0, 5.0, 2),)).left_by_line(2) == pytest.approx(0.0, abs=1e-12), "two frames are a line"


@pytest.mark.parametrize("frames", [1, 2, 5, 8, 90])
def test_a_mean_of_frames_that_are_alike_varies_as_the_sum_of_their_correlations(frames: int) -> None:
    """n var(mean of n frames) grows with n for noise that is alike, and n is half the frames at most."""
    alike = Correlation(((0.3, 0.0, 1), (0.7, 6.0, 1)))
    span = max(n for n in (1, 2, 4, 8, 16, 32) if n <= max(frames // 2, 1))
    pairs = [0.7 * math.exp(-abs(i - j) / 6) + 0.3 * (i == j) for i in range(span) for j in range(span)]
    assert alike.slow(frames) == pytest.approx(sum(pairs) / span)
    noise = CorrelatedNoise((3e-3, 5e-4), (Correlation(((1.0, 0.0, 1),)), alike), frames, 0.2)
    assert noise.spread.tolist() == pytest.approx([3e-3] * 3 + [5e-4 * math.sqrt(sum(pairs) / span)] * 3)
    for values in (0.0, 1.0, 400.0):
        unsure = [each for _, each in noise.left_by_fit(values)]
        independent = [max(values, 1.0) / slow for slow in (1.0, sum(pairs) / span)]
        assert unsure == pytest.approx([math.sqrt(2 / each + 0.4**2) for each in independent])


def test_noise_is_measured_in_its_unit_and_by_the_frames_that_count_alone() -> None:
    residual, predicted = averaged(5), torch.zeros(ROWS, FRAMES, 1, 7).double()
    predicted[..., 6] = 1
    noise, larger = found(residual, predicted), found(3 * residual, predicted)
    assert noise is not None
    assert larger is not None
    assert larger.sizes == pytest.approx([3 * size for size in noise.sizes], rel=1e-9)
    assert (larger.frames, larger.sure) == (FRAMES, SETTINGS.sure)
    wild, good = residual.clone(), torch.ones(ROWS, FRAMES, 1)
    wild[3, 20:40], good[3, 20:40] = 1.0, 0.0
    without = residual.clone()
    without[3, 20:40] = 0.0
    one, other = (correlated_noise(each, predicted, good, STEP, UP, SETTINGS) for each in (wild, without))
    assert one == other
    assert one is not None
    assert one.sizes == pytest.approx(noise.sizes, rel=0.1)


def test_too_short_trajectories_show_no_correlation() -> None:
    """Three spans at least must have windows: with neighbours 1, 2 and 3 frames away."""
    smooth = averaged(2).unfold(1, 7, 4).movedim(-1, 2).flatten(0, 1)
    predicted = torch.zeros(len(smooth), 7, 1, 7).double()
    predicted[..., 6] = 1
    assert found(smooth, predicted) is not None
    assert found(smooth[:, :6], predicted[:, :6]) is None


@pytest.mark.parametrize("span", [1, 3])
def test_frames_leave_the_middle_of_their_neighbours_by_half_of_what_they_are_accelerated(span: int) -> None:
    time = torch.arange(12).double()
    value = (5.0 - 2.0 * time + 0.7 * time**2 / 2)[None, :, None, None]
    good = torch.ones(1, 12, 1)
    good[0, 5] = 0.0
    bent, counts = bends(value, good, span)
    assert torch.allclose(bent, torch.full_like(bent, -0.7 * span**2 / 2))
    lost = {5 - span, 5, 5 + span}
    assert [span + k for k, one in enumerate(counts[0, :, 0].tolist()) if not one] == sorted(
        frame for frame in lost if span <= frame < 12 - span
    )


def test_a_deviation_is_that_of_most_values_whatever_a_few_large_ones_are() -> None:
    values = torch.from_numpy(np.abs(np.random.default_rng(0).standard_normal(40000)))
    assert float(deviation(values)) == pytest.approx(1.0, rel=0.01)
    spoiled = torch.cat([values, torch.full((400,), 50.0).double()])
    assert float(deviation(spoiled)) == pytest.approx(1.0, rel=0.03)
    assert float(deviation(7 * values)) == pytest.approx(7 * float(deviation(values)))
