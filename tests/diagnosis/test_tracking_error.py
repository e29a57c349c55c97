"""The error of poses that were read from films: what it spreads, what a fit takes up, and how sure that is."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from physid.estimation.measurement.sensor_noise import estimate_noise
from physid.estimation.measurement.tracking_error import TrackingError, without_line

COUNTED = torch.tensor([0.02, 0.02, 0.04, 5.0, 2.0, 2.0], dtype=torch.float64)
"""The worst direction of three may be one that was not read, and counts as the second best."""
DEVIATIONS = torch.tensor([0.01, 0.02, 0.04, 5.0, 2.0, 1.0], dtype=torch.float64)


def white(trajectories: int = 40, frames: int = 320, seed: int = 0) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(trajectories, frames, 1, 6, generator=generator, dtype=torch.float64)


def error_of(track: Tensor, **more: float) -> TrackingError:
    return TrackingError(track, torch.zeros_like(track), 0.0, **more)


def test_white_errors_spread_as_they_are_in_each_direction() -> None:
    # The largest over six spans, each known within a few per cent, is a little larger than the truth.
    ratio = error_of(DEVIATIONS * white()).spread / COUNTED
    assert bool(((ratio > 0.99) & (ratio < 1.12)).all()), ratio


def test_errors_that_last_spread_as_white_ones_that_disturb_their_means_as_much() -> None:
    lasting = (DEVIATIONS * white(frames=20)).repeat_interleave(16, 1)
    ratio = error_of(lasting).spread / (4.0 * COUNTED)
    assert bool(((ratio > 0.92) & (ratio < 1.12)).all()), ratio


def test_errors_that_change_their_sign_from_frame_to_frame_spread_as_they_are() -> None:
    turned = (1 - 2 * (torch.arange(320) % 2)).double()[:, None, None]
    spread = error_of(DEVIATIONS * turned * white(400, 1).sign()).spread
    assert torch.allclose(spread, COUNTED, rtol=0.15)


def test_a_direction_in_which_nothing_was_read_counts_as_the_second_best() -> None:
    unread = DEVIATIONS * white()
    unread[..., 5] = 0.0
    spread = error_of(unread).spread
    assert float(spread[5]) == pytest.approx(float(spread[4]), rel=0.02)
    unread[..., 4] = 0.0
    spread = error_of(unread).spread
    assert spread[3:].tolist() == pytest.approx([float(spread[3])] * 3, rel=1e-6)


def test_the_noise_of_a_rotation_is_that_of_its_worst_axis_whatever_positions_do() -> None:
    track = DEVIATIONS * white()
    weight = torch.ones(track.shape[:-1], dtype=torch.float64)
    noise = estimate_noise(track, weight, error_of(track))
    assert noise.rotation == pytest.approx(0.04, rel=0.12)
    assert noise.position == pytest.approx(5.0, rel=0.12)


def test_a_first_pose_and_a_velocity_take_up_a_line_and_nothing_else() -> None:
    time = torch.linspace(0, 1, 50, dtype=torch.float64)[:, None, None]
    line = (1.0 + time).expand(3, 50, 1, 6)
    even = torch.ones(3, 50, dtype=torch.float64)
    assert float(without_line(line, even).abs().max()) < 1e-12
    assert error_of(line).floor < 1e-12
    weight = even.clone()
    weight[:, ::3] = 0.0
    bent = without_line(time.square() + line, weight)
    assert float((bent * weight[..., None, None]).sum(1).abs().max()) < 1e-10
    assert float((bent * time * weight[..., None, None]).sum(1).abs().max()) < 1e-10
    assert float(bent.abs().max()) > 0.1
    # White noise keeps its mean square but for two of fifty degrees of freedom; a position has three coordinates.
    many = error_of(white(2000, 50))
    assert many.floor == pytest.approx((3 * 48 / 50) ** 0.5, rel=0.01)


@pytest.mark.parametrize("sizes", [[2.0], [1.0, 3.0], [1.0, 2.0, 3.0]])
def test_what_errors_leave_of_a_fit_is_a_mean_over_trajectories_as_sure_as_those_agree(sizes: list[float]) -> None:
    size, count = torch.tensor(sizes, dtype=torch.float64), len(sizes)
    error = error_of(size[:, None, None, None] * white(1, 50).expand(count, -1, -1, -1), sure=0.0)
    weight = torch.ones(count, 50, dtype=torch.float64)
    mean, unsure = error.left_by_fit(weight)
    base, _ = error_of(white(1, 50), sure=0.0).left_by_fit(weight[:1])
    own = size.square()
    assert torch.allclose(mean, base * own.mean())
    scatter = float((own - own.mean()).square().sum()) / max(count - 1, 1)  # one alone says nothing of it
    expected = (2 * scatter / count) ** 0.5 / float(own.mean())
    assert unsure.tolist() == pytest.approx([expected] * 2)
    surer = error_of(error.track, sure=0.1).left_by_fit(weight)[1]
    assert surer.tolist() == pytest.approx([(expected**2 + 0.2**2) ** 0.5] * 2)


def test_drawn_errors_are_those_that_were_read_with_a_size_that_is_not_known() -> None:
    track = white(5, 30)
    draws = error_of(track, sure=0.0).draw(200, track, torch.Generator().manual_seed(1))
    assert draws.shape == (200, 5, 30, 1, 6)
    both = torch.cat([track, track.flip(1)])
    same = (draws[:, :, None] - torch.cat([both, -both])).abs().amax((3, 4, 5)).amin(-1)
    assert float(same.max()) == 0.0
    even = torch.ones(1, 4, 1, 6, dtype=torch.float64)
    sizes = error_of(even, sure=0.3).draw(4000, even, torch.Generator().manual_seed(1))
    logs = sizes[:, 0, 0, 0, 0].abs().log()
    assert float(logs.std()) == pytest.approx(0.3, rel=0.05)
    assert float(logs.mean()) == pytest.approx(0.0, abs=0.02)
