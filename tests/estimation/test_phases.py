"""What bodies do: both sides of each limit, of motions and contacts that are said and not simulated."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from physid.estimation.prediction import Prediction, Timeline
from physid.estimation.segmented_fit import PHASES, PhaseSettings, phases_of, phases_of_steps
from physid.physics.contact import PATCH
from physid.scenes import Scene, find_setup

STEP, FRAMES, G = 1 / 100, 30, 9.81
TWO = replace(find_setup("collide").scene, time_step=STEP)
MASS = [body.mass for body in TWO.bodies]
SETTINGS = PhaseSettings(impact_time=0.03, impact_frames=2, switch_time=0.04)
AT, LIGHT = 10, SETTINGS.light


def of_bodies(count: int, gravity: tuple[float, float, float] = (0.0, 0.0, -G)) -> Scene:
    """Return a scene of so many blocks, each twice as heavy as the one before."""
    first = TWO.bodies[0]
    bodies = tuple(replace(first, name=f"block{k}", mass=2.0**k * first.mass) for k in range(count))
    return replace(TWO, bodies=bodies, unknown=(), gravity=gravity)


def named(
    scene: Scene, twist: Tensor, load: Tensor, wrench: Tensor | None = None, between: Tensor | None = None,
    step: float = STEP, *, poses: bool = False,
) -> list[list[str]]:  # fmt: skip
    """Name the phases of each body in each frame.

    Args:
        scene: Of N bodies.
        twist: Shape (T, N, 6).
        load: How many weights the ground carries of each, shape (T, N).
        wrench: Commanded, shape (T, N, 6).
        between: Impulses of pairs of bodies [N s], shape (T, N (N - 1) / 2).
        step: Time between frames [s].
        poses: Whether as poses show it.
    """
    frames, bodies = load.shape
    pairs = torch.zeros(frames, bodies * (bodies - 1) // 2).double() if between is None else between
    weight = torch.tensor([body.mass for body in scene.bodies]).double() * G * step
    normal = torch.cat([load * weight, pairs], -1)
    impulse = torch.zeros(*normal.shape, PATCH).double()
    impulse[..., 0], impulse[..., -1] = 0.25 * normal, 0.75 * normal  # points of a patch carry it together
    pose = torch.zeros(1, 1, frames, bodies, 7).double()
    predicted = Prediction(pose, pose, twist[None, None], impulse.flatten(1)[None, None])
    timeline = Timeline.regular(torch.zeros(1, frames, bodies, 6).double() if wrench is None else wrench[None], step)
    name = phases_of if poses else phases_of_steps
    code = name(predicted, timeline, scene, SETTINGS)[0]
    return [[PHASES[k] for k in own] for own in code.mT.tolist()]


def still(frames: int = FRAMES, bodies: int = 1) -> tuple[Tensor, Tensor]:
    """Return no motion and loads of a weight."""
    return torch.zeros(frames, bodies, 6).double(), torch.ones(frames, bodies).double()


@pytest.mark.parametrize("gravity", [(0.0, 0.0, -G), (0.6 * G, 0.0, -0.8 * G)])
@pytest.mark.parametrize(
    ("column", "limit", "below", "above"),
    [(3, SETTINGS.still_speed, "rest", "coast"), (1, SETTINGS.still_spin, "rest", "coast")],
)
def test_a_body_is_at_rest_below_a_speed_and_a_spin(
    column: int, limit: float, below: str, above: str, gravity: tuple[float, float, float]
) -> None:
    for factor, name in ((0.99, below), (1.01, above)):
        twist, load = still()
        twist[..., column], twist[..., column + 1] = 0.6 * factor * limit, -0.8 * factor * limit
        assert named(of_bodies(1, gravity), twist, load)[0] == [name] * FRAMES


def test_a_speed_is_no_spin_and_a_spin_no_speed() -> None:
    twist, load = still()
    twist[..., 2], twist[..., 3] = 0.99 * SETTINGS.still_spin, 0.99 * SETTINGS.still_speed
    assert named(of_bodies(1), twist, load)[0] == ["rest"] * FRAMES
    twist[..., 2], twist[..., 3] = 0.0, SETTINGS.still_speed
    assert named(of_bodies(1), twist, load)[0] == ["coast"] * FRAMES, "at rest is what is slower than that"
    twist[..., 2], twist[..., 3] = SETTINGS.still_spin, 0.0
    assert named(of_bodies(1), twist, load)[0] == ["coast"] * FRAMES, "and what turns slower than that"


def test_a_switch_lasts_for_one_more_frame_however_slow_the_camera() -> None:
    twist, load = still()
    wrench = torch.zeros(FRAMES, 1, 6).double()
    wrench[:20, 0, 3] = 1.0
    found = named(replace(of_bodies(1), time_step=0.2), twist, load, wrench, step=0.2)[0]
    assert found == ["stick"] * 20 + ["force_switch"] * 2 + ["rest"] * 8


@pytest.mark.parametrize(
    ("speed", "name"),
    [
        *((0.0, "stick"), (0.99 * SETTINGS.still_speed, "stick"), (1.01 * SETTINGS.still_speed, "slide_slow")),
        *((0.99 * SETTINGS.slow, "slide_slow"), (1.01 * SETTINGS.slow, "slide_fast")),
    ],
)
def test_what_is_pushed_sticks_or_slides_slow_or_fast_and_coasts_once_nothing_pushes(speed: float, name: str) -> None:
    twist, load = still()
    twist[..., 4] = speed
    wrench = torch.zeros(FRAMES, 1, 6).double()
    wrench[:20, 0, 3] = 0.1
    found = named(of_bodies(1), twist, load, wrench)[0]
    switch = round(SETTINGS.switch_time / STEP) + 1
    after = "rest" if name == "stick" else "coast"
    # The command is there from the first frame on: that is no change of it.
    assert found == [name] * 20 + ["force_switch"] * switch + [after] * (FRAMES - 20 - switch)


@pytest.mark.parametrize(
    ("load", "flies"), [(0.0, True), (0.99 * SETTINGS.light, True), (1.01 * SETTINGS.light, False)]
)
def test_a_body_flies_that_the_ground_hardly_carries_whatever_is_commanded(load: float, flies: bool) -> None:
    twist, _ = still(bodies=2)
    loads = torch.tensor([1.0, load]).double().expand(FRAMES, 2)
    wrench = torch.zeros(FRAMES, 2, 6).double()
    wrench[AT:, :, 3] = 1.0
    first, second = named(of_bodies(2), twist, loads, wrench)
    assert "free_fall" not in first
    assert first[AT] == "force_switch"
    assert (second == ["free_fall"] * FRAMES) is flies
    assert ("free_fall" in second) is flies


@pytest.mark.parametrize("step", [STEP, 3 * STEP])
def test_an_impact_is_more_than_a_change_of_velocity_beyond_the_weight_and_lasts(step: float) -> None:
    for factor, strikes in ((0.99, False), (1.01, True)):
        twist, load = still(bodies=2)
        load[AT, 1] += factor * SETTINGS.hard / (G * step)
        scene = replace(of_bodies(2), time_step=step)
        for poses, least in ((False, 0), (True, SETTINGS.impact_frames)):
            lasting = max(least, round(SETTINGS.impact_time / step))
            first, second = named(scene, twist, load, step=step, poses=poses)
            assert first == ["rest"] * FRAMES
            impact = ["impact"] * (1 + lasting) if strikes else ["rest"] * (1 + lasting)
            assert second == ["rest"] * AT + impact + ["rest"] * (FRAMES - AT - 1 - lasting)


@pytest.mark.parametrize("pair", [(0, 1), (0, 2), (1, 2)])
def test_both_bodies_of_a_pair_touch_each_other_from_a_share_of_their_own_weight_on(pair: tuple[int, int]) -> None:
    scene, (one, other) = of_bodies(3), pair
    column = [(0, 1), (0, 2), (1, 2)].index(pair)
    weight = [body.mass * G * STEP for body in scene.bodies]
    lasting = round(SETTINGS.impact_time / STEP)
    for factor in (0.99, 1.01, 1.01 * weight[other] / weight[one]):
        twist, load = still(bodies=3)
        between = torch.zeros(FRAMES, 3).double()
        between[AT, column] = factor * SETTINGS.light * weight[one]
        found = named(scene, twist, load, None, between)
        for body in range(3):
            touches = body in pair and factor * weight[one] > weight[body]
            name = "contact_between_objects" if touches else "rest"
            expected = ["rest"] * AT + [name] * (1 + lasting) + ["rest"] * (FRAMES - AT - 1 - lasting)
            assert found[body] == expected


def test_the_last_frame_of_a_segment_goes_on_with_what_carried_bodies_before_it() -> None:
    """No step follows it, so that nothing is carried in it; a body that flew before goes on flying."""
    twist, load = still(bodies=2)
    load[:, 1] = 0.0
    load[AT], load[-1] = 0.0, 0.0
    first, second = named(of_bodies(2), twist, load, poses=True)
    assert first == ["rest"] * FRAMES
    assert second == ["free_fall"] * FRAMES
    load[AT - 1, 0] = 0.0
    assert named(of_bodies(2), twist, load, poses=True)[0][AT - 1 : AT + 2] == ["rest", "free_fall", "rest"]
    in_steps = named(of_bodies(2), twist, load)[0]
    assert in_steps[AT - 1 : AT + 2] == ["free_fall", "free_fall", "rest"], "a step in which nothing carries is a fall"


@pytest.mark.parametrize(("factor", "switches"), [(0.99, False), (1.01, True)])
def test_a_switch_is_a_change_by_a_share_of_the_largest_command_though_it_only_turns(
    factor: float, switches: bool
) -> None:
    """A force of the length F that turns by an angle a changes by 2 F sin(a / 2)."""
    twist, load = still()
    angle = torch.full((FRAMES,), 2.0).double()
    angle[AT:] += 2 * torch.tensor(factor * SETTINGS.switch / 2).asin()
    wrench = torch.zeros(FRAMES, 1, 6).double()
    wrench[:, 0, 3], wrench[:, 0, 4] = 3 * angle.cos(), 3 * angle.sin()
    wrench[-1] = wrench[-2] = 0.0
    found = named(of_bodies(1), twist, load, wrench)[0]
    lasting = 1 + round(SETTINGS.switch_time / STEP)
    name = "force_switch" if switches else "stick"
    assert found[: FRAMES - 2] == ["stick"] * AT + [name] * lasting + ["stick"] * (FRAMES - 2 - AT - lasting)


@pytest.mark.parametrize(("jumps", "noise"), [(6, False), (7, True)])
def test_a_command_that_jumps_in_more_than_a_fifth_of_the_frames_is_noise(jumps: int, noise: bool) -> None:
    twist, load = still()
    wrench = torch.zeros(FRAMES, 1, 6).double()
    for k in range(jumps):
        wrench[4 * k + 1 :, 0, 3] += 1.0 if k % 2 else -1.0
    # One more jump: nothing pushes after the last frame.
    last = bool(wrench[-2].any())
    assert last is bool(jumps % 2)
    found = named(of_bodies(1), twist, load, wrench)[0]
    assert ("force_switch" in found) is not noise
