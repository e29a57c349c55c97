"""Events: jolts and tumbling on both sides of their limits, and what a model explains of a motion is no jolt."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from physid.estimation.measurement import Noise
from physid.estimation.prediction import Segmentation
from physid.estimation.segmented_fit import PHASES, EventSettings, find_events, smooth_path
from physid.physics.rotations import exponential
from physid.scenes import find_setup

STEP, FRAMES, KINK = 1 / 100, 40, 17
SCENE = replace(find_setup("collide").scene, time_step=STEP)
SETTINGS = EventSettings(reach=0.05)
REACH = 5
QUIET = Noise(1e-6, 1e-6)
REST = PHASES.index("rest")


def kinked(time: Tensor, velocity: float, spin: float, body: int = 1) -> Tensor:
    """Return poses (1, T, 2, 7) of two blocks, one of which goes off at the time of the frame KINK (T,)."""
    since = (time - time[KINK]).clamp_min(0)
    pose = torch.zeros(1, len(time), 2, 7).double()
    pose[0, :, body, 0], pose[0, :, body, 1] = 0.6 * velocity * since, -0.8 * velocity * since
    pose[..., 6] = 1.0
    turn = torch.tensor([0.0, 0.0, spin]).double()
    pose[0, :, body, 3:] = exponential(turn * since[:, None])
    return pose


def found(
    pose: Tensor, time: Tensor, *, present: Tensor | None = None, smooth: Tensor | None = None, noise: Noise = QUIET,
    phase: int = REST,
) -> list[int]:  # fmt: skip
    """Return the frames of events of one trajectory."""
    shape = pose.shape[:3]
    there = torch.ones(shape).double() if present is None else present
    path = torch.zeros(*shape, 6).double() if smooth is None else smooth
    phases = torch.full(shape, phase)
    events = find_events(phases, pose, there, time.expand(len(pose), -1), path, noise, SCENE, SETTINGS)
    return [int(k) for k in events[0].nonzero()[:, 0]]


EVEN = STEP * torch.arange(FRAMES).double()
UNEVEN = EVEN + 0.4 * STEP * torch.rand(FRAMES, generator=torch.Generator().manual_seed(0)).double()


@pytest.mark.parametrize("time", [EVEN, UNEVEN], ids=["even", "uneven"])
@pytest.mark.parametrize("body", [0, 1])
def test_a_jolt_is_a_change_of_a_velocity_or_of_a_spin_by_more_than_the_least(time: Tensor, body: int) -> None:
    """The lines before and after the kink differ by all of it, and by less beside it."""
    for factor, expected in ((0.999, []), (1.001, [KINK, KINK + 1])):
        assert found(kinked(time, factor * SETTINGS.jolt_speed, 0.0, body), time) == expected
        assert found(kinked(time, 0.0, factor * SETTINGS.jolt_spin, body), time) == expected


@pytest.mark.parametrize("kind", [0, 1])
def test_in_noise_a_jolt_is_six_deviations_of_the_difference_of_two_slopes(kind: int) -> None:
    """Each slope has the variance s^2 / S, with S = h^2 n (n^2 - 1) / 12 of n frames."""
    least = (SETTINGS.jolt_spin, SETTINGS.jolt_speed)[kind]
    square = STEP**2 * REACH * (REACH**2 - 1) / 12
    level = 2 * least / (SETTINGS.jolt * (2 / square) ** 0.5)
    noise = Noise(level, 1e-6) if kind == 0 else Noise(1e-6, level)
    for factor, expected in ((0.999, []), (1.001, [KINK, KINK + 1])):
        size = 2 * factor * least
        pose = kinked(EVEN, 0.0, size) if kind == 0 else kinked(EVEN, size, 0.0)
        assert found(pose, EVEN, noise=noise) == expected
    assert found(kinked(EVEN, 0.0, 1.001 * least) if kind == 0 else kinked(EVEN, 1.001 * least, 0.0), EVEN)


def test_frames_that_are_not_there_say_nothing_of_a_jolt() -> None:
    pose, present = kinked(EVEN, 0.0, 0.0), torch.ones(1, FRAMES, 2).double()
    present[0, [3, 8, 20, 21]] = 0.0
    wild = pose.clone()
    wild[0, [3, 8, 20, 21], :, 0] = 7.0
    wild[0, [3, 20, 21], :, 3:] = exponential(torch.tensor([[[1.0, 0, 2]], [[0, 2.0, 1]], [[-2.0, 1, 0]]]).double())
    assert found(wild, EVEN, present=present) == []
    assert len(found(wild, EVEN)) > 10
    for factor, any_found in ((0.99, False), (1.01, True)):
        away = kinked(EVEN, factor * SETTINGS.jolt_speed, 0.0)
        away[0, [3, 8, 20, 21], :, 0] = 7.0
        assert bool(found(away, EVEN, present=present)) is any_found


def test_where_a_single_frame_is_left_on_a_side_there_is_no_slope_and_no_jolt() -> None:
    pose, present = kinked(EVEN, 5.0, 0.0), torch.zeros(1, FRAMES, 2).double()
    present[0, : KINK + 1], present[0, KINK + 4] = 1.0, 1.0
    frames = found(pose, EVEN, present=present)
    assert KINK + 1 not in frames, "after it one frame is left within reach"
    assert KINK in frames


@pytest.mark.parametrize(("frames", "seen"), [(2 * REACH - 1, False), (2 * REACH, True)])
def test_a_jolt_takes_frames_before_and_after_it(frames: int, seen: bool) -> None:
    start = KINK - REACH
    pose, time = kinked(EVEN, 9.0, 0.0)[:, start : start + frames], EVEN[start : start + frames]
    assert bool(found(pose, time)) is seen


def test_what_the_model_accelerates_is_no_jolt_however_slow_the_camera() -> None:
    """A fall changes the velocity from five frames to the next five by g times five frames, more than the least."""
    time = 10 * EVEN
    twist, pose = torch.zeros(1, FRAMES, 2, 6).double(), kinked(time, 0.0, 0.0)
    pose[0, :, 0, 2] = -9.81 / 2 * time**2
    twist[0, :, 0, 5] = -9.81 * time
    phases, whole = torch.full((1, FRAMES, 2), REST), Segmentation.equal(1, FRAMES, FRAMES)
    path = smooth_path(twist, phases, time[None], whole)
    assert torch.allclose(path[0, :, 0, 5], -9.81 / 2 * time**2)
    assert not bool(path[0, :, 1].any())
    assert found(pose, time, smooth=path) == []
    assert len(found(pose, time)) > FRAMES // 2


def test_impacts_and_new_segments_are_taken_out_of_what_a_model_accelerates() -> None:
    """The velocity that they give is not: there the acceleration goes on as it was; before all of them as after."""
    time, pull = EVEN[:20], 3.0
    twist = torch.zeros(2, 20, 1, 6).double()
    twist[..., 0, 3] = pull * time
    twist[:, 0, 0, 3] -= 2.0  # what happens in the first step is an impact
    twist[:, 8:, 0, 3] += 5.0  # and in that from the frame 7 to the next
    twist[:, 12:, 0, 3] -= 4.0  # at the frame 12 a segment begins
    phases = torch.full((2, 20, 1), REST)
    phases[:, 0], phases[:, 7] = PHASES.index("impact"), PHASES.index("contact_between_objects")
    segments = Segmentation(2, 20, torch.tensor([0, 0, 1, 1]), torch.tensor([0, 12, 0, 12]), torch.tensor([12, 8] * 2),
                            *2 * [torch.zeros(4).bool()])  # fmt: skip
    path = smooth_path(twist, phases, time.expand(2, -1), segments)
    assert torch.allclose(path[..., 0, 3], (pull * time**2 / 2).expand(2, -1))
    every = torch.full_like(phases, PHASES.index("impact"))
    assert not bool(smooth_path(twist, every, time.expand(2, -1), segments).any())


@pytest.mark.parametrize("seed", range(3))
def test_where_a_step_says_nothing_the_last_one_that_does_goes_on_and_the_first_before_all(seed: int) -> None:
    """Of two bodies that are hit in different frames, each goes on by itself; times are uneven."""
    generator = torch.Generator().manual_seed(seed)
    time = UNEVEN[:16]
    twist = torch.randn(1, 16, 2, 6, generator=generator).double()
    hit = torch.rand(1, 16, 2, generator=generator) < 0.4
    hit[0, :2, 0], hit[0, 0, 1] = True, False
    phases = torch.where(hit, PHASES.index("impact"), REST)
    path = smooth_path(twist, phases, time[None], Segmentation.equal(1, 16, 8))
    for body in range(2):
        known = [k for k in range(15) if not hit[0, k, body] and k != 7]  # at the frame 8 a segment begins
        place, speed = torch.zeros(6).double(), torch.zeros(6).double()
        for k in range(15):
            step = max([j for j in known if j <= k], default=known[0])
            pull = (twist[0, step + 1, body] - twist[0, step, body]) / (time[step + 1] - time[step])
            length = time[k + 1] - time[k]
            place, speed = place + speed * length + pull * length**2 / 2, speed + pull * length
            assert torch.allclose(path[0, k + 1, body], place, atol=1e-9)


@pytest.mark.parametrize("name", ["impact", "contact_between_objects"])
def test_impacts_and_contacts_between_bodies_are_events_and_other_phases_are_none(name: str) -> None:
    pose = kinked(EVEN, 0.0, 0.0)
    assert found(pose, EVEN, phase=PHASES.index(name)) == list(range(FRAMES))
    for other in set(PHASES) - {"impact", "contact_between_objects"}:
        assert found(pose, EVEN, phase=PHASES.index(other)) == [], other


@pytest.mark.parametrize("quarters", [0, 1])
@pytest.mark.parametrize("axis", [0, 1])
def test_what_leans_and_touches_the_ground_tumbles_and_what_leans_in_flight_does_not(axis: int, quarters: int) -> None:
    for factor, tumbles in ((0.99, False), (1.01, True)):
        pose, turn = kinked(EVEN, 0.0, 0.0), torch.zeros(3).double()
        turn[axis] = factor * SETTINGS.tilted + quarters * math.pi / 2
        pose[0, 5:9, 1, 3:] = exponential(turn)
        quiet = Noise(1e3, 1e3)  # no change of a spin is a jolt beside it
        assert found(pose, EVEN, noise=quiet) == (list(range(5, 9)) if tumbles else [])
        assert found(pose, EVEN, noise=quiet, phase=PHASES.index("free_fall")) == []
