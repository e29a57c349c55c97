"""First guesses of states: frames that are not seen, or belong to another segment, have no say in them."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from physid.estimation.least_squares.initial_states import InitialStates, guess_initial_states
from physid.estimation.least_squares.settings import GuessSettings
from physid.estimation.prediction import Segmentation
from physid.physics.rotations import exponential, multiply
from physid.scenes import find_setup

FRAMES, STEP, LEAN = 24, 1 / 60, 2e-3
TWO = replace(find_setup("collide").scene, time_step=STEP)
THREE = replace(TWO, bodies=(*TWO.bodies, replace(TWO.bodies[1], name="third")))
UP = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)


def lying(headings: Tensor) -> Tensor:
    """Return poses (R, T, N, 7) of blocks side by side on the ground with headings (R, T, N)."""
    bodies = (TWO if headings.shape[2] == 2 else THREE).bodies
    pose = torch.zeros(*headings.shape, 7, dtype=torch.float64)
    pose[..., 2] = torch.tensor([body.size[2] / 2 for body in bodies]).double()
    pose[..., 0] = torch.arange(len(bodies)).double()
    pose[..., 3:] = exponential(headings[..., None] * UP)
    return pose


def guessed(
    pose: Tensor, seen: Tensor | None = None, segments: Segmentation | None = None, lean: float = LEAN
) -> InitialStates:
    rows, frames, bodies = pose.shape[:3]
    time = (STEP * torch.arange(frames).double()).expand(rows, -1)
    there = torch.ones(pose.shape[:3]).double() if seen is None else seen
    cut = segments or Segmentation.equal(rows, frames, frames)
    return guess_initial_states(pose, there, time, cut, TWO if bodies == 2 else THREE, lean)


@pytest.mark.parametrize("left", [1, 2, 8])
def test_whatever_stands_in_frames_that_are_not_seen_bodies_are_as_parallel_and_as_level(left: int) -> None:
    """However few are seen, and of whichever of two bodies: their headings are compared in frames that show both."""
    generator = torch.Generator().manual_seed(left)
    pose, seen = lying(torch.full((4, FRAMES, 2), 0.3).double()), torch.zeros(4, FRAMES, 2).double()
    seen[0, :left], seen[1, 5 : 5 + left], seen[2, ::3], seen[3] = 1.0, 1.0, 1.0, 1.0
    seen[3, left:, 0] = 0.0  # the first body alone is lost
    turn = exponential(torch.randn(4, FRAMES, 2, 3, generator=generator).double())
    wild = torch.where(seen[..., None] > 0, pose[..., 3:], multiply(turn, pose[..., 3:]))
    found = guessed(torch.cat([pose[..., :3], wild], -1), seen)
    assert bool(found.parallel.all())
    assert bool(found.level.all())


@pytest.mark.parametrize("third", [0.0, 0.4, math.pi / 2])
def test_the_first_of_three_blocks_is_parallel_as_soon_as_one_other_is(third: float) -> None:
    found = guessed(lying(torch.tensor([0.1, 0.1, 0.1 + third]).double().expand(1, FRAMES, 3)))
    assert found.parallel[0].tolist() == [True, True, third != 0.4]
    apart = guessed(lying(torch.tensor([0.1, 0.5, 0.9]).double().expand(1, FRAMES, 3)))
    assert not bool(apart.parallel.any())


def test_what_follows_a_segment_says_nothing_of_its_beginning_however_short_it_is() -> None:
    """Five frames beside twenty of another segment: what comes after them is another throw, turned and faster."""
    time = STEP * torch.arange(FRAMES).double()
    pose = lying(torch.zeros(1, FRAMES, 2).double())
    pose[..., 2] += 3.0 + 2.0 * time[None, :, None] - 9.81 / 2 * time[None, :, None] ** 2
    alone = pose[:, :5]
    pose[:, 5:, :, :3] += 5.0 * time[None, 5:, None, None]
    pose[:, 5:, :, 3:] = exponential(torch.tensor([0.4, 0.3, 1.0]).double() * time[5:, None, None])
    cut = Segmentation(1, FRAMES, torch.zeros(2).long(), torch.tensor([0, 5]), torch.tensor([5, FRAMES - 5]),
                       *2 * [torch.zeros(2).bool()])  # fmt: skip
    found, expected = guessed(pose, None, cut), guessed(alone)
    for name in ("pose", "twist"):
        assert torch.allclose(getattr(found, name)[:, :1], getattr(expected, name), atol=1e-6), name
    for name in ("resting", "level", "parallel"):
        assert torch.equal(getattr(found, name)[:1], getattr(expected, name)), name


@pytest.mark.parametrize("late", [0, 1])
def test_a_body_sinks_only_if_it_does_so_soon(late: int) -> None:
    """Seen a little too high, it lies there unless it comes down within a quarter of a second."""
    settings = GuessSettings()
    frames = round(settings.soon / STEP)
    pose = lying(torch.zeros(1, 3 * frames, 2).double())
    height = 2 * pose[0, 0, 0, 2]
    pose[..., 2] += 0.2 * height
    pose[:, frames + late :, :, 2] -= 0.2 * height
    assert bool(guessed(pose).resting.all()) is bool(late)
    little = pose.clone()
    little[:, frames + late :, :, 2] += (0.2 - 0.9 * settings.sinks) * height
    assert bool(guessed(little).resting.all())
    more = pose.clone()
    more[:, frames + late :, :, 2] += (0.2 - 1.1 * settings.sinks) * height
    assert bool(guessed(more).resting.all()) is bool(late)


def test_frames_that_are_not_seen_let_no_body_sink() -> None:
    pose, seen = lying(torch.zeros(1, FRAMES, 2).double()), torch.ones(1, FRAMES, 2).double()
    pose[:, 4:9, :, 2], seen[:, 4:9] = -1.0, 0.0
    assert bool(guessed(pose, seen).resting.all())


def test_a_block_that_stood_and_is_tipped_over_soon_lay_on_the_ground_at_first() -> None:
    """Its middle comes down, its lowest point does not."""
    upright, over = exponential(torch.tensor([[0.0, 0.0, 0.0], [0.0, math.pi / 2, 0.0]]).double())
    length, _, height = TWO.bodies[1].size
    (low, lies), (high, stands) = sorted([(height, upright), (length, over)], key=lambda each: each[0])
    assert low < 0.9 * high
    pose = lying(torch.zeros(1, FRAMES, 2).double())
    pose[:, :10, 1, 2], pose[:, :10, 1, 3:] = high / 2, stands
    pose[:, 10:, 1, 2], pose[:, 10:, 1, 3:] = low / 2, lies
    assert bool(guessed(pose).resting.all())


def test_what_lies_has_no_velocity_out_of_the_ground_and_does_not_tumble_however_noisy_it_is() -> None:
    generator = torch.Generator().manual_seed(3)
    pose = lying(torch.zeros(20, FRAMES, 2).double())
    pose[..., :3] += 1e-3 * torch.randn(20, FRAMES, 2, 3, generator=generator).double()
    turn = exponential(LEAN * torch.randn(20, FRAMES, 2, 3, generator=generator).double())
    pose[..., 3:] = multiply(turn, pose[..., 3:])
    found = guessed(pose)
    assert bool(found.resting.all())
    assert float(found.twist[..., [0, 1, 5]].abs().max()) < 1e-12
    assert float(found.twist[:-1, ..., [2, 3, 4]].abs().min()) > 0.0
    assert not bool(found.twist[-1].any()), "the last guess is rest"


def test_one_frame_alone_shows_a_lean_and_no_rest() -> None:
    """The limit is that of the mean square of two components."""
    limit = 2**0.5 * GuessSettings().level * LEAN
    seen = torch.zeros(2, FRAMES, 2).double()
    seen[:, 7] = 1.0
    pose = lying(torch.zeros(2, FRAMES, 2).double())
    for row, share in enumerate((0.95, 1.05)):
        pose[row, :, :, 3:] = exponential(torch.tensor([share * limit, 0.0, 0.0]).double())
    assert guessed(pose, seen).level.all(1).tolist() == [True, False]
    assert not bool(guessed(lying(torch.zeros(1, 1, 2).double())).resting.any())


def test_without_noise_only_what_is_exactly_parallel_is_parallel() -> None:
    found = guessed(lying(torch.zeros(1, FRAMES, 2).double()), lean=0.0)
    assert bool(found.parallel.all())
    assert bool(found.level.all())
    assert not bool(guessed(lying(torch.tensor([0.0, 1e-6]).double().expand(1, FRAMES, 2)), lean=0.0).parallel.any())


@pytest.mark.parametrize("heading", [0.0, math.pi / 8, -math.pi / 8, 0.5])
@pytest.mark.parametrize("body", [0, 1])
@pytest.mark.parametrize(("share", "parallel"), [(0.9, True), (1.2, False)])
def test_either_block_keeps_its_heading_or_both_are_free(
    body: int, heading: float, share: float, parallel: bool
) -> None:
    """One of them turns about its mean, by a root of the sum of squares of so many times the limit."""
    time = torch.linspace(-1, 1, FRAMES).double()
    turn = share * GuessSettings().turned * LEAN * time / time.norm()
    headings = torch.full((1, FRAMES, 2), heading).double()
    headings[..., body] += turn
    assert bool(guessed(lying(headings)).parallel.all()) is parallel


@pytest.mark.parametrize("step", [1e-4, 1e-2])
def test_a_throw_is_guessed_alike_at_every_frame_rate(step: float) -> None:
    scene, time = replace(find_setup("toss").scene, time_step=step), step * torch.arange(20).double()[None]
    pose = torch.zeros(1, 20, 1, 7).double()
    spin, speed = torch.tensor([1.0, -2.0, 0.5]).double(), torch.tensor([0.7, -0.4, 1.5]).double()
    pose[0, :, 0, :3] = speed * time[0, :, None] - torch.tensor([0, 0, 9.81]) / 2 * time[0, :, None] ** 2
    pose[..., 2] += 1.0
    pose[0, :, 0, 3:] = exponential(spin * time[0, :, None])
    found = guess_initial_states(pose, torch.ones(1, 20, 1).double(), time, Segmentation.equal(1, 20, 20), scene)
    assert torch.allclose(found.twist, torch.cat([spin, speed]).expand_as(found.twist), atol=1e-6)
    assert not bool(found.level.any()), "it leans by more than nothing, if nothing is said of noise"


def test_velocities_are_guessed_with_the_deviation_of_a_line_through_their_frames() -> None:
    """Of n frames it is s / (h sqrt(n (n^2 - 1) / 12)), and of the first place s sqrt((4 n - 2) / (n (n + 1)))."""
    scene, count, noise, step = find_setup("toss").scene, 2000, 1e-3, 1 / 60
    scene = replace(scene, time_step=step)
    time = step * torch.arange(20).double()
    off = noise * torch.randn(count, 20, 1, 3, generator=torch.Generator().manual_seed(0)).double()
    pose = torch.zeros(count, 20, 1, 7).double()
    pose[..., :3], pose[..., 6] = off, 1.0
    pose[..., 2] += 5.0 - 9.81 / 2 * time[:, None] ** 2
    segments = Segmentation.equal(count, 20, 20)
    settings = GuessSettings(spans=(0.2, 0.1, 0.05), fewest=4)
    there = torch.ones(count, 20, 1).double()
    found = guess_initial_states(pose, there, time.expand(count, -1), segments, scene, settings=settings)
    for k, n in enumerate((12, 6, 4, 4)):
        speed, place = found.twist[k, :, 0, 3:], found.pose[k, :, 0, :3]
        assert speed.std(0).tolist() == pytest.approx([noise / step * (12 / (n * (n * n - 1))) ** 0.5] * 3, rel=0.08)
        assert place.std(0).tolist() == pytest.approx([noise * ((4 * n - 2) / (n * (n + 1))) ** 0.5] * 3, rel=0.08)


@pytest.mark.parametrize(("share", "parallel"), [(0.95, True), (1.05, False)])
def test_two_headings_differ_by_the_root_of_two_of_what_one_may_turn_by(share: float, parallel: bool) -> None:
    """Of the difference of two the variance is twice that of one."""
    apart = share * 2**0.5 * GuessSettings().turned * LEAN / FRAMES**0.5
    headings = torch.tensor([0.2, 0.2 + apart]).double().expand(1, FRAMES, 2)
    assert bool(guessed(lying(headings)).parallel.all()) is parallel
